/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/log.h"

static void test_line_names_level_object_stage_reason(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	lp_error("v4l2: /dev/video0", "STREAMON", "%s - is another program using it?",
		 lp_strerror(-EBUSY));
	assert_string_equal(
		capture_end(&capture),
		"error v4l2: /dev/video0: STREAMON: Device or resource busy - is another program "
		"using it?\n");
}

static void test_errno_is_preserved_and_usable(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	errno = ENOENT;
	lp_warning("file: a.jpg", "open", "%m");
	assert_int_equal(errno, ENOENT);
	assert_string_equal(capture_end(&capture),
			    "warning file: a.jpg: open: No such file or directory\n");
}

static void test_level_hides_what_is_less_severe(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	lp_log_set_level(LP_LOG_WARNING);
	lp_info("level", "test", "hidden");
	lp_warning("level", "test", "shown");
	lp_log_set_level(LP_LOG_INFO);
	assert_string_equal(capture_end(&capture), "warning level: test: shown\n");
}

static void test_repeats_are_counted_not_printed(void **state)
{
	struct capture capture;
	const char *text;

	(void)state;
	capture_begin(&capture);
	for (int i = 0; i < 100; i++)
		lp_error("camera", "decode", "frame %d is broken", i);
	lp_error("camera", "decode", "another kind");
	lp_error("camera", "decode", "%s", "text of one kind");
	lp_error("camera", "decode", "%s", "text of another kind");
	lp_error("camera", "decode", "%s", "text of one kind");
	lp_error("other camera", "decode", "frame %d is broken", 7);
	lp_log_flush(0); /* nothing is due yet */
	text = capture_end(&capture);
	assert_string_equal(text, "error camera: decode: frame 0 is broken\n"
				  "error camera: decode: another kind\n"
				  "error camera: decode: text of one kind\n"
				  "error camera: decode: text of another kind\n"
				  "error other camera: decode: frame 7 is broken\n");
	capture_begin(&capture);
	lp_log_flush(1);
	assert_string_equal(capture_end(&capture),
			    "error camera: decode: frame 99 is broken (99 times more)\n"
			    "error camera: decode: text of one kind (1 times more)\n");
}

static void test_counts_survive_many_other_kinds(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	for (int i = 0; i < 5; i++)
		lp_error("evicted", "test", "again");
	for (int i = 0; i < 64; i++) {
		char object[32];

		(void)snprintf(object, sizeof(object), "object %d", i);
		lp_error(object, "test", "once");
	}
	assert_contains(capture_end(&capture), "error evicted: test: again (4 times more)\n");
}

static void test_one_message_is_one_line(void **state)
{
	struct capture capture;
	char longer[2000];

	(void)state;
	memset(longer, 'x', sizeof(longer) - 1);
	longer[sizeof(longer) - 1] = '\0';
	capture_begin(&capture);
	lp_error("client", "request", "%s", "first\nsecond\r");
	lp_error(longer, "stage", "reason");
	capture_end(&capture);
	assert_contains(capture.text, "error client: request: first second \n");
	capture_begin(&capture);
	lp_warning("ws: \x1b[2J", "origin", "of %s: %s", "http://\x1b]0;title\x07\x1b[2Jx",
		   "\xc2\x9b"
		   "31m");
	assert_string_equal(capture_end(&capture),
			    "warning ws:  [2J: origin: of http:// ]0;title  [2Jx: ?31m\n");
	assert_true(strlen(capture.text) < 800);
	assert_int_equal(capture.text[strlen(capture.text) - 1], '\n');
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_line_names_level_object_stage_reason),
		cmocka_unit_test(test_errno_is_preserved_and_usable),
		cmocka_unit_test(test_level_hides_what_is_less_severe),
		cmocka_unit_test(test_repeats_are_counted_not_printed),
		cmocka_unit_test(test_counts_survive_many_other_kinds),
		cmocka_unit_test(test_one_message_is_one_line),
	};

	unsetenv("JOURNAL_STREAM");
	return cmocka_run_group_tests(tests, NULL, NULL);
}
