/* SPDX-License-Identifier: Apache-2.0 */
/* The room around a probe that goes: truth is a box with pictures on its walls, seen by rays. */
#include "light/place/room.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "light/math/grid.h"
#include "light/math/sh.h"
#include "light/place/parallax.h"
#include "light/place/room_fit.h"
#include "lp_test.h"
#include "random_normal.h"

#define PLACES 9
#define FRAMES_BETWEEN 12
#define SAMPLES 3 /* of a cell, along each edge */

static const struct lp_box true_box = {.wall_m = {1.8, 2.6, 1.2, 1.5, 3.1, 1.6}, .yaw_rad = 0.3};

/* What stands before the camera. */
struct story {
	struct lp_box box;
	double scale;	   /* of all light */
	double reach_m;	   /* of the head's way, to each side */
	double told_scale; /* of what the app tells of it */
	bool is_far;	   /* light that does not change with place */
	bool is_mirrored;  /* what the app tells of x */
	int dark_from;	   /* places from which on one wall is darker; 0: none */
	double noise_m;
};

static const struct story usual = {.box = {.wall_m = {1.8, 2.6, 1.2, 1.5, 3.1, 1.6},
					   .yaw_rad = 0.3},
				   .scale = 1.0,
				   .reach_m = 0.25,
				   .told_scale = 1.0,
				   .noise_m = 0.005};

/* Radiance of a place of the room: waves, as wide as pictures and furniture, and walls of their
 * own. */
static double radiance(const struct story *story, int place, const double at_m[3], int wall)
{
	const double base = 0.5 + 0.15 * wall;
	const double dark = story->dark_from && place >= story->dark_from && wall < 2 ? 0.2 : 1.0;

	return story->scale * dark * base *
	       (1.0 + 0.6 * sin(4.1 * at_m[0] + 3.7 * at_m[1] + wall) * cos(3.3 * at_m[2] - wall));
}

static void picture(const struct lp_room *room, const struct story *story, int place,
		    const double from_m[3], float *cells)
{
	const double here[3] = {0.0, 0.0, 0.0};
	const struct lp_box_view view = lp_box_look(&story->box, story->is_far ? here : from_m);

	(void)room;
	for (int k = 0; k < LP_COARSE_CELLS; k++) {
		double sum = 0.0;

		for (int sample = 0; sample < SAMPLES * SAMPLES; sample++) {
			const double row =
				k / LP_COARSE_COLUMNS + (sample / SAMPLES + 0.5) / SAMPLES;
			const double column =
				k % LP_COARSE_COLUMNS + (sample % SAMPLES + 0.5) / SAMPLES;
			const double polar = M_PI * row / LP_COARSE_ROWS;
			const double turn = 2.0 * M_PI * (column / LP_COARSE_COLUMNS - 0.5);
			const double along[3] = {sin(polar) * sin(turn), cos(polar),
						 -sin(polar) * cos(turn)};
			const struct lp_box_hit hit = lp_box_hit(&view, along);

			sum += radiance(story, place, hit.at_m, hit.wall);
		}
		cells[k] = (float)(sum / (SAMPLES * SAMPLES));
	}
}

static void place_of(const struct story *story, int place, double at_m[3])
{
	at_m[0] = story->reach_m * sin(1.1 * place);
	at_m[1] = 0.4 * story->reach_m * sin(2.0 * place + 1.0);
	at_m[2] = story->reach_m * sin(1.7 * place + 2.0);
}

static struct lp_probe_pose pose_of(const struct story *story, int place)
{
	struct lp_probe_pose pose = {.t_ns = place * (int64_t)500000000,
				     .world = 1,
				     .sigma_m = 0.005};

	place_of(story, place, pose.position_m);
	for (int a = 0; a < 3; a++)
		pose.position_m[a] += story->noise_m * random_normal();
	if (story->is_mirrored)
		pose.position_m[0] = -pose.position_m[0];
	for (int a = 0; a < 3; a++)
		pose.position_m[a] *= story->told_scale;
	return pose;
}

static void go(struct lp_room *room, const struct story *story, int from, int to)
{
	float cells[LP_COARSE_CELLS];

	for (int place = from; place < to; place++) {
		const struct lp_probe_pose pose = pose_of(story, place);
		double at_m[3];

		place_of(story, place, at_m);
		picture(room, story, place, at_m, cells);
		if (lp_room_wants(room, &pose))
			lp_room_see(room, &pose, cells, cells);
		for (int k = 0; k < FRAMES_BETWEEN; k++)
			lp_room_work(room);
	}
}

static struct lp_room *room_after(const struct story *story)
{
	struct lp_room *room;

	assert_int_equal(lp_room_create(&room), 0);
	go(room, story, 0, PLACES);
	return room;
}

static void move(const struct lp_box *box, const double from_m[3], const double sh[LP_BOX_SH_COUNT],
		 double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT])
{
	static double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT];
	static struct lp_box_rays rays;

	lp_box_fill_rays(&rays);
	lp_box_look_around(&rays, box, from_m, seen);
	lp_box_move_sh(&rays, (const double(*)[LP_BOX_SH_COUNT])seen, sh, moved);
}

static const struct lp_probe_pose origin = {.t_ns = 1, .world = 1, .sigma_m = 0.005};

/* The walls that belong together, whatever quarter turn the fit has found. */
static void assert_same_box(const struct lp_room_found *found)
{
	static const int turned[4][6] = {{0, 1, 2, 3, 4, 5},
					 {5, 4, 2, 3, 0, 1},
					 {1, 0, 2, 3, 5, 4},
					 {4, 5, 2, 3, 1, 0}};
	const double quarters = (found->box.yaw_rad - true_box.yaw_rad) / (M_PI / 2.0);
	const int quarter = ((int)lround(quarters) % 4 + 4) % 4;

	assert_float_equal(quarters, round(quarters), 0.05);
	for (int w = 0; w < 6; w++) {
		const double true_m = true_box.wall_m[turned[quarter][w]];

		assert_float_equal(found->box.wall_m[w], true_m,
				   3.0 * found->wall_sigma_m[w] + 0.03 * true_m);
	}
}

static void test_the_walls_are_found(void **state)
{
	struct lp_room *room = room_after(&usual);
	struct lp_room_found found;

	(void)state;
	assert_true(lp_room_found(room, &origin, &found));
	assert_same_box(&found);
	for (int w = 0; w < 6; w++)
		assert_true(found.wall_sigma_m[w] > 0.0 && found.wall_sigma_m[w] < 0.5);
	assert_true(found.error_per_m[4] < 0.03);
	lp_room_destroy(room);
}

static void test_walls_count_from_the_probe(void **state)
{
	struct lp_room *room = room_after(&usual);
	struct lp_room_found here, there;
	struct lp_probe_pose pose = origin;

	(void)state;
	pose.position_m[1] = 0.4;
	assert_true(lp_room_found(room, &origin, &here));
	assert_true(lp_room_found(room, &pose, &there));
	assert_float_equal(there.box.wall_m[2], here.box.wall_m[2] + 0.4, 1e-9);
	assert_float_equal(there.box.wall_m[3], here.box.wall_m[3] - 0.4, 1e-9);
	pose.position_m[1] = 3.0; /* through the ceiling */
	assert_false(lp_room_found(room, &pose, &there));
	lp_room_destroy(room);
}

/* Spherical harmonics of the true room, by many rays. */
static void true_sh(const struct lp_room *room, const double from_m[3], double *sh)
{
	float cells[LP_COARSE_CELLS];

	picture(room, &usual, 0, from_m, cells);
	(void)lp_coarse_project(lp_room_grid(room), cells, sh);
}

static void test_light_is_moved_to_where_nobody_was(void **state)
{
	struct lp_room *room = room_after(&usual);
	const double there_m[3] = {0.5, -0.2, -0.6}, here_m[3] = {0.0, 0.0, 0.0};
	double here[LP_BOX_SH_COUNT], there[LP_BOX_SH_COUNT];
	double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT];
	double unchanged2 = 0.0, moved2 = 0.0;
	struct lp_room_found found;

	(void)state;
	assert_true(lp_room_found(room, &origin, &found));
	true_sh(room, here_m, here);
	true_sh(room, there_m, there);
	move(&found.box, there_m, here, moved);
	for (int i = 0; i < 9; i++) {
		const double a = lp_sh_cosine(i > 3 ? 2 : i > 0);

		unchanged2 += a * a * (here[i] - there[i]) * (here[i] - there[i]);
		moved2 += a * a * (moved[4][i] - there[i]) * (moved[4][i] - there[i]);
	}
	assert_true(moved2 < unchanged2 / 16.0);
	lp_room_destroy(room);
}

static void test_nothing_moves_at_the_probe_itself(void **state)
{
	const double here_m[3] = {0.0, 0.0, 0.0};
	double sh[LP_BOX_SH_COUNT], moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT];

	(void)state;
	for (int i = 0; i < LP_BOX_SH_COUNT; i++)
		sh[i] = sin(i + 1.0);
	move(&true_box, here_m, sh, moved);
	for (int order = 0; order < LP_BOX_ORDERS; order++)
		for (int i = 0; i < LP_BOX_SH_COUNT; i++)
			assert_float_equal(moved[order][i], sh[i], 1e-9);
}

static void assert_unknown(const struct story *story)
{
	struct lp_room *room = room_after(story);
	struct lp_room_found found;

	assert_false(lp_room_found(room, &origin, &found));
	lp_room_destroy(room);
}

static void test_a_head_that_only_turns_knows_nothing(void **state)
{
	struct story story = usual;

	(void)state;
	story.reach_m = 0.0;
	assert_unknown(&story);
}

static void test_places_of_other_axes_explain_nothing(void **state)
{
	struct story story = usual;

	(void)state;
	story.is_mirrored = true;
	struct lp_room *room = room_after(&story);
	struct lp_room_found found;

	/* if any box is better than none, it says how bad it is */
	if (lp_room_found(room, &origin, &found))
		assert_true(found.error_per_m[4] > 0.05);
	lp_room_destroy(room);
}

/* Outdoors: then the answer is that light does not change. */
static void test_far_light_does_not_move(void **state)
{
	struct story story = usual;

	(void)state;
	story.is_far = true;
	struct lp_room *room = room_after(&story);
	struct lp_room_found found;

	if (lp_room_found(room, &origin, &found)) {
		assert_true(found.error_per_m[4] < 0.02);
		for (int w = 0; w < 6; w++)
			assert_true(found.box.wall_m[w] > 5.0);
	}
	lp_room_destroy(room);
}

static void test_light_that_changes_is_not_the_room(void **state)
{
	struct story story = usual;
	struct lp_room *room = room_after(&usual);
	struct lp_room_found found;

	(void)state;
	story.dark_from = PLACES; /* from now on */
	go(room, &story, PLACES, 2 * PLACES);
	assert_true(lp_room_found(room, &origin, &found));
	assert_same_box(&found);
	assert_true(found.error_per_m[4] < 0.04);
	lp_room_destroy(room);
}

/* As of a frame in which a lamp was missed. */
static void test_one_bad_picture_does_not_decide(void **state)
{
	struct lp_room *room = room_after(&usual);
	struct lp_room_found before, after;
	float cells[LP_COARSE_CELLS];
	const struct lp_probe_pose pose = {.t_ns = 60 * (int64_t)1000000000,
					   .world = 1,
					   .sigma_m = 0.005};
	const double here_m[3] = {0.0, 0.0, 0.0};

	(void)state;
	assert_true(lp_room_found(room, &origin, &before));
	picture(room, &usual, 0, here_m, cells);
	for (int k = 0; k < 6; k++)
		cells[5 * LP_COARSE_COLUMNS + 20 + k] *= 12.0F;
	lp_room_see(room, &pose, cells, cells);
	for (int k = 0; k < 5 * FRAMES_BETWEEN; k++)
		lp_room_work(room);
	assert_true(lp_room_found(room, &origin, &after));
	assert_true(after.bare_error_per_m[4] < 2.0 * before.bare_error_per_m[4] + 0.01);
	assert_same_box(&after);
	lp_room_destroy(room);
}

static void test_another_world_begins_anew(void **state)
{
	struct lp_room *room = room_after(&usual);
	struct lp_probe_pose pose = origin;
	struct lp_room_found found;

	(void)state;
	pose.world = 2;
	assert_false(lp_room_found(room, &pose, &found));
	assert_true(lp_room_wants(room, &pose));
	lp_room_destroy(room);
}

/* The unit of light does not matter, and nonsense is left out. */
static void test_extremes(void **state)
{
	static const double scales[] = {1e-30, 1e-6, 1e6, 1e30};
	static const float nonsense[] = {NAN, INFINITY, -1.0F, 0.0F, FLT_MAX};
	struct lp_room_found found;

	(void)state;
	for (int k = 0; k < 4; k++) {
		struct story story = usual;

		story.scale = scales[k];
		struct lp_room *room = room_after(&story);

		assert_true(lp_room_found(room, &origin, &found));
		assert_same_box(&found);
		lp_room_destroy(room);
	}
	for (int k = 0; k < 5; k++) {
		struct lp_room *room;
		float cells[LP_COARSE_CELLS];

		assert_int_equal(lp_room_create(&room), 0);
		for (int i = 0; i < LP_COARSE_CELLS; i++)
			cells[i] = nonsense[k];
		for (int place = 0; place < PLACES; place++) {
			const struct lp_probe_pose pose = pose_of(&usual, place);

			lp_room_see(room, &pose, cells, cells);
			for (int i = 0; i < 3 * FRAMES_BETWEEN; i++)
				lp_room_work(room);
		}
		if (lp_room_found(room, &origin, &found))
			for (int order = 0; order < LP_BOX_ORDERS; order++)
				assert_false(isnan(found.error_per_m[order]));
		lp_room_destroy(room);
	}
}

/* Half of the sphere is never seen. */
static void test_a_part_is_not_seen(void **state)
{
	float cells[LP_COARSE_CELLS];
	struct lp_room_found found;
	struct lp_room *room;

	(void)state;
	assert_int_equal(lp_room_create(&room), 0);
	for (int place = 0; place < PLACES; place++) {
		const struct lp_probe_pose pose = pose_of(&usual, place);
		double at_m[3];

		place_of(&usual, place, at_m);
		picture(room, &usual, place, at_m, cells);
		for (int i = LP_COARSE_CELLS / 2 + 2 * LP_COARSE_COLUMNS; i < LP_COARSE_CELLS; i++)
			cells[i] = NAN;
		lp_room_see(room, &pose, cells, cells);
		for (int k = 0; k < FRAMES_BETWEEN; k++)
			lp_room_work(room);
	}
	assert_true(lp_room_found(room, &origin, &found));
	assert_float_equal(found.box.wall_m[3], true_box.wall_m[3], 0.15);
	assert_true(found.wall_sigma_m[2] > 2.0 * found.wall_sigma_m[3]); /* the floor */
	lp_room_destroy(room);
}

/* What is left over is compared with what was seen of it: else walls seen by a camera that looks
 * ahead seem more certain than they are. */
static void test_a_picture_is_worth_what_is_known_of_it(void **state)
{
	static struct lp_room_views views = {.count = 2, .middle = 0};
	struct lp_room_guess guess = {0};
	struct lp_room *room;

	(void)state;
	assert_int_equal(lp_room_create(&room), 0);
	views.grid = lp_room_grid(room);
	views.list[1].position_m[0] = 0.2;
	lp_room_weigh(&views, &guess);
	assert_float_equal(guess.worth, LP_ROOM_WORTH, 0.02 * LP_ROOM_WORTH);
	for (int i = LP_COARSE_CELLS / 2; i < LP_COARSE_CELLS; i++)
		views.list[1].cells[i] = NAN;
	lp_room_weigh(&views, &guess);
	assert_float_equal(guess.worth, LP_ROOM_WORTH / 2.0, 0.02 * LP_ROOM_WORTH);
	lp_room_destroy(room);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_walls_are_found),
		cmocka_unit_test(test_walls_count_from_the_probe),
		cmocka_unit_test(test_light_is_moved_to_where_nobody_was),
		cmocka_unit_test(test_nothing_moves_at_the_probe_itself),
		cmocka_unit_test(test_a_head_that_only_turns_knows_nothing),
		cmocka_unit_test(test_places_of_other_axes_explain_nothing),
		cmocka_unit_test(test_far_light_does_not_move),
		cmocka_unit_test(test_light_that_changes_is_not_the_room),
		cmocka_unit_test(test_one_bad_picture_does_not_decide),
		cmocka_unit_test(test_another_world_begins_anew),
		cmocka_unit_test(test_extremes),
		cmocka_unit_test(test_a_part_is_not_seen),
		cmocka_unit_test(test_a_picture_is_worth_what_is_known_of_it),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
