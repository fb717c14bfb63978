/* SPDX-License-Identifier: Apache-2.0 */
/* Recorded poses: both forms, what is between, and what is no pose. */
#include "lp_test.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "drivers/source/file/pose_file.h"

static char path[] = "/tmp/lp-poses-XXXXXX";
static struct lp_pose_file *file;

static int setup(void **state)
{
	const int fd = mkstemp(path);

	(void)state;
	return fd < 0 ? -1 : close(fd);
}

static int forget(void **state)
{
	(void)state;
	lp_pose_file_destroy(file);
	file = NULL;
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	return remove(path);
}

static int read_text(const char *text)
{
	FILE *stream = fopen(path, "w");

	assert_non_null(stream);
	assert_true(fputs(text, stream) >= 0);
	assert_int_equal(fclose(stream), 0);
	return lp_pose_file_read(path, &file);
}

static void assert_pose(double t_s, double x_m, double turn_rad)
{
	float xyzw[4];
	double position_m[3];

	assert_true(lp_pose_file_at(file, t_s, xyzw, position_m));
	assert_true(fabs(position_m[0] - x_m) < 1e-5);
	assert_true(fabs(position_m[1] - 2.0) < 1e-9 && fabs(position_m[2] - 3.0) < 1e-9);
	assert_true(fabs(2.0 * atan2((double)xyzw[1], (double)xyzw[3]) - turn_rad) < 1e-3);
	assert_true(xyzw[0] == 0.0F && xyzw[2] == 0.0F);
}

static void test_tums_form(void **state)
{
	(void)state;
	assert_int_equal(read_text("# timestamp tx ty tz qx qy qz qw\n"
				   "1403636579.70 1 2 3 0 0 0 1\n"
				   "\n"
				   "1403636579.80 2 2 3 0 0.0998334 0 0.9950042\n"),
			 0);
	assert_pose(0.0, 1.0, 0.0);
	assert_pose(0.05, 1.5, 0.1);
	assert_pose(0.1, 2.0, 0.2);
}

static void test_eurocs_form_with_more_columns(void **state)
{
	(void)state;
	assert_int_equal(read_text(
				 "1403636579700000000,1,2,3,1,0,0,0,9,9,9\r\n"
				 "1403636579800000000, 2, 2, 3, -0.9950042, 0, -0.0998334, 0\r\n"),
			 0);
	assert_pose(0.05, 1.5, 0.1); /* a quaternion and its opposite are one rotation */
}

static void test_nothing_is_known_beyond_the_ends_and_in_gaps(void **state)
{
	float xyzw[4];
	double position_m[3];

	(void)state;
	assert_int_equal(read_text("0 1 2 3 0 0 0 1\n1 2 2 3 0 0 0 1\n1.1 3 2 3 0 0 0 1\n"), 0);
	assert_pose(0.0, 1.0, 0.0);
	assert_pose(1.0, 2.0, 0.0);
	assert_false(lp_pose_file_at(file, 0.5, xyzw, position_m));
	assert_false(lp_pose_file_at(file, -0.1, xyzw, position_m));
	assert_false(lp_pose_file_at(file, 1.2, xyzw, position_m));
}

static void test_one_pose_is_of_one_moment(void **state)
{
	float xyzw[4];
	double position_m[3];

	(void)state;
	assert_int_equal(read_text("5 1 2 3 0 0 0 1"), 0);
	assert_pose(0.0, 1.0, 0.0);
	assert_false(lp_pose_file_at(file, 0.01, xyzw, position_m));
}

static void test_many_poses(void **state)
{
	char text[1 << 16];
	size_t size = 0;

	(void)state;
	for (int i = 0; i < 1500; i++)
		size += (size_t)snprintf(text + size, sizeof(text) - size, "%.3f %d 2 3 0 0 0 1\n",
					 i / 100.0, i);
	assert_int_equal(read_text(text), 0);
	for (int i = 0; i < 1499; i++)
		assert_pose((i + 0.25) / 100.0, i + 0.25, 0.0);
}

static void test_what_is_no_pose_is_refused(void **state)
{
	static const char *const wrong[] = {
		"",
		"# only a comment\n",
		"hello\n",
		"0 1 2 3 0 0 0\n",
		"0 1 2 3 0 0 0 1 9\n",
		"0,1,2,3,1,0,0\n",
		"0 1 2 3 0 0 0 2\n",
		"0 1 2 3 0 0 0 0\n",
		"0 nan 2 3 0 0 0 1\n",
		"0 inf 2 3 0 0 0 1\n",
		"nan 1 2 3 0 0 0 1\n",
		"0 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 1\n",
		"1 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 1\n",
		"0 1 2 3 0 0 0 1\n1,1,2,3,1,0,0,0\n",
		"0 1-2 3 0 0 0 1 1\n",
		"0 1 2 3 1e999 0 0 1\n",
	};

	(void)state;
	for (size_t i = 0; i < sizeof(wrong) / sizeof(*wrong); i++) {
		assert_int_equal(read_text(wrong[i]), -EBADMSG);
		assert_null(file);
	}
	assert_int_equal(lp_pose_file_read("/no/such/file", &file), -ENOENT);
	assert_int_equal(lp_pose_file_read("/tmp", &file), -EISDIR);
	assert_int_equal(lp_pose_file_read("/dev/zero", &file), -ESPIPE);
	assert_int_equal(remove(path), 0);
	assert_int_equal(mkfifo(path, 0600), 0);
	assert_int_equal(lp_pose_file_read(path, &file), -ESPIPE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_teardown(test_tums_form, forget),
		cmocka_unit_test_teardown(test_eurocs_form_with_more_columns, forget),
		cmocka_unit_test_teardown(test_nothing_is_known_beyond_the_ends_and_in_gaps,
					  forget),
		cmocka_unit_test_teardown(test_one_pose_is_of_one_moment, forget),
		cmocka_unit_test_teardown(test_many_poses, forget),
		cmocka_unit_test_teardown(test_what_is_no_pose_is_refused, forget),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
