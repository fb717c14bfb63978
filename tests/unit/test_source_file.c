/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "base/clock.h"
#include "base/uri.h"
#include "include/frame.h"
#include "include/source.h"
#include "loop_test.h"

extern const struct lp_source_ops lp_source_file_ops;

/* What the host was told. */
static struct {
	int count;
	struct lp_frame *frames[64];
	enum lp_source_state state;
	char reason[512];
} heard;

static char folder[64];
static struct lp_source *source;

static void on_frame(void *context, struct lp_frame *frame)
{
	(void)context;
	assert_true(heard.count < 64);
	heard.frames[heard.count++] = frame;
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	(void)context;
	heard.state = state;
	(void)snprintf(heard.reason, sizeof(heard.reason), "%s", reason);
}

static struct lp_loop *loop;

static int setup(void **state)
{
	assert_int_equal(lp_loop_create(&loop), 0);
	(void)state;
	memset(&heard, 0, sizeof(heard));
	(void)strcpy(folder, "/tmp/lp-file-XXXXXX");
	return mkdtemp(folder) ? 0 : -1;
}

static void destroy(void)
{
	for (int i = 0; i < heard.count; i++)
		lp_frame_release(heard.frames[i]);
	lp_source_file_ops.destroy(source);
	memset(&heard, 0, sizeof(heard));
	source = NULL;
}

static int teardown(void **state)
{
	char command[128];

	(void)state;
	destroy();
	lp_loop_destroy(loop);
	(void)snprintf(command, sizeof(command), "rm -r %s", folder);
	return system(command);
}

static void write_file(const char *name, const void *data, size_t size)
{
	char path[128];
	FILE *file;

	(void)snprintf(path, sizeof(path), "%s/%s", folder, name);
	file = fopen(path, "wb");
	assert_non_null(file);
	assert_int_equal(fwrite(data, 1, size, file), size);
	assert_int_equal(fclose(file), 0);
}

/* Create; `name` is below the folder. */
static int create(const char *name, const char *query, bool once)
{
	const struct lp_source_host host = {.loop = loop,
					    .once = once,
					    .frame = on_frame,
					    .state = on_state};
	struct lp_uri uri;
	char text[256];

	(void)snprintf(text, sizeof(text), "file:%s/%s%s", folder, name, query);
	assert_int_equal(lp_uri_parse(&uri, text), 0);
	return lp_source_file_ops.create(&uri, &host, &source);
}

/* Dispatch until the source has ended or `count` frames are here. */
static void pump(int count)
{
	while (heard.count < count && heard.state != LP_SOURCE_ENDED &&
	       heard.state != LP_SOURCE_DOWN)
		assert_true(loop_turn(loop, 60000));
}

static const char grey[] = "AAAABBBBCCCC"; /* three pictures of 2x2 */

static void test_once_gives_each_frame_and_marks_the_last(void **state)
{
	(void)state;
	write_file("a.grey", grey, 12);
	assert_int_equal(create("a.grey", "?size=2x2&exposures_us=100,200&gain=2&rate=1&loop=1",
				true),
			 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.state, LP_SOURCE_ENDED);
	assert_int_equal(heard.count, 3);
	for (int i = 0; i < 3; i++) {
		const struct lp_frame *frame = heard.frames[i];

		assert_int_equal(frame->format, LP_FORMAT_GREY);
		assert_int_equal(frame->width_px, 2);
		assert_int_equal(frame->stride_bytes, 2);
		assert_int_equal(frame->size_bytes, 4);
		assert_memory_equal(frame->data, grey + (size_t)4 * i, 4);
		assert_int_equal(frame->sequence, i);
		assert_true(frame->exposure_us == (i % 2 ? 200 : 100) && frame->gain == 2);
		assert_int_equal(frame->t_arrival_ns, frame->t_read_ns);
		assert_true(isnan(frame->wheel_deg));
		assert_int_equal(frame->flags, i == 2 ? LP_FRAME_LAST : 0);
	}
}

static void test_loop_repeats_and_exposures_follow_the_set(void **state)
{
	struct lp_source_caps caps;

	(void)state;
	write_file("a.grey", grey, 12);
	assert_int_equal(create("a.grey", "?size=2x2&exposures_us=1,2&rate=0", false), 0);
	lp_source_file_ops.caps(source, &caps);
	assert_false(caps.finite);
	assert_true(caps.reports_exposure);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	for (int i = 0; i < 7; i++) {
		pump(1);
		assert_int_equal(heard.frames[0]->sequence, i);
		assert_int_equal(heard.frames[0]->data[0], "ABC"[i % 3]);
		assert_true(heard.frames[0]->exposure_us == (i % 3 == 1 ? 2 : 1));
		lp_frame_release(heard.frames[0]);
		heard.count = 0;
	}
}

static void test_rate_paces(void **state)
{
	const int64_t start_ns = lp_clock_ns();

	(void)state;
	write_file("a.grey", grey, 12);
	assert_int_equal(create("a.grey", "?size=2x2&rate=50&loop=0", false), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.count, 3);
	assert_true(lp_clock_ns() - start_ns >= 40 * LP_NS_PER_MS);
	assert_int_equal(heard.frames[2]->flags, LP_FRAME_LAST);
	assert_true(isnan(heard.frames[0]->exposure_us));
}

static void test_folder_in_name_order_other_files_left_out(void **state)
{
	(void)state;
	write_file("2.grey", "2222", 4);
	write_file("1.grey", "1111", 4);
	write_file("README.txt", "no picture", 10);
	write_file("3.pfm", "Pf\n1 1\n-1\n\0\0\200?", 14);
	assert_int_equal(create("", "?size=2x2", true), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.count, 3);
	assert_int_equal(heard.frames[0]->data[0], '1');
	assert_int_equal(heard.frames[1]->data[0], '2');
	assert_int_equal(heard.frames[2]->format, LP_FORMAT_RGB_F32);
	assert_int_equal(heard.frames[2]->stride_bytes, 12);
	assert_true(((const float *)(const void *)heard.frames[2]->data)[1] == 1.0F);
}

/* As people and cameras number them; an exposure in the wrong place is wrong light. */
static void test_numbers_in_names_count_by_value(void **state)
{
	static const char *const names[] = {"IMG_10.grey", "IMG_2.grey", "IMG_1.grey"};

	(void)state;
	for (size_t i = 0; i < 3; i++)
		write_file(names[i], names[i] + 4, 4);
	assert_int_equal(create("", "?size=2x2&exposures_us=1,2,10", true), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.count, 3);
	assert_memory_equal(heard.frames[0]->data, "1.gr", 4);
	assert_memory_equal(heard.frames[1]->data, "2.gr", 4);
	assert_memory_equal(heard.frames[2]->data, "10.g", 4);
	assert_true(heard.frames[2]->exposure_us == 10);
}

/* Phones append previews, gain maps and movies to a photo; cameras send one JPEG after another. */
static void test_a_photo_is_its_first_picture_and_a_stream_all_of_them(void **state)
{
	static const uint8_t two[] = {
		0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0,  4,  0, 6, 1,    1,    0x11, 0, /* SOI, SOF0:
											6x4 */
		0xff, 0xda, 0,	  8,	1, 1,  0, 0,  63, 0, 1, 2,    0xff, 0xd9,    /* SOS, EOI */
		0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0,  2,  0, 3, 1,    1,    0x11, 0, 0xff,
		0xda, 0,    8,	  1,	1, 0,  0, 63, 0,  1, 2, 0xff, 0xd9,
	};
	static const struct {
		const char *name, *query;
		int pictures;
	} cases[] = {
		{"a.jpg", "", 1},
		{"a.JPEG", "", 1},
		{"no_name_of_a_kind", "", 1},
		{"a.jpg", "?format=mjpeg", 2},
		{"a.mjpg", "", 2},
		{"a.mjpeg", "?format=jpeg", 1},
	};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		write_file(cases[i].name, two, sizeof(two));
		assert_int_equal(create(cases[i].name, cases[i].query, true), 0);
		assert_int_equal(lp_source_file_ops.start(source), 0);
		pump(64);
		assert_int_equal(heard.state, LP_SOURCE_ENDED);
		assert_int_equal(heard.count, cases[i].pictures);
		assert_int_equal(heard.frames[0]->width_px, 6);
		assert_int_equal(heard.frames[heard.count - 1]->flags, LP_FRAME_LAST);
		destroy();
	}
}

static void test_what_cannot_be_read_is_an_error_of_start(void **state)
{
	static const struct {
		const char *name, *query;
		int ret;
	} cases[] = {
		{"missing.jpg", "", -ENOENT},	{"empty", "", -ENOENT},
		{"text.txt", "", -EBADMSG},	{"raw.grey", "", -EINVAL},
		{"raw.grey", "?format=pfm", 0}, {"pipe.jpg", "", -ESPIPE},
	};
	char path[128];

	(void)state;
	write_file("text.txt", "hello", 5);
	write_file("raw.grey", grey, 12);
	(void)snprintf(path, sizeof(path), "%s/empty", folder);
	assert_int_equal(mkdir(path, 0700), 0);
	(void)snprintf(path, sizeof(path), "%s/pipe.jpg", folder);
	assert_int_equal(mkfifo(path, 0600), 0);
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		assert_int_equal(create(cases[i].name, cases[i].query, true), 0);
		assert_int_equal(lp_source_file_ops.start(source), cases[i].ret);
		if (cases[i].ret == 0) {
			pump(64); /* it is no PFM: found when it is read */
			assert_int_equal(heard.state, LP_SOURCE_DOWN);
			assert_contains(heard.reason, "file: ");
		}
		destroy();
	}
}

static void test_truncated_frame_is_marked_corrupt(void **state)
{
	(void)state;
	write_file("a.grey", grey, 10);
	assert_int_equal(create("a.grey", "?size=2x2", true), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.count, 3);
	assert_int_equal(heard.frames[1]->flags, 0);
	assert_int_equal(heard.frames[2]->flags, LP_FRAME_CORRUPT | LP_FRAME_LAST);
	assert_int_equal(heard.frames[2]->size_bytes, 2);
}

static void test_a_broken_file_in_the_folder(void **state)
{
	(void)state;
	write_file("1.grey", "1111", 4);
	write_file("2.jpg", "this is no JPEG", 15);
	write_file("3.grey", "3333", 4);
	/* A set of which a part is missing is no set. */
	assert_int_equal(create("", "?size=2x2", true), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(64);
	assert_int_equal(heard.state, LP_SOURCE_DOWN);
	destroy();
	/* A camera that stutters goes on. */
	assert_int_equal(create("", "?size=2x2&rate=0", false), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	for (int i = 0; i < 10; i++) {
		pump(1);
		assert_int_equal(heard.frames[0]->sequence, i);
		assert_int_equal(heard.frames[0]->data[0], i % 2 ? '3' : '1');
		lp_frame_release(heard.frames[0]);
		heard.count = 0;
	}
	assert_int_equal(heard.state, LP_SOURCE_STREAMING);
}

static void test_destroy_while_frames_wait(void **state)
{
	(void)state;
	write_file("a.grey", grey, 12);
	assert_int_equal(create("a.grey", "?size=2x2&rate=0.001", false), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	/* Destroyed by teardown, with the thread asleep until long after this test. */
}

#define FILE_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

static void test_recorded_poses_go_with_the_pictures(void **state)
{
	static const char poses[] = "10 1 2 3 0 0 0 1\n10.1 2 2 3 0 1 0 0\n";
	char query[160];

	(void)state;
	write_file("a.grey", grey, 12);
	write_file("poses.txt", poses, strlen(poses));
	(void)snprintf(query, sizeof(query),
		       "?size=2x2&rate=10&pose_sigma_deg=2&poses=%s/poses.txt", folder);
	assert_int_equal(create("a.grey", query, false), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(5);
	for (int i = 0; i < 5; i++) {
		const struct lp_frame *frame = heard.frames[i];

		/* Three pictures, two poses, and again from the beginning. */
		assert_int_equal(isnan(frame->orientation[0]), i == 2);
		if (i == 2)
			continue;
		assert_true(frame->orientation[3] == (i % 3 == 0 ? 1.0F : 0.0F));
		assert_true(frame->orientation_sigma_deg == 2.0F);
		assert_true(frame->position_m[0] == (i % 3 == 0 ? 1.0 : 2.0));
		assert_true(frame->position_sigma_m == 0.01F);
	}
}

static void test_a_picture_that_cannot_be_read_shifts_no_pose(void **state)
{
	static const char poses[] = "0 1 2 3 0 0 0 1\n.1 2 2 3 0 0 0 1\n.2 3 2 3 0 0 0 1\n";
	char query[160];

	(void)state;
	write_file("1.grey", "1111", 4);
	write_file("2.grey", "", 0);
	write_file("3.grey", "3333", 4);
	write_file("poses.txt", poses, strlen(poses));
	(void)snprintf(query, sizeof(query), "?size=2x2&rate=10&poses=%s/poses.txt", folder);
	assert_int_equal(create("", query, false), 0);
	assert_int_equal(lp_source_file_ops.start(source), 0);
	pump(3);
	assert_true(heard.frames[0]->position_m[0] == 1.0);
	assert_true(heard.frames[1]->position_m[0] == 3.0);
	assert_true(heard.frames[2]->position_m[0] == 1.0);
}

static void test_poses_that_cannot_be_read_are_an_error_of_start(void **state)
{
	char query[160];

	(void)state;
	write_file("a.grey", grey, 12);
	write_file("poses.txt", "none\n", 5);
	(void)snprintf(query, sizeof(query), "?size=2x2&poses=%s/poses.txt", folder);
	assert_int_equal(create("a.grey", query, false), 0);
	assert_int_equal(lp_source_file_ops.start(source), -EBADMSG);
	destroy();
	(void)snprintf(query, sizeof(query), "?size=2x2&rate=0&poses=%s/poses.txt", folder);
	assert_int_equal(create("a.grey", query, false), -EINVAL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		FILE_TEST(test_once_gives_each_frame_and_marks_the_last),
		FILE_TEST(test_loop_repeats_and_exposures_follow_the_set),
		FILE_TEST(test_rate_paces),
		FILE_TEST(test_folder_in_name_order_other_files_left_out),
		FILE_TEST(test_numbers_in_names_count_by_value),
		FILE_TEST(test_a_photo_is_its_first_picture_and_a_stream_all_of_them),
		FILE_TEST(test_what_cannot_be_read_is_an_error_of_start),
		FILE_TEST(test_truncated_frame_is_marked_corrupt),
		FILE_TEST(test_a_broken_file_in_the_folder),
		FILE_TEST(test_destroy_while_frames_wait),
		FILE_TEST(test_recorded_poses_go_with_the_pictures),
		FILE_TEST(test_a_picture_that_cannot_be_read_shifts_no_pose),
		FILE_TEST(test_poses_that_cannot_be_read_are_an_error_of_start),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
