/* SPDX-License-Identifier: Apache-2.0 */
/* An IMU that tells how the camera turns: used while it agrees with the pictures, and no longer. */
#include "light/turn/imu.h"

#include <math.h>
#include <stdlib.h>

#include "light/turn/motion.h"
#include "lp_test.h"

#define DEG (M_PI / 180.0)
#define FRAME_S (1.0 / 30.0)

static struct lp_imu imu;
static struct lp_motion motion; /* what the pictures show */
static double parallax_rad;	/* of the camera's way, 1 sigma */
static int frame;

static int setup(void **state)
{
	(void)state;
	srand(1);
	imu = (struct lp_imu){0};
	lp_motion_init(&motion);
	parallax_rad = 0.0;
	frame = 0;
	return 0;
}

static struct lp_rotation yaw(double deg)
{
	return lp_rotation_of_vector((const double[]){0.0, deg * DEG, 0.0});
}

static double noise(double sigma_deg)
{
	return sigma_deg * sqrt(3.0) * (2.0 * rand() / RAND_MAX - 1.0) * DEG;
}

/* The frame of reference of the IMU is turned about some axis against the anchor frame. */
static struct lp_rotation its_world(void)
{
	return lp_rotation_of_vector((const double[]){0.4, -1.1, 0.7});
}

/* One frame: the camera is at yaw_deg, and the IMU says `told_deg` besides a fixed rotation. */
static void tell(double yaw_deg, double told_deg)
{
	const double off[3] = {noise(0.1), noise(0.1), noise(0.1)};
	const struct lp_rotation world = its_world(), off_by = lp_rotation_of_vector(off);
	const struct lp_rotation told = yaw(told_deg), noisy = lp_rotation_product(&told, &off_by);
	struct lp_imu_sample now = {.known = true, .sigma_rad = 0.1 * DEG};

	now.rotation = lp_rotation_product(&world, &noisy);
	motion.rotation = yaw(yaw_deg);
	motion.turning = true;
	lp_imu_compare(&imu, &now, &motion, parallax_rad, FRAME_S);
	imu.last = now;
	frame++;
}

/* Like a head: 40 degrees to either side. */
static double head_deg(double t_s)
{
	return 40.0 * sin(M_PI * t_s);
}

static void test_one_that_agrees_is_believed(void **state)
{
	(void)state;
	for (int n = 0; n < 600; n++) {
		motion.rate[1] = 40.0 * M_PI * cos(M_PI * frame * FRAME_S) * DEG;
		tell(head_deg(frame * FRAME_S), head_deg(frame * FRAME_S));
		assert_false(imu.left_out);
	}
}

/* Its turns are told in the camera's frame, whatever its own frame of reference is. */
static void test_its_turns(void **state)
{
	struct lp_imu_sample now = {.known = true, .sigma_rad = 0.1 * DEG};
	const struct lp_rotation world = its_world(), there = yaw(5.0);
	double turn[3], sigma;

	(void)state;
	assert_false(lp_imu_turn(&imu, &now, turn, &sigma));
	imu.last = (struct lp_imu_sample){.known = true, .rotation = world, .sigma_rad = 0.1 * DEG};
	now.rotation = lp_rotation_product(&world, &there);
	assert_true(lp_imu_turn(&imu, &now, turn, &sigma));
	assert_float_equal(turn[1] / DEG, 5.0, 1e-9);
	assert_float_equal(hypot(turn[0], turn[2]), 0.0, 1e-9);
	assert_float_equal(sigma / DEG, 0.1 * sqrt(2.0), 1e-3);
	now.known = false;
	assert_false(lp_imu_turn(&imu, &now, turn, &sigma));
	now.known = true;
	lp_imu_contradict(&imu);
	assert_false(lp_imu_turn(&imu, &now, turn, &sigma));
}

/* A jump of its frame of reference: out at once, and in again when its frame is known anew. */
static void test_one_that_jumps_is_left_out_for_a_while(void **state)
{
	int out = 0;

	(void)state;
	for (int n = 0; n < 90; n++)
		tell(20.0 * frame * FRAME_S, 20.0 * frame * FRAME_S);
	tell(20.0 * frame * FRAME_S, 20.0 * frame * FRAME_S + 10.0);
	assert_true(imu.left_out);
	while (imu.left_out && out++ < 600)
		tell(20.0 * frame * FRAME_S, 20.0 * frame * FRAME_S + 10.0);
	assert_true(out > 45 && out < 300);
}

/* A head that goes to and fro sees the room turn, by some degrees within a second: that is no
 * contradiction where its way is told. */
static void test_the_way_of_a_head(void **state)
{
	(void)state;
	for (int known = 1; known >= 0; known--) {
		(void)setup(state);
		parallax_rad = known ? 2.0 * DEG : 0.0;
		for (int n = 0; n < 300; n++)
			tell(head_deg(frame * FRAME_S) + 4.0 * sin(2.0 * M_PI * frame * FRAME_S),
			     head_deg(frame * FRAME_S));
		assert_true(imu.left_out == !known);
	}
}

static void check_it_is_found_out(double (*told_deg)(double t_s), double (*true_deg)(double t_s),
				  double most_s)
{
	int frames = 0;

	while (!imu.left_out && frames++ < 600)
		tell(true_deg(frame * FRAME_S), told_deg(frame * FRAME_S));
	assert_true(frames * FRAME_S < most_s);
}

static double late_deg(double t_s)
{
	return head_deg(t_s - 0.1);
}

static double drifting_deg(double t_s)
{
	return 3.0 * t_s;
}

static double still_deg(double t_s)
{
	(void)t_s;
	return 0.0;
}

static void test_one_that_is_late_is_found_out(void **state)
{
	(void)state;
	check_it_is_found_out(late_deg, head_deg, 1.0);
}

static void test_one_that_drifts_is_found_out(void **state)
{
	(void)state;
	check_it_is_found_out(drifting_deg, still_deg, 2.0);
}

static double constant_deg(double t_s)
{
	return 100.0 * t_s;
}

static double sigma_deg(double rate_deg_s)
{
	return lp_imu_delay_sigma_rad(&imu, rate_deg_s * DEG) / DEG;
}

static void turn_like(double (*true_deg)(double t_s), double late_s, int frames)
{
	for (int n = 0; n < frames; n++) {
		const double t_s = frame * FRAME_S;

		motion.rate[1] = (true_deg(t_s + 1e-4) - true_deg(t_s - 1e-4)) / 2e-4 * DEG;
		tell(true_deg(t_s), true_deg(t_s - late_s));
	}
}

/* One that is always as late looks like one in another world, while the rate stays. The sigma
 * covers that until the rate changes; then it tells how late it is. */
static void test_how_late_it_is(void **state)
{
	(void)state;
	for (int n = 0; n < 2; n++) /* it turns already, and pictures do not show that at once */
		tell(0.0, 100.0 * frame * FRAME_S);
	turn_like(constant_deg, 0.1, 300);
	assert_false(imu.left_out);
	assert_true(3.0 * sigma_deg(100.0) > 10.0);
	setup(NULL);
	turn_like(head_deg, 0.0, 300);
	assert_false(imu.left_out);
	assert_true(sigma_deg(100.0) < 0.5);
	assert_true(sigma_deg(0.0) == 0.0);
	setup(NULL);
	turn_like(head_deg, 0.005, 300);
	assert_false(imu.left_out);
	assert_float_equal(sigma_deg(100.0), 0.5, 0.2);
}

/* A new anchor frame is no contradiction. */
static void test_the_anchor_frame_changes(void **state)
{
	const struct lp_rotation before = yaw(60.0);

	(void)state;
	for (int n = 0; n < 30; n++)
		tell(60.0, 60.0);
	lp_imu_anchor(&imu, &before);
	for (int n = 0; n < 30; n++) {
		tell(0.0, 60.0);
		assert_false(imu.left_out);
	}
}

/* A camera that seems to hold still before a bare wall: that it turns is told, before what is told
 * counts as a contradiction; noise is no turn. */
static void test_a_turn_that_pictures_do_not_show(void **state)
{
	const struct lp_rotation world = its_world(), still = yaw(20.0);
	struct lp_imu_sample now = {.known = true, .sigma_rad = 0.1 * DEG};
	double turn[3], sigma_rad, told_deg = 20.0;
	struct lp_rotation told;

	(void)state;
	for (int n = 0; n < 60; n++)
		tell(20.0, 20.0);
	for (int n = 0; n < 100; n++) {
		told_deg += 0.05;
		told = yaw(told_deg);
		now.rotation = lp_rotation_product(&world, &told);
		if (lp_imu_turn_unseen(&imu, &now, &still, turn, &sigma_rad))
			break;
	}
	assert_true(told_deg > 20.5 && told_deg < 21.3);
	assert_float_equal(turn[1] / DEG, told_deg - 20.0, 0.1);
	assert_false(lp_imu_is_apart(&still, &told, now.sigma_rad, 0.0));
	lp_imu_contradict(&imu);
	assert_false(lp_imu_turn_unseen(&imu, &now, &still, turn, &sigma_rad));
}

/* What is told pulls a rotation to itself, by what it weighs. */
static void test_a_rotation_is_held_to_what_is_told(void **state)
{
	const struct lp_rotation world = its_world(), told = yaw(22.0);
	struct lp_imu_sample now = {.known = true, .sigma_rad = 0.1 * DEG};
	double pull[3], information[3][3], v[3];

	(void)state;
	assert_false(lp_imu_pull(&imu, &now, &told, pull, information)); /* no world yet */
	for (int n = 0; n < 60; n++)
		tell(20.0, 20.0);
	now.rotation = lp_rotation_product(&world, &told);
	assert_true(lp_imu_pull(&imu, &now, &motion.rotation, pull, information));
	for (int a = 0; a < 3; a++)
		assert_float_equal(pull[a] / information[a][a] / DEG, a == 1 ? 2.0 : 0.0, 0.1);
	for (int n = 0; n < 3; n++)
		lp_motion_predict_turn(&motion, FRAME_S, (const double[]){0.0, 0.0, 0.0},
				       5.0 * DEG);
	lp_motion_correct_by_landmarks(&motion, pull, (const double(*)[3])information);
	lp_rotation_vector(&motion.rotation, v);
	assert_float_equal(v[1] / DEG, 22.0, 0.3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_one_that_agrees_is_believed, setup),
		cmocka_unit_test_setup(test_its_turns, setup),
		cmocka_unit_test_setup(test_one_that_jumps_is_left_out_for_a_while, setup),
		cmocka_unit_test_setup(test_the_way_of_a_head, setup),
		cmocka_unit_test_setup(test_one_that_is_late_is_found_out, setup),
		cmocka_unit_test_setup(test_one_that_drifts_is_found_out, setup),
		cmocka_unit_test_setup(test_how_late_it_is, setup),
		cmocka_unit_test_setup(test_the_anchor_frame_changes, setup),
		cmocka_unit_test_setup(test_a_turn_that_pictures_do_not_show, setup),
		cmocka_unit_test_setup(test_a_rotation_is_held_to_what_is_told, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
