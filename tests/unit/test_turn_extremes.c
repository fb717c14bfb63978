/* SPDX-License-Identifier: Apache-2.0 */
/* Orientation at its ends: half turns, poses at which angles lose their meaning, 10^4 degrees a
 * second, 49 days without a frame. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "figure.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "light/turn/imu.h"
#include "light/turn/motion.h"
#include "light/turn/orientation_track.h"
#include "random_normal.h"

#define DEG (M_PI / 180.0)
#define MANY 1000000
#define DAYS_49_S (49.0 * 86400.0)

static const double odd[] = {NAN, INFINITY, -INFINITY, 0.0, -1.0, 1e-320, 1e-30, 1e30, 1e200};

/* Radians between two rotations, by their matrices: nothing of quaternions. */
static double apart_rad(const struct lp_rotation *a, const struct lp_rotation *b)
{
	double square = 0.0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			square += (a->m[i][j] - b->m[i][j]) * (a->m[i][j] - b->m[i][j]);
	return 2.0 * asin(fmin(sqrt(square / 8.0), 1.0));
}

/* Rodrigues' formula in long double. */
static struct lp_rotation exactly(const double axis[3], long double angle)
{
	const long double c = cosl(angle), s = sinl(angle);
	struct lp_rotation r;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++) {
			const int k = 3 - i - j;
			const long double sign = (j - i + 3) % 3 == 1 ? -1.0L : 1.0L;

			r.m[i][j] = (double)((1.0L - c) * axis[i] * axis[j] +
					     (i == j ? c : sign * s * axis[k % 3]));
		}
	return r;
}

static void any_axis(double axis[3])
{
	double square = 0.0;

	for (int a = 0; a < 3; a++) {
		axis[a] = (double)random_normal();
		square += axis[a] * axis[a];
	}
	for (int a = 0; a < 3; a++)
		axis[a] /= sqrt(square);
}

/* ---------------------------------------------------------------- rotations */

/* There and back by vector and quaternion: by nothing, a hair, a half turn and a hair less or more.
 */
static void test_half_turns(void **state)
{
	static const double angles[] = {0.0,	     1e-300,	  1e-12,	1e-8,
					M_PI / 2.0,  M_PI - 1e-8, M_PI - 1e-15, M_PI,
					M_PI + 1e-8, 2.0 * M_PI,  1000.0};
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < 300; trial++)
		for (size_t k = 0; k < LP_COUNT(angles); k++) {
			double axis[3] = {trial == 0, trial == 1, trial == 2}, vector[3], back[3],
			       q[4];

			if (trial > 2)
				any_axis(axis);
			for (int a = 0; a < 3; a++)
				vector[a] = angles[k] * axis[a];
			const struct lp_rotation truth = exactly(axis, angles[k]);
			const struct lp_rotation r = lp_rotation_of_vector(vector);

			lp_rotation_vector(&r, back);
			lp_rotation_quaternion(&r, q);
			const struct lp_rotation by_vector = lp_rotation_of_vector(back);
			const struct lp_rotation by_quaternion = lp_rotation_of_quaternion(q);
			const double length =
				sqrt(back[0] * back[0] + back[1] * back[1] + back[2] * back[2]);

			worst = fmax(worst, apart_rad(&r, &truth) / fmax(1.0, angles[k]));
			worst = fmax(worst, apart_rad(&r, &by_vector));
			worst = fmax(worst, apart_rad(&r, &by_quaternion));
			assert_true(length <= M_PI * (1.0 + 1e-15));
			for (int i = 0; i < 4; i++)
				assert_true(isfinite(q[i]));
		}
	figure("orientation", "0 … half turns … 1000 rad, vector and quaternion", "angle, rad",
	       worst, 1e-14);
}

static void test_a_million_turns(void **state)
{
	struct lp_rotation r = lp_rotation_identity();
	const double axis[3] = {0.6, 0.0, 0.8};
	const struct lp_rotation step = exactly(axis, 0.001L);

	(void)state;
	for (int n = 0; n < MANY; n++)
		r = lp_rotation_product(&r, &step);
	const struct lp_rotation truth = exactly(axis, 0.001L * MANY);
	double worst = 0.0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++) {
			double product = 0.0;

			for (int k = 0; k < 3; k++)
				product += r.m[i][k] * r.m[j][k];
			worst = fmax(worst, fabs(product - (i == j)));
		}
	figure("orientation", "1e6 products", "not orthonormal by", worst, 1e-15 * 10.0);
	figure("orientation", "1e6 products", "angle, rad", apart_rad(&r, &truth), 1e-9);
}

static void test_harmonics_by_half_turns(void **state)
{
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < 20; trial++) {
		double axis[3];

		any_axis(axis);
		const struct lp_rotation half = exactly(axis, acosl(-1.0L));
		float sh[LP_SH_MAX_COUNT][3], before[LP_SH_MAX_COUNT][3];
		double square = 0.0;

		for (int i = 0; i < LP_SH_MAX_COUNT; i++)
			for (int c = 0; c < 3; c++) {
				before[i][c] = random_normal();
				square += before[i][c] * before[i][c];
			}
		memcpy(sh, before, sizeof(sh));
		lp_sh_rotate(&half, LP_SH_MAX_ORDER, sh);
		lp_sh_rotate(&half, LP_SH_MAX_ORDER, sh); /* there and back */
		for (int i = 0; i < LP_SH_MAX_COUNT; i++)
			for (int c = 0; c < 3; c++)
				worst = fmax(worst,
					     fabs((double)sh[i][c] - before[i][c]) / sqrt(square));
	}
	figure("orientation", "SH of order 8, two half turns", "coefficient, relative", worst,
	       1e-6);
}

/* ---------------------------------------------------------------- what a sensor tells */

/* 10^4 degrees a second by a gyroscope of 1 kHz. */
static void test_a_fast_gyroscope(void **state)
{
	const double rate = 1e4 * DEG;
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < 20; trial++) {
		struct lp_orientation_track track = {0};
		struct lp_track_reading from, to;
		double axis[3];

		any_axis(axis);
		for (int n = 0; n <= 200; n++) {
			const struct lp_orientation_sample sample = {
				.kind = LP_TURN_RATE,
				.t_ns = 1 + n * INT64_C(1000000),
				.rate_rad_s = {rate * axis[0], rate * axis[1], rate * axis[2]},
				.sigma = 1e-3};

			assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
		}
		assert_int_equal(lp_orientation_track_at(&track, 1 + 100500000, &from), 0);
		assert_int_equal(lp_orientation_track_at(&track, 1 + 190250000, &to), 0);
		const struct lp_rotation back = lp_rotation_inverse(&from.rotation);
		const struct lp_rotation turn = lp_rotation_product(&back, &to.rotation);
		const struct lp_rotation truth = exactly(axis, (long double)rate * 0.08975L);

		worst = fmax(worst, apart_rad(&turn, &truth));
	}
	figure("orientation", "gyroscope, 1e4 °/s at 1 kHz, 0.09 s", "angle, rad", worst, 1e-6);
}

/* Head poses that look straight up or down, whose signs flip, as fast as the head can turn. */
static void test_poses_at_the_zenith(void **state)
{
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < 200; trial++) {
		const double to_zenith[3] = {(trial % 2 ? 1.0 : -1.0) * M_PI / 2.0, 0.0, 0.0};
		const struct lp_rotation up = lp_rotation_of_vector(to_zenith);
		struct lp_orientation_track track = {0};
		struct lp_track_reading reading;
		double axis[3];

		any_axis(axis);
		for (int n = 0; n < 60; n++) {
			const struct lp_rotation by = exactly(axis, (n - 30) * 0.02L);
			const struct lp_rotation r = lp_rotation_product(&up, &by);
			struct lp_orientation_sample sample = {.kind = LP_ATTITUDE,
							       .t_ns = 1 + n * INT64_C(10000000),
							       .sigma = 1e-3};

			lp_rotation_quaternion(&r, sample.quaternion);
			for (int i = 0; n % 2 && i < 4; i++)
				sample.quaternion[i] = -sample.quaternion[i];
			assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
		}
		assert_int_equal(lp_orientation_track_at(&track, 1 + 305000000, &reading), 0);
		const struct lp_rotation by = exactly(axis, 0.01L);
		const struct lp_rotation truth = lp_rotation_product(&up, &by);

		worst = fmax(worst, apart_rad(&reading.rotation, &truth));
	}
	figure("orientation", "poses through the zenith, quaternions of both signs", "angle, rad",
	       worst, 1e-12);
}

static void test_odd_samples(void **state)
{
	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 7; field++) {
			struct lp_orientation_track track = {0};
			struct lp_track_reading reading;

			for (int n = 0; n < 20; n++) {
				struct lp_orientation_sample s = {.kind = field == 6 ? LP_TURN_RATE
										     : LP_ATTITUDE,
								  .t_ns = 1 + n * INT64_C(10000000),
								  .quaternion = {0.0, 0.0, 0.0,
										 1.0},
								  .sigma = 1e-3,
								  .position_sigma_m = 1e-3};
				double *const fields[] = {&s.quaternion[1], &s.quaternion[3],
							  &s.sigma,	    &s.time_sigma_s,
							  &s.position_m[0], &s.position_sigma_m,
							  &s.rate_rad_s[0]};

				if (n == 10)
					*fields[field] = odd[o];
				(void)lp_orientation_track_add(&track, &s);
			}
			for (int64_t t_ns = 1; t_ns < 220000000; t_ns += 3000000) {
				if (lp_orientation_track_at(&track, t_ns, &reading) != 0)
					continue;
				assert_false(isnan(reading.variance) || isnan(reading.walk));
				assert_false(isnan(reading.position_sigma_m));
				for (int i = 0; i < 9; i++)
					if (!isfinite(reading.rotation.m[i / 3][i % 3]))
						fail_msg("field %d, %g: no rotation", field,
							 odd[o]);
				for (int a = 0; reading.position_sigma_m > 0.0 && a < 3; a++)
					assert_true(isfinite(reading.position_m[a]));
			}
		}
}

/* ---------------------------------------------------------------- the filter */

static void assert_motion(const struct lp_motion *m)
{
	for (int i = 0; i < 6; i++) {
		for (int j = 0; j < 6; j++)
			if (!isfinite(m->covariance[i][j]))
				fail_msg("covariance %d %d is %g", i, j, m->covariance[i][j]);
		if (m->covariance[i][i] < 0.0)
			fail_msg("variance %d is %g", i, m->covariance[i][i]);
	}
	for (int i = 0; i < 9; i++)
		assert_true(isfinite(m->rotation.m[i / 3][i % 3]));
}

/* The largest of what the covariance lacks of being one: not symmetric, or correlated by more than
 * 1. */
static double not_a_covariance(const struct lp_motion *m)
{
	double worst = 0.0;

	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++) {
			const double size = sqrt(m->covariance[i][i] * m->covariance[j][j]);

			worst = fmax(worst, fabs(m->covariance[i][j] - m->covariance[j][i]) / size);
			worst = fmax(worst, fabs(m->covariance[i][j]) / size - 1.0);
		}
	return worst;
}

/* 10^6 frames: some blind, some that tell of one axis alone, some that are told by an IMU. */
static void test_a_million_frames(void **state)
{
	struct lp_motion motion;
	double worst = 0.0;

	(void)state;
	lp_motion_init(&motion);
	motion.turning = true;
	for (int n = 0; n < MANY / 4; n++) {
		const double strong = n % 7 == 0 ? 1e10 : 1e6;
		double information[3][3] = {{0.0}}, turn[3] = {0.0, 1e-5, -1e-5};

		if (n % 5 == 4)
			lp_motion_predict_turn(&motion, 1.0 / 30.0, turn, 1e-4);
		else
			lp_motion_predict(&motion, n % 1000 == 999 ? 0.0 : 1.0 / 30.0);
		for (int a = 0; n % 3 && a < (n % 11 ? 3 : 1); a++)
			information[a][a] = strong;
		lp_motion_correct(&motion, turn, (const double(*)[3])information);
		if (n % 100 == 0) {
			assert_motion(&motion);
			worst = fmax(worst, not_a_covariance(&motion));
		}
	}
	figure("orientation", "rotation filter, 2.5e5 frames", "covariance off by, relative", worst,
	       1e-6);
}

static void test_odd_motions(void **state)
{
	static const double elapsed_s[] = {0.0, 1e-9, 1.0 / 30.0, 1.0, DAYS_49_S};
	static const double tells[] = {0.0, 1e-6, 1e6, 1e12, 1e30};

	(void)state;
	for (int e = 0; e < 5; e++)
		for (int k = 0; k < 5; k++)
			for (int told = 0; told < 2; told++) {
				const double turn[3] = {M_PI, 1e-9, -0.1};
				double information[3][3] = {{0.0}};
				struct lp_motion motion;

				lp_motion_init(&motion);
				motion.turning = true;
				for (int n = 0; n < 20; n++) {
					if (told)
						lp_motion_predict_turn(&motion, elapsed_s[e], turn,
								       1e-4);
					else
						lp_motion_predict(&motion, elapsed_s[e]);
					for (int a = 0; a < 3; a++)
						information[a][a] = tells[(k + a * (n % 2)) % 5];
					lp_motion_correct(&motion, turn,
							  (const double(*)[3])information);
					assert_motion(&motion);
				}
				const double shown =
					lp_motion_shown_turn_rad((const double(*)[3])information);

				assert_true(isfinite(shown) && shown > 0.0);
			}
}

/* Frames whose times step, and IMUs that tell from far off: numbers stay numbers. */
static void test_clocks_of_an_imu(void **state)
{
	static const double steps_s[] = {-2.0, -1e-9, 0.0, -DAYS_49_S, DAYS_49_S, 1e18};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(steps_s); k++) {
		struct lp_imu imu = {0};
		struct lp_motion motion;

		lp_motion_init(&motion);
		for (int n = 0; n < 50; n++) {
			const double vector[3] = {0.0, 0.02 * n, 0.0};
			const struct lp_imu_sample sample = {.known = true,
							     .by = 1,
							     .rotation =
								     lp_rotation_of_vector(vector),
							     .sigma_rad = 1e-3};

			motion.rotation = sample.rotation;
			lp_imu_compare(&imu, &sample, &motion, 0.0, n == 20 ? steps_s[k] : 0.03);
			for (int i = 0; i < 9; i++)
				if (!isfinite(imu.world.m[i / 3][i % 3]))
					fail_msg("a step of %g s: no rotation", steps_s[k]);
			assert_true(isfinite(lp_imu_delay_sigma_rad(&imu, 1e4 * DEG)));
		}
		assert_false(imu.left_out);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_half_turns),
		cmocka_unit_test(test_a_million_turns),
		cmocka_unit_test(test_harmonics_by_half_turns),
		cmocka_unit_test(test_a_fast_gyroscope),
		cmocka_unit_test(test_poses_at_the_zenith),
		cmocka_unit_test(test_odd_samples),
		cmocka_unit_test(test_a_million_frames),
		cmocka_unit_test(test_odd_motions),
		cmocka_unit_test(test_clocks_of_an_imu),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
