/* SPDX-License-Identifier: Apache-2.0 */
/* Readings of other poses: which are kept, and what they tell. */
#include <math.h>

#include "light/ring/ring_poses.h"
#include "lp_test.h"
#include "ring_room.h"

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

/* Readings from all around, each a second older than the one before. */
static void look_around(struct room *room, struct lp_ring_past *past, unsigned int *seed)
{
	past->count = LP_RING_POSES - 1;
	for (int p = 0; p < past->count; p++) {
		const struct lp_rotation turned = yaw(360.0 * (p + 1) / LP_RING_POSES);

		past->list[p].sample = look(room, &turned, &past->list[p].view, seed);
		past->list[p].age_s = (float)(p + 1);
	}
}

/* Two lamps that one look hardly tells apart. */
static void test_a_turn_tells_lamps_apart(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	double alone = 0.0, with_past = 0.0;
	int within_3 = 0;
	unsigned int seed = 11;

	add_disc(room, 20.0F, 30.0F, 2.0F, 900.0F);
	add_disc(room, 50.0F, 10.0F, 2.0F, 300.0F);
	for (int trial = 0; trial < TRIALS; trial++) {
		struct lp_ring_past past;
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;

		look_around(room, &past, &seed);
		const struct lp_ring_sample sample = look(room, &none, &view, &seed);
		const float truth = true_excess(room, &room->parts->list[0]);

		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		alone += pow(fusion.excess[0] - truth, 2.0);
		lp_ring_fuse(&view, &sample, &past, &known, &fusion);
		assert_false(fusion.changed);
		with_past += pow(fusion.excess[0] - truth, 2.0);
		within_3 += fabsf(fusion.excess[0] - truth) < 3.0F * fusion.sigma[0];
	}
	assert_true(with_past < 0.25 * alone);
	assert_true(within_3 >= TRIALS * 98 / 100);
}

static void test_other_light_is_not_averaged(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_past past;
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 12;

	add_disc(room, 20.0F, 30.0F, 2.0F, 900.0F);
	look_around(room, &past, &seed);
	add_disc(room, 20.0F, 30.0F, 2.0F, 600.0F);
	const struct lp_ring_sample sample = look(room, &none, &view, &seed);
	const float truth = true_excess(room, &room->parts->list[0]);

	lp_ring_fuse(&view, &sample, &past, &known, &fusion);
	assert_true(fusion.changed);
	assert_float_equal(fusion.excess[0], truth, 0.1F * truth);
}

static void test_a_ring_that_is_turned_since_then(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	struct lp_ring_past past;
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	unsigned int seed = 14;

	add_disc(room, 20.0F, 40.0F, 4.0F, 300.0F);
	add_disc(room, 100.0F, 10.0F, 4.0F, 100.0F);
	look_around(room, &past, &seed);
	const struct lp_ring_sample straight = look(room, &none, &view, &seed);
	const struct lp_ring_sample turned = turned_by(&straight, 2);

	lp_ring_fuse(&view, &turned, &past, &known, &fusion);
	assert_true(fusion.changed);
	assert_int_equal(fusion.verdict, LP_RING_TURNED);
	assert_float_equal(fusion.turned_deg, 90.0F, 0.0F);
	/* and when it was so before, too */
	for (int p = 0; p < past.count; p++)
		past.list[p].sample = turned_by(&past.list[p].sample, 2);
	lp_ring_fuse(&view, &turned, &past, &known, &fusion);
	assert_false(fusion.changed);
	assert_int_equal(fusion.verdict, LP_RING_TURNED);
}

/* Of noisy readings some look as if the ring were turned; those before tell that it is not. */
static void test_noise_is_no_turned_ring(void **state)
{
	struct room *room = *state;
	const struct lp_rotation none = lp_rotation_identity();
	double worst = 0.0;
	unsigned int seed = 15;

	add_disc(room, 20.0F, 30.0F, 30.0F, 8.0F);
	add_disc(room, -150.0F, 30.0F, 4.0F, 300.0F);
	for (int trial = 0; trial < TRIALS; trial++) {
		struct lp_ring_past past;
		struct lp_ring_view view;
		struct lp_ring_fusion fusion;
		double found = 0.0, truth = 0.0;

		look_around(room, &past, &seed);
		const struct lp_ring_sample sample = look_with(room, &none, 0.2F, &view, &seed);

		lp_ring_fuse(&view, &sample, &past, &known, &fusion);
		for (int j = 0; j < view.count; j++) {
			found += fusion.excess[j];
			truth += true_excess(room, &room->parts->list[j]);
		}
		worst = fmax(worst, fabs(found / truth - 1.0));
	}
	assert_true(worst < 0.12); /* 0.2 if it were taken for turned */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_poses_are_apart),
		cmocka_unit_test(test_a_camera_at_rest_keeps_its_newest_reading),
		cmocka_unit_test(test_the_oldest_makes_room),
		cmocka_unit_test(test_poses_turn_with_the_frame_of_reference),
		TEST(test_a_turn_tells_lamps_apart),
		TEST(test_other_light_is_not_averaged),
		TEST(test_a_ring_that_is_turned_since_then),
		TEST(test_noise_is_no_turned_ring),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
