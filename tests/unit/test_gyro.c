/* SPDX-License-Identifier: Apache-2.0 */
/* A gyroscope's offset is found at rest, and only there. */
#include "drivers/orientation/gyro.h"

#include <errno.h>
#include <math.h>

#include "lp_test.h"
#include "random_normal.h"

#define DEG (M_PI / 180.0)
#define RATE_HZ 100

/* Feed `seconds` of rates from `t_s` on, in degrees per second; gives the last one, less offset. */
static double feed(struct lp_gyro *gyro, double t_s, double seconds, double swing, double offset,
		   double sigma)
{
	double rate[3] = {0};

	for (int k = 0; k < (int)(seconds * RATE_HZ); k++) {
		const double now_s = t_s + (double)k / RATE_HZ;

		for (int a = 0; a < 3; a++)
			rate[a] = DEG * (offset * (a + 1) + sigma * random_normal() +
					 swing * sin(2.0 * now_s));
		assert_true(lp_gyro_rate(gyro, (int64_t)(now_s * 1e9), rate));
	}
	return rate[0];
}

static void test_rest_tells_the_offset_and_the_noise(void **unused)
{
	struct lp_gyro gyro = {0};

	(void)unused;
	feed(&gyro, 1.0, 0.5, 0.0, 0.7, 0.1);
	assert_false(gyro.is_known);
	assert_float_equal(gyro.sigma_rad_s, 3.0 * DEG, 1e-9);
	feed(&gyro, 1.5, 3.0, 0.0, 0.7, 0.1);
	assert_true(gyro.is_known);
	for (int a = 0; a < 3; a++)
		assert_float_equal(gyro.offset_rad_s[a], 0.7 * (a + 1) * DEG, 0.05 * DEG);
	assert_float_equal(gyro.sigma_rad_s, 0.1 * DEG, 0.05 * DEG);
	assert_float_equal(feed(&gyro, 4.5, 0.1, 0.0, 0.7, 0.0), 0.0, 0.05 * DEG);
}

static void test_motion_teaches_nothing(void **unused)
{
	struct lp_gyro gyro = {0};

	(void)unused;
	feed(&gyro, 0.0, 10.0, 40.0, 0.7, 0.1);
	assert_false(gyro.is_known);
	feed(&gyro, 10.0, 2.5, 0.0, 0.7, 0.1);
	assert_true(gyro.is_known);
	const double before = gyro.offset_rad_s[0];

	feed(&gyro, 12.5, 10.0, 40.0, 0.7, 0.1);
	assert_float_equal(gyro.offset_rad_s[0], before, 1e-12);
}

/* A steady turn of 2 degrees per second is none of the offset, once that is known. */
static void test_a_steady_turn_is_no_offset(void **unused)
{
	struct lp_gyro gyro = {0};

	(void)unused;
	feed(&gyro, 0.0, 2.5, 0.0, 0.0, 0.1);
	feed(&gyro, 2.5, 10.0, 0.0, 2.0, 0.1);
	assert_float_equal(gyro.offset_rad_s[0], 0.0, 0.05 * DEG);
	/* What drifts with temperature is followed. */
	feed(&gyro, 12.5, 20.0, 0.0, 0.2, 0.1);
	assert_float_equal(gyro.offset_rad_s[0], 0.2 * DEG, 0.03 * DEG);
}

static void test_a_steady_turn_at_the_start_is_none_either(void **unused)
{
	struct lp_gyro gyro = {0};

	(void)unused;
	feed(&gyro, 0.0, 5.0, 0.0, 12.0, 0.1);
	assert_false(gyro.is_known);
	assert_float_equal(gyro.sigma_rad_s, 3.0 * DEG, 1e-9);
}

static void test_gaps_and_bad_numbers(void **unused)
{
	struct lp_gyro gyro = {0};
	double bad[3] = {0.0, NAN, 0.0};

	(void)unused;
	for (int k = 0; k < 20; k++)
		feed(&gyro, 2.0 * k, 0.3, 0.0, 0.5, 0.1); /* never a second on end */
	assert_false(gyro.is_known);
	const struct lp_gyro before = gyro;

	assert_false(lp_gyro_rate(&gyro, (int64_t)100e9, bad));
	assert_memory_equal(&gyro, &before, sizeof(gyro));
}

static void test_mount_matrices(void **unused)
{
	double m[3][3] = {{0}};

	(void)unused;
	assert_int_equal(lp_gyro_parse_mount("0, -1, 0; 1, 0, 0; 0, 0, 1", m), 0);
	assert_float_equal(m[0][1], -1.0, 0.0);
	assert_float_equal(m[1][0], 1.0, 0.0);
	assert_int_equal(lp_gyro_parse_mount("0.7071,0.7071,0;-0.7071,0.7071,0;0,0,1\n", m), 0);
	assert_int_equal(lp_gyro_parse_mount("1, 0, 0; 0, 1, 0; 0, 0, -1", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("2, 0, 0; 0, 1, 0; 0, 0, 1", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("0, 0, 0; 0, 0, 0; 0, 0, 0", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("nan, 0, 0; 0, 1, 0; 0, 0, 1", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("1, 0, 0; 0, 1, 0; 0, 0", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("1, 0, 0; 0, 1, 0; 0, 0, 1, 5", m), -EINVAL);
	assert_int_equal(lp_gyro_parse_mount("", m), -EINVAL);
	assert_float_equal(m[0][1], 0.7071, 1e-12); /* as the last good one left it */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_rest_tells_the_offset_and_the_noise),
		cmocka_unit_test(test_motion_teaches_nothing),
		cmocka_unit_test(test_a_steady_turn_is_no_offset),
		cmocka_unit_test(test_a_steady_turn_at_the_start_is_none_either),
		cmocka_unit_test(test_gaps_and_bad_numbers),
		cmocka_unit_test(test_mount_matrices),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
