/* SPDX-License-Identifier: Apache-2.0 */
/* How far away a lamp is, by sightings from a head that goes to and fro: truth is a lamp's place.
 */
#include "light/place/parallax.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "lp_test.h"
#include "random_normal.h"

#define DEG (M_PI / 180.0)
#define RATE_HZ 30
#define MEMORY_S 2.0

/* A head, and what its app errs by. */
struct story {
	bool clips; /* now and then: how strong it is is not known */
	double lamp_m[3];
	double reach_m;	 /* of the way, to each side */
	double turn_rad; /* likewise; about the vertical */
	double sigma_rad, sigma_m, late_s;
	double seconds;
	double moved_s; /* then the lamp is elsewhere; 0: never */
	bool mirrored;	/* what the app tells of x */
	/* The edge of a board that hides what is to the left of it; z 0: there is none. */
	double board_m[3];
};

static const struct story head = {.lamp_m = {0.8, 1.0, -2.0},
				  .reach_m = 0.25,
				  .turn_rad = 0.6,
				  .sigma_rad = 0.1 * DEG,
				  .sigma_m = 0.005,
				  .seconds = 10.0};

static void true_pose(const struct story *story, double t_s, struct lp_probe_pose *pose)
{
	const double yaw[3] = {0.0, story->turn_rad * sin(1.3 * t_s), 0.0};

	pose->rotation = lp_rotation_of_vector(yaw);
	pose->position_m[0] = story->reach_m * sin(1.1 * t_s);
	pose->position_m[1] = 0.3 * story->reach_m * sin(0.7 * t_s + 1.0);
	pose->position_m[2] = story->reach_m * sin(1.7 * t_s + 2.0);
}

#define LAMP_RADIUS_RAD 0.05
#define STRIPS 200

/* What a board with an upright edge leaves of the lamp, a disc: its share, and how far (radii) its
 * middle lies to the right. `edge`: where the board ends, in radii to the right of the middle. */
static double left_of_lamp(double edge, double *middle)
{
	double share = 0.0, moment = 0.0;

	for (int k = 0; k < STRIPS; k++) {
		const double x = 2.0 * (k + 0.5) / STRIPS - 1.0;
		const double area = x > edge ? 4.0 / M_PI / STRIPS * sqrt(1.0 - x * x) : 0.0;

		share += area;
		moment += area * x;
	}
	*middle = share > 0.0 ? moment / share : 0.0;
	return share;
}

/* The lamp as it is seen past the board; false: it is hidden. In the world: `here_m` to the lamp.
 */
static bool see_past(const struct story *story, const double here_m[3], double toward[3],
		     struct lp_parallax_sighting *sighting)
{
	const double far_m = sqrt(toward[0] * toward[0] + toward[2] * toward[2]);
	double middle = 0.0, share = 1.0;

	if (story->board_m[2] < 0.0) {
		const double edge =
			atan2(story->board_m[0] - here_m[0], here_m[2] - story->board_m[2]);
		const double lamp = atan2(toward[0], -toward[2]);

		share = left_of_lamp((edge - lamp) / LAMP_RADIUS_RAD, &middle);
	}
	const double right[2] = {-toward[2], toward[0]}; /* level, as long as the way */

	toward[0] += middle * LAMP_RADIUS_RAD * right[0];
	toward[2] += middle * LAMP_RADIUS_RAD * right[1];
	sighting->irradiance = (float)(share / (far_m * far_m));
	sighting->radius_rad = LAMP_RADIUS_RAD;
	return share > 0.02;
}

static void see(struct lp_parallax *p, const struct story *story, double t_s,
		const struct lp_probe_pose *told, double sigma_rad)
{
	struct lp_probe_pose here;
	double toward[3], own[3], length = 0.0;
	struct lp_parallax_sighting sighting = {.sigma_rad = (float)sigma_rad};

	true_pose(story, t_s, &here);
	const bool moved = story->moved_s > 0.0 && t_s > story->moved_s;

	for (int a = 0; a < 3; a++) {
		toward[a] = story->lamp_m[a] * (moved ? 0.7 : 1.0) - here.position_m[a];
	}
	if (!see_past(story, here.position_m, toward, &sighting))
		return;
	if (story->clips && fmod(t_s, 1.0) < 0.5)
		sighting.irradiance = 0.0F;
	for (int a = 0; a < 3; a++)
		length += toward[a] * toward[a];
	const struct lp_rotation back = lp_rotation_inverse(&here.rotation);

	lp_rotate(&back, toward, own); /* the camera's frame is the anchor frame */
	for (int a = 0; a < 3; a++)
		sighting.direction[a] =
			(float)(own[a] / sqrt(length) + sigma_rad * random_normal());
	lp_parallax_see(p, told, &sighting);
}

/* The app's pose of that time: late, and off by errors that last. */
static struct lp_probe_pose told_of(const struct story *story, double t_s, const double error[6])
{
	struct lp_probe_pose told = {.t_ns = (int64_t)(1e9 * t_s),
				     .world = 1,
				     .sigma_rad = story->sigma_rad,
				     .sigma_m = story->sigma_m,
				     .late_sigma_s = fmax(story->late_s, 0.0)};
	struct lp_probe_pose before, after;
	double vector[3];

	true_pose(story, t_s - story->late_s, &told);
	true_pose(story, t_s - 0.01, &before);
	true_pose(story, t_s + 0.01, &after);
	for (int a = 0; a < 3; a++) {
		vector[a] = story->sigma_rad * error[a];
		told.position_m[a] += story->sigma_m * error[3 + a];
		told.velocity_m_s[a] = (after.position_m[a] - before.position_m[a]) / 0.02;
	}
	if (story->mirrored)
		told.position_m[0] = -told.position_m[0];
	told.rate_rad_s[1] = story->turn_rad * 1.3 * cos(1.3 * t_s);
	const struct lp_rotation off = lp_rotation_of_vector(vector);

	told.rotation = lp_rotation_product(&off, &told.rotation);
	return told;
}

/* Lives through it; returns the true distance at its end. */
static double live(const struct story *story, struct lp_parallax *p)
{
	const double kept = exp(-1.0 / (RATE_HZ * MEMORY_S));
	double error[6], square = 0.0;
	struct lp_probe_pose here;

	for (int a = 0; a < 6; a++)
		error[a] = random_normal();
	for (int k = 0; k < (int)(story->seconds * RATE_HZ); k++) {
		const double t_s = (double)k / RATE_HZ;
		const struct lp_probe_pose told = told_of(story, t_s, error);

		see(p, story, t_s, &told, 0.02 * DEG);
		for (int a = 0; a < 6; a++)
			error[a] = kept * error[a] + sqrt(1.0 - kept * kept) * random_normal();
		true_pose(story, t_s, &here);
	}
	for (int a = 0; a < 3; a++) {
		const double d =
			story->lamp_m[a] * (story->moved_s > 0.0 ? 0.7 : 1.0) - here.position_m[a];

		square += d * d;
	}
	return sqrt(square);
}

static void test_a_head_that_moves_tells_the_distance(void **state)
{
	struct lp_parallax p = {0};

	(void)state;
	const double true_m = live(&head, &p);
	const struct lp_lamp_distance found = lp_parallax_distance(&p);

	assert_float_equal(found.distance_m, true_m, 0.15);
	assert_in_range((int)(1e4F * found.sigma), 30, 400);
	assert_true(found.nearest_m == 0.0F);
	assert_true(p.count <= LP_PARALLAX_NODES);
}

/* Over many heads: the sigma is true, with poses that are late, too. */
static void covers(const struct story *story, double most_off_m)
{
	int within_1 = 0, within_3 = 0, count = 0;
	double sum2 = 0.0;

	for (int trial = 0; trial < 60; trial++) {
		struct lp_parallax p = {0};
		const double true_m = live(story, &p);
		const struct lp_lamp_distance found = lp_parallax_distance(&p);

		assert_false(isnan(found.distance_m));
		const double off_m = fabs((double)found.distance_m - true_m);
		const double sigma_m = (double)(found.sigma * found.distance_m);

		within_1 += off_m < sigma_m;
		within_3 += off_m < 3.0 * sigma_m;
		sum2 += off_m * off_m;
		count++;
	}
	assert_in_range(100 * within_1 / count, 50, 90);
	assert_in_range(100 * within_3 / count, 98, 100);
	assert_true(sqrt(sum2 / count) < most_off_m);
}

static void test_its_sigma_is_true(void **state)
{
	struct story worse = head, late = head;

	(void)state;
	covers(&head, 0.08);
	worse.sigma_rad = 0.3 * DEG;
	worse.sigma_m = 0.01;
	covers(&worse, 0.25);
	late.late_s = 0.03;
	covers(&late, 0.10);
}

/* A board before the lamp: the middle of what is left of it moves as a nearer lamp would, or one
 * further away. */
static void test_a_lamp_that_is_hidden_in_part(void **state)
{
	struct story hidden = head;

	(void)state;
	hidden.board_m[2] = -1.0;
	for (int k = 0; k < 10; k++) { /* hides more and more of the way */
		int within_3 = 0, count = 0;

		hidden.board_m[0] = 0.30 + 0.02 * k;
		for (int trial = 0; trial < 40; trial++) {
			struct lp_parallax p = {0};
			const double true_m = live(&hidden, &p);
			const struct lp_lamp_distance found = lp_parallax_distance(&p);

			if (isnan(found.distance_m))
				continue;
			within_3 += fabs(found.distance_m - true_m) <
				    3.0 * found.sigma * found.distance_m;
			count++;
		}
		assert_true(within_3 >= 0.95 * count);
	}
}

/* A strength that is not known is not a part that is hidden. */
static void test_a_lamp_that_clips_now_and_then(void **state)
{
	struct story clipping = head;
	struct lp_parallax p = {0}, q = {0};

	(void)state;
	clipping.clips = true;
	(void)live(&head, &p);
	(void)live(&clipping, &q);
	assert_true(lp_parallax_distance(&q).sigma < 1.3F * lp_parallax_distance(&p).sigma);
}

static void test_a_head_that_only_turns_knows_nothing(void **state)
{
	struct lp_parallax p = {0};
	struct story still = head;

	(void)state;
	still.reach_m = 0.0;
	(void)live(&still, &p);
	const struct lp_lamp_distance found = lp_parallax_distance(&p);

	assert_true(isnan(found.distance_m));
	assert_true(found.nearest_m < 1.0F);
}

static void test_a_far_lamp_has_a_least_distance(void **state)
{
	struct lp_parallax p = {0};
	struct story far = head;

	(void)state;
	for (int a = 0; a < 3; a++)
		far.lamp_m[a] *= 200.0;
	(void)live(&far, &p);
	const struct lp_lamp_distance found = lp_parallax_distance(&p);

	assert_true(isnan(found.distance_m));
	assert_in_range((int)found.nearest_m, 8, 450);
}

/* What was known of its old place is forgotten, and its new one is found. */
static void test_a_lamp_that_is_carried_away(void **state)
{
	struct lp_parallax p = {0};
	struct story carried = head;

	(void)state;
	carried.moved_s = 4.0;
	carried.seconds = 5.0;
	(void)live(&carried, &p);
	assert_true(isnan(lp_parallax_distance(&p).distance_m)); /* it may go on moving */
	p = (struct lp_parallax){0};
	carried.seconds = 13.0;
	const double true_m = live(&carried, &p);
	const struct lp_lamp_distance found = lp_parallax_distance(&p);

	assert_float_equal(found.distance_m, true_m, 3.0 * found.sigma * found.distance_m);
	assert_true(p.nodes[0].t_s > 3.5);
}

/* Places in the axes of another world contradict what is seen, again and again. */
static void test_places_of_another_frame(void **state)
{
	struct story mirrored = head;
	int stated = 0;

	(void)state;
	mirrored.mirrored = true;
	for (int trial = 0; trial < 20; trial++) {
		struct lp_parallax p = {0};

		mirrored.lamp_m[trial % 3] += 0.1;
		(void)live(&mirrored, &p);
		stated += !isnan(lp_parallax_distance(&p).distance_m);
		assert_true(p.doubt > LP_PARALLAX_MOST_DOUBT);
	}
	assert_int_equal(stated, 0);
}

/* Directions of any kind, and places anywhere: nothing is known, or it has a sigma. */
static void test_nonsense_is_survived(void **state)
{
	struct lp_parallax p = {0};

	(void)state;
	for (int k = 0; k < 2000; k++) {
		struct lp_probe_pose pose = {.t_ns = k,
					     .world = 1,
					     .rotation = lp_rotation_identity(),
					     .sigma_rad = 1e-3,
					     .sigma_m = 1e-3};
		struct lp_parallax_sighting sighting = {.sigma_rad = 1e-4F};
		float *direction = sighting.direction, square = 0.0F;

		for (int a = 0; a < 3; a++) {
			pose.position_m[a] = 1e6 * random_normal();
			direction[a] = (float)random_normal();
			square += direction[a] * direction[a];
		}
		for (int a = 0; a < 3; a++)
			direction[a] /= sqrtf(square);
		sighting.irradiance = (float)exp(20.0 * random_normal());
		sighting.radius_rad = 0.1F;
		lp_parallax_see(&p, &pose, &sighting);
		const struct lp_lamp_distance found = lp_parallax_distance(&p);

		assert_true(isnan(found.distance_m) || found.sigma > 0.0F);
		assert_true(isfinite(p.inverse_per_m) && isfinite(p.sigma_per_m));
	}
}

static void test_another_world_begins_anew(void **state)
{
	struct lp_parallax p = {0};
	const double error[6] = {0};

	(void)state;
	(void)live(&head, &p);
	struct lp_probe_pose told = told_of(&head, 11.0, error);

	told.world = 2;
	see(&p, &head, 11.0, &told, 0.02 * DEG);
	assert_int_equal(p.count, 1);
	assert_true(isnan(lp_parallax_distance(&p).distance_m));
}

static void test_the_direction_follows_the_way(void **state)
{
	struct lp_parallax p = {.count = 8, .inverse_per_m = 0.5, .sigma_per_m = 0.01};
	float direction[3] = {0.0F, 0.0F, -1.0F};

	(void)state;
	float nearer;

	(void)lp_parallax_go(&p, (const double[]){1.0, 0.0, 0.0}, 0.0, direction, &nearer);
	assert_float_equal(nearer, 2.0 / sqrt(5.0), 1e-6);
	assert_float_equal(direction[0], -1.0 / sqrt(5.0), 1e-6);
	assert_float_equal(direction[2], -2.0 / sqrt(5.0), 1e-6);
	assert_float_equal(1.0 / p.inverse_per_m, sqrt(5.0), 1e-6);
	p.sigma_per_m = 0.4; /* not known well enough */
	(void)lp_parallax_go(&p, (const double[]){1.0, 0.0, 0.0}, 0.0, direction, &nearer);
	assert_true(nearer == 1.0F);
	assert_float_equal(direction[0], -1.0 / sqrt(5.0), 1e-6);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_head_that_moves_tells_the_distance),
		cmocka_unit_test(test_its_sigma_is_true),
		cmocka_unit_test(test_a_lamp_that_is_hidden_in_part),
		cmocka_unit_test(test_a_lamp_that_clips_now_and_then),
		cmocka_unit_test(test_a_head_that_only_turns_knows_nothing),
		cmocka_unit_test(test_a_far_lamp_has_a_least_distance),
		cmocka_unit_test(test_a_lamp_that_is_carried_away),
		cmocka_unit_test(test_places_of_another_frame),
		cmocka_unit_test(test_nonsense_is_survived),
		cmocka_unit_test(test_another_world_begins_anew),
		cmocka_unit_test(test_the_direction_follows_the_way),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
