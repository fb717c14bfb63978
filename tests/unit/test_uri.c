/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stddef.h>

#include "base/param.h"
#include "base/uri.h"

struct fields {
	float rate_hz;
	bool loop;
	int format;
	struct lp_size size;
	struct lp_floats exposures_us;
	char name[8];
	int count, address;
};

static const char *const formats[] = {"auto", "mjpeg", "nv12", NULL};

static const struct lp_param list[] = {
	{"rate", LP_PARAM_FLOAT, offsetof(struct fields, rate_hz), .initial = "30", .max = 1000},
	{"loop", LP_PARAM_BOOL, offsetof(struct fields, loop), .initial = "1"},
	{"format", LP_PARAM_CHOICE, offsetof(struct fields, format), .initial = "auto",
	 .choices = formats},
	{"size", LP_PARAM_SIZE, offsetof(struct fields, size), .max = 16384},
	{"exposures_us", LP_PARAM_FLOATS, offsetof(struct fields, exposures_us), .min = 1,
	 .max = 1e7},
	{"name", LP_PARAM_TEXT, offsetof(struct fields, name), .initial = "none", .max = 8},
	{"count", LP_PARAM_INT, offsetof(struct fields, count), .initial = "3", .min = -5,
	 .max = 5},
	{"address", LP_PARAM_HEX, offsetof(struct fields, address), .initial = "0x2c", .min = 8,
	 .max = 0x77},
};
static const struct lp_params params = LP_PARAMS(list);

static void test_parts(void **state)
{
	struct lp_uri uri;

	(void)state;
	assert_int_equal(lp_uri_parse(&uri, "file:/a%20b/c%3F.jpg?rate=5&x=%26%3d&empty="), 0);
	assert_string_equal(uri.scheme, "file");
	assert_string_equal(uri.rest, "/a b/c?.jpg");
	assert_string_equal(uri.query, "rate=5&x=%26%3d&empty=");
	assert_int_equal(uri.key_count, 3);
	assert_string_equal(uri.keys[1].name, "x");
	assert_string_equal(uri.keys[1].value, "&=");
	assert_string_equal(uri.keys[2].value, "");

	assert_int_equal(lp_uri_parse(&uri, "stdout:"), 0);
	assert_string_equal(uri.rest, "");
	assert_string_equal(uri.query, "");
	assert_int_equal(uri.key_count, 0);

	assert_int_equal(lp_uri_parse(&uri, "tcp:[::1]:7700"), 0);
	assert_string_equal(uri.rest, "[::1]:7700");
}

static void test_faults(void **state)
{
	static const char *const bad[] = {
		"",	      ":",	     "room.jpg",  "/dev/video0", "File:a",
		"1f:a",	      "file:a%2",    "file:a%zz", "file:a\nb",	 "sim:a?b=c\x7f",
		"file:a%00b", "file:a?rate", "file:a?=5", "file:a?b=%0"};
	char longer[LP_URI_MAX_BYTES + 2];
	struct lp_uri uri;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		struct capture capture;
		int ret;

		capture_begin(&capture);
		ret = lp_uri_parse(&uri, bad[i]);
		capture_end(&capture);
		if (ret != -EINVAL)
			fail_msg("'%s' gave %d", bad[i], ret);
		assert_contains(capture.text, "parse");
	}
	memset(longer, 'a', sizeof(longer));
	memcpy(longer, "file:", 5);
	longer[LP_URI_MAX_BYTES] = '\0';
	assert_int_equal(lp_uri_parse(&uri, longer), -EINVAL);
	longer[LP_URI_MAX_BYTES - 1] = '\0';
	assert_int_equal(lp_uri_parse(&uri, longer), 0);
}

static void test_too_many_keys(void **state)
{
	char text[LP_URI_MAX_BYTES] = "file:a?";
	struct lp_uri uri;

	(void)state;
	for (int i = 0; i < LP_URI_MAX_KEYS; i++)
		strcat(text, "k=v&");
	assert_int_equal(lp_uri_parse(&uri, text), 0);
	strcat(text, "k=v");
	assert_int_equal(lp_uri_parse(&uri, text), -EINVAL);
}

static int read_into(struct fields *fields, const char *text)
{
	struct lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	memset(fields, 0, sizeof(*fields));
	return lp_uri_read(&uri, &params, fields);
}

static void test_typed_values_and_defaults(void **state)
{
	struct fields fields;

	(void)state;
	assert_int_equal(read_into(&fields, "file:a"), 0);
	assert_true(fields.rate_hz == 30 && fields.loop && fields.format == 0);
	assert_int_equal(fields.count, 3);
	assert_string_equal(fields.name, "none");
	assert_int_equal(fields.exposures_us.count, 0);

	assert_int_equal(read_into(&fields, "file:a?rate=0.5&loop=no&format=nv12&size=640x480"
					    "&exposures_us=100,1e3,20000&name=1234567&count=-5"),
			 0);
	assert_true(fields.rate_hz == 0.5F && !fields.loop && fields.format == 2);
	assert_int_equal(fields.size.width, 640);
	assert_int_equal(fields.size.height, 480);
	assert_int_equal(fields.exposures_us.count, 3);
	assert_true(fields.exposures_us.values[1] == 1000);
	assert_string_equal(fields.name, "1234567");
	assert_int_equal(fields.count, -5);
	assert_int_equal(fields.address, 0x2C);
	assert_int_equal(read_into(&fields, "file:a?address=44"), 0);
	assert_int_equal(fields.address, 44);
	assert_int_equal(read_into(&fields, "file:a?address=0x40"), 0);
	assert_int_equal(fields.address, 0x40);
}

static void test_bad_values(void **state)
{
	static const char *const bad[] = {
		"rate=",
		"rate=-1",
		"rate=1001",
		"rate=nan",
		"rate=inf",
		"rate=3x",
		"rate= 3",
		"loop=2",
		"loop=",
		"format=jpeg",
		"size=640",
		"size=640x",
		"size=x480",
		"size=0x1",
		"size=-1x1",
		"size=16385x1",
		"size=1x1x1",
		"size=1 x1",
		"exposures_us=",
		"exposures_us=1,",
		"exposures_us=,1",
		"exposures_us=1;2",
		"exposures_us=0",
		"exposures_us=1,2,3,4,5,6,7,8,9,0,1,2,3,4,5,6,7,8,9,0,1,2,3,4,5,6,7,8,9,0,1,2,3",
		"name=12345678",
		"count=6",
		"count=1.5",
		"count=99999999999999999999",
		"address=0x78",
		"address=0x7",
		"address=2c",
		"address=0x"};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		char text[128] = "file:a?";
		struct fields fields;
		struct capture capture;
		int ret;

		capture_begin(&capture);
		ret = read_into(&fields, strcat(text, bad[i]));
		capture_end(&capture);
		if (ret != -EINVAL)
			fail_msg("'%s' gave %d", bad[i], ret);
	}
}

static void test_errors_say_what_is_expected(void **state)
{
	struct fields fields;
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(read_into(&fields, "file:a?speed=3"), -EINVAL);
	assert_int_equal(read_into(&fields, "file:b?rate=x"), -EINVAL);
	assert_int_equal(read_into(&fields, "file:c?format=x"), -EINVAL);
	capture_end(&capture);
	assert_contains(capture.text,
			"error file:a?speed=3: speed: unknown key; known: rate, loop, "
			"format, size, exposures_us, name, count, address\n");
	assert_contains(capture.text, "error file:b?rate=x: rate: 'x' is not a number 0..1000\n");
	assert_contains(capture.text,
			"error file:c?format=x: format: 'x' is not auto|mjpeg|nv12\n");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_parts),
		cmocka_unit_test(test_faults),
		cmocka_unit_test(test_too_many_keys),
		cmocka_unit_test(test_typed_values_and_defaults),
		cmocka_unit_test(test_bad_values),
		cmocka_unit_test(test_errors_say_what_is_expected),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
