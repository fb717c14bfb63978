/* SPDX-License-Identifier: Apache-2.0 */
/* What samples of an orientation say of the instants between and beyond them. */
#include "light/turn/orientation_track.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define DEG (M_PI / 180.0)
#define MS INT64_C(1000000)

static struct lp_orientation_track track;

static int setup(void **state)
{
	(void)state;
	lp_orientation_track_clear(&track);
	return 0;
}

static struct lp_orientation_sample yaw(int64_t t_ns, double deg)
{
	return (struct lp_orientation_sample){.kind = LP_ATTITUDE,
					      .t_ns = t_ns,
					      .quaternion = {0.0, sin(0.5 * deg * DEG), 0.0,
							     cos(0.5 * deg * DEG)},
					      .sigma = 0.1 * DEG};
}

static void add_yaw(int64_t t_ns, double deg)
{
	const struct lp_orientation_sample sample = yaw(t_ns, deg);

	assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
}

static double yaw_deg(const struct lp_track_reading *reading)
{
	return atan2(reading->rotation.m[0][2], reading->rotation.m[2][2]) / DEG;
}

static void test_between_two_samples(void **state)
{
	struct lp_track_reading reading;

	(void)state;
	add_yaw(100 * MS, 10.0);
	add_yaw(110 * MS, 14.0);
	assert_int_equal(lp_orientation_track_at(&track, 102500 * INT64_C(1000), &reading), 0);
	assert_float_equal(yaw_deg(&reading), 11.0, 1e-9);
	assert_float_equal(sqrt(reading.variance) / DEG, 0.1, 0.01);
	assert_int_equal(lp_orientation_track_at(&track, 99 * MS, &reading), -ENODATA);
}

/* The position goes with it, straight; none where one of the two does not tell it, or where no head
 * could have gone so fast: another unit, or a world that jumps. */
static void test_positions(void **state)
{
	struct lp_orientation_sample sample = yaw(100 * MS, 10.0);
	struct lp_track_reading reading;

	(void)state;
	for (int k = 0; k < 4; k++) {
		sample.t_ns = (100 + 10 * k) * MS;
		sample.position_m[1] = k < 3 ? 1.0 + 0.01 * k : 1000.0;
		sample.position_sigma_m = 0.005;
		assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
	}
	assert_int_equal(lp_orientation_track_at(&track, 105 * MS, &reading), 0);
	assert_float_equal(reading.position_m[1], 1.005, 1e-9);
	assert_float_equal(reading.position_sigma_m, 0.005, 1e-3);
	assert_int_equal(lp_orientation_track_at(&track, 125 * MS, &reading), 0);
	assert_true(reading.position_sigma_m == 0.0);
	add_yaw(140 * MS, 10.0);
	assert_int_equal(lp_orientation_track_at(&track, 135 * MS, &reading), 0);
	assert_true(reading.position_sigma_m == 0.0);
}

/* Beyond the newest by its speed, the less certain the later its time may be. */
static void test_position_beyond_the_newest(void **state)
{
	struct lp_orientation_sample sample = yaw(100 * MS, 10.0);
	struct lp_track_reading reading;

	(void)state;
	for (int k = 0; k < 5; k++) {
		sample.t_ns = (100 + 10 * k) * MS;
		sample.position_m[0] = 0.01 * k;
		sample.position_sigma_m = 0.005;
		sample.time_sigma_s = 0.02;
		assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
	}
	assert_int_equal(lp_orientation_track_at(&track, 150 * MS, &reading), 0);
	assert_float_equal(reading.position_m[0], 0.05, 1e-9);
	assert_true(reading.position_sigma_m > 0.02);
}

/* A quaternion and its negative are the same rotation: the shorter way is taken. */
static void test_the_shorter_way(void **state)
{
	struct lp_orientation_sample negative = yaw(110 * MS, 14.0);
	struct lp_track_reading reading;

	(void)state;
	for (int i = 0; i < 4; i++)
		negative.quaternion[i] *= -1.0;
	add_yaw(100 * MS, 10.0);
	assert_int_equal(lp_orientation_track_add(&track, &negative), 0);
	assert_int_equal(lp_orientation_track_at(&track, 105 * MS, &reading), 0);
	assert_float_equal(yaw_deg(&reading), 12.0, 1e-9);
}

/* Beyond the newest sample by its rate, less and less surely, and no further than 50 ms. */
static void test_a_little_is_predicted(void **state)
{
	struct lp_track_reading reading;
	double before = 0.0;

	(void)state;
	add_yaw(100 * MS, 10.0);
	assert_int_equal(lp_orientation_track_at(&track, 105 * MS, &reading), -EAGAIN);
	for (int n = 1; n <= 5; n++)
		add_yaw((100 + 10 * n) * MS, 10.0 + n);
	for (int ahead = 0; ahead <= 50; ahead += 10) {
		assert_int_equal(lp_orientation_track_at(&track, (150 + ahead) * MS, &reading), 0);
		assert_float_equal(yaw_deg(&reading), 15.0 + 0.1 * ahead, 1e-9);
		assert_true(reading.variance > before);
		before = reading.variance;
	}
	assert_true(sqrt(before) < 3.0 * DEG);
	assert_true(sqrt(before) > 0.5 * DEG);
	assert_int_equal(lp_orientation_track_at(&track, 201 * MS, &reading), -EAGAIN);
}

/* Samples that stop and come again leave a gap of which nothing is known. */
static void test_gaps_are_not_filled(void **state)
{
	struct lp_track_reading reading;

	(void)state;
	add_yaw(100 * MS, 10.0);
	add_yaw(300 * MS, 10.0);
	assert_int_equal(lp_orientation_track_at(&track, 200 * MS, &reading), -ENODATA);
	assert_int_equal(lp_orientation_track_at(&track, 301 * MS, &reading), -EAGAIN);
	add_yaw(310 * MS, 10.0);
	assert_int_equal(lp_orientation_track_at(&track, 305 * MS, &reading), 0);
}

/* What is predicted from noisy samples is wrong by as much as it says. */
static void test_its_sigma_is_true(void **state)
{
	double squares = 0.0, stated = 0.0;

	(void)state;
	srand(1);
	for (int n = 0; n < 1000; n++) {
		struct lp_track_reading reading;

		lp_orientation_track_clear(&track);
		for (int k = 0; k < 10; k++) {
			const double noise = 0.1 * sqrt(3.0) * (2.0 * rand() / RAND_MAX - 1.0);

			add_yaw((100 + 10 * k) * MS, noise);
		}
		assert_int_equal(lp_orientation_track_at(&track, 195 * MS, &reading), 0);
		squares += yaw_deg(&reading) * yaw_deg(&reading);
		stated += reading.variance / (DEG * DEG);
	}
	assert_true(squares < 1.2 * stated && stated < 4.0 * squares);
}

/* Times that are off matter as fast as it turns. */
static void test_times_that_are_not_sure(void **state)
{
	struct lp_track_reading reading;

	(void)state;
	for (int n = 0; n < 5; n++) {
		struct lp_orientation_sample sample = yaw((100 + 10 * n) * MS, n);

		sample.time_sigma_s = 0.01;
		assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
	}
	for (int ms = 135; ms <= 145; ms += 10) {
		assert_int_equal(lp_orientation_track_at(&track, ms * MS, &reading), 0);
		assert_true(sqrt(reading.variance) > 0.99 * DEG &&
			    sqrt(reading.variance) < 1.2 * DEG);
	}
}

static void test_what_makes_no_sense_is_refused(void **state)
{
	struct lp_orientation_sample bad[6];

	(void)state;
	add_yaw(100 * MS, 0.0);
	for (int i = 0; i < 6; i++)
		bad[i] = yaw(200 * MS, 1.0);
	bad[0].quaternion[2] = NAN;
	bad[1].quaternion[3] = INFINITY;
	bad[2].quaternion[3] = 1.2;
	bad[3].quaternion[1] = bad[3].quaternion[3] = 0.0;
	bad[4].sigma = 0.0;
	bad[5].sigma = NAN;
	for (int i = 0; i < 6; i++)
		assert_int_equal(lp_orientation_track_add(&track, &bad[i]), -EINVAL);
	bad[0] = yaw(100 * MS, 1.0);
	assert_int_equal(lp_orientation_track_add(&track, &bad[0]), -ESTALE);
	assert_int_equal(track.count, 1);
}

/* A gyroscope that turns at a changing rate: its turns add up, and so does its noise. */
static void test_rates_add_up(void **state)
{
	struct lp_track_reading a, b;
	const double noise = 0.01;

	(void)state;
	for (int n = 0; n <= 400; n++) { /* more than the track holds */
		const struct lp_orientation_sample sample = {.kind = LP_TURN_RATE,
							     .t_ns = n * 2 * MS,
							     .rate_rad_s = {0.0, 1e-3 * n, 0.0},
							     .sigma = noise};

		assert_int_equal(lp_orientation_track_add(&track, &sample), 0);
	}
	assert_int_equal(lp_orientation_track_at(&track, 600 * MS, &a), 0);
	assert_int_equal(lp_orientation_track_at(&track, 700 * MS, &b), 0);
	/* the integral of 0.5 t rad/s from 0.6 s to 0.7 s */
	assert_float_equal((yaw_deg(&b) - yaw_deg(&a)) * DEG, 0.25 * (0.49 - 0.36), 1e-9);
	assert_float_equal(b.walk - a.walk, 50 * noise * noise * 0.002 * 0.002, 1e-12);
	assert_int_equal(lp_orientation_track_at(&track, 500 * MS, &a), -ENODATA);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_between_two_samples, setup),
		cmocka_unit_test_setup(test_positions, setup),
		cmocka_unit_test_setup(test_position_beyond_the_newest, setup),
		cmocka_unit_test_setup(test_the_shorter_way, setup),
		cmocka_unit_test_setup(test_a_little_is_predicted, setup),
		cmocka_unit_test_setup(test_gaps_are_not_filled, setup),
		cmocka_unit_test_setup(test_its_sigma_is_true, setup),
		cmocka_unit_test_setup(test_times_that_are_not_sure, setup),
		cmocka_unit_test_setup(test_what_makes_no_sense_is_refused, setup),
		cmocka_unit_test_setup(test_rates_add_up, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
