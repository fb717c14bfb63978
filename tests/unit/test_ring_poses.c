/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "light/ring_poses.h"
#include "lp_test.h"

#define SECOND 1000000000LL

static struct lp_rotation yaw(double deg)
{
	const double vector[3] = {0.0, deg * M_PI / 180.0, 0.0};

	return lp_rotation_of_vector(vector);
}

static void keep(struct lp_ring_poses *poses, double yaw_deg, double t_s)
{
	const struct lp_rotation to_panorama = yaw(yaw_deg);
	const struct lp_ring_sample sample = {.t_ns = (int64_t)(t_s * (double)SECOND)};

	lp_ring_poses_keep(poses, &to_panorama, &sample);
}

static void test_poses_are_apart(void **state)
{
	struct lp_ring_poses poses = {0};

	(void)state;
	for (int frame = 0; frame < 90; frame++) /* 30 degrees per second */
		keep(&poses, frame, 1.0 + frame / 30.0);
	assert_int_equal(poses.count, 4); /* 0, 23, 46 and 69 degrees */
	assert_float_equal(lp_ring_pose_age_s(&poses.list[0], 4 * SECOND), 0.7F, 1e-4F);
}

static void test_a_camera_at_rest_keeps_its_newest_reading(void **state)
{
	const struct lp_rotation here = yaw(0.0), elsewhere = yaw(30.0);
	struct lp_ring_poses poses = {0};

	(void)state;
	for (int frame = 0; frame < 100; frame++)
		keep(&poses, 0.0, 1.0 + frame / 30.0);
	assert_int_equal(poses.count, 1);
	/* the last one came at 4.3 s; it is renewed once a second */
	assert_float_equal(lp_ring_pose_age_s(&poses.list[0], 43 * SECOND / 10), 0.3F, 0.01F);
	assert_false(lp_ring_pose_counts(&poses.list[0], &here, 5 * SECOND));
	assert_true(lp_ring_pose_counts(&poses.list[0], &elsewhere, 5 * SECOND));
	assert_false(lp_ring_pose_counts(&poses.list[0], &elsewhere, 15 * SECOND));
}

static void test_the_oldest_makes_room(void **state)
{
	struct lp_ring_poses poses = {0};

	(void)state;
	for (int p = 0; p < LP_RING_POSES + 2; p++)
		keep(&poses, 24.0 * p, 1.0 + p);
	assert_int_equal(poses.count, LP_RING_POSES);
	assert_int_equal(poses.list[0].sample.t_ns, (LP_RING_POSES + 2) * SECOND);
	lp_ring_poses_forget(&poses);
	assert_int_equal(poses.count, 0);
	keep(&poses, 0.0, 0.0); /* a reading without a time */
	assert_int_equal(poses.count, 0);
}

static void test_poses_turn_with_the_frame_of_reference(void **state)
{
	const struct lp_rotation turn = yaw(40.0), there = yaw(40.0), before = yaw(0.0);
	struct lp_ring_poses poses = {0};

	(void)state;
	keep(&poses, 0.0, 1.0);
	lp_ring_poses_turn(&poses, &turn);
	assert_false(lp_ring_pose_counts(&poses.list[0], &there, 2 * SECOND));
	assert_true(lp_ring_pose_counts(&poses.list[0], &before, 2 * SECOND));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_poses_are_apart),
		cmocka_unit_test(test_a_camera_at_rest_keeps_its_newest_reading),
		cmocka_unit_test(test_the_oldest_makes_room),
		cmocka_unit_test(test_poses_turn_with_the_frame_of_reference),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
