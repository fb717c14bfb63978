/* SPDX-License-Identifier: Apache-2.0 */
/* A hand before the lens, and what only looks like one. */
#include "vision/doubt/cover.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "lp_test.h"
#include "vision/map/residual.h"
#include "vision/map/lookup.h"
#include "vision/map/radiance_map.h"

#define WIDTH 240
#define HEIGHT 120
#define CELLS (WIDTH * HEIGHT)
/* 1 sigma of a frame's linear values in the dark. */
#define NOISE 0.0004F

static struct lp_grid *grid;
static struct lp_radiance_map *map;
static struct lp_lookup *lookup;
static float radiance[CELLS + 16][4];
static uint8_t flags[CELLS + 16];

/* A room with texture, between 0.4 and 2; per second of exposure. */
static float room(const float d[3])
{
	return 1.2F + 0.4F * sinf(9.0F * d[0]) * sinf(7.0F * d[1] + 1.0F) +
	       0.4F * sinf(11.0F * d[2] + 2.0F * d[0]);
}

static int set_up(void **state)
{
	(void)state;
	assert_int_equal(lp_grid_create(WIDTH, HEIGHT, &grid), 0);
	assert_int_equal(lp_radiance_map_create(grid, &map), 0);
	return lp_lookup_create(grid, &lookup);
}

static int tear_down(void **state)
{
	(void)state;
	lp_lookup_destroy(lookup);
	lp_radiance_map_destroy(map);
	lp_grid_destroy(grid);
	return 0;
}

/* What is known: the room. */
static int begin(void **state)
{
	(void)state;
	srand(1);
	memset(flags, 0, sizeof(flags));
	for (int i = 0; i < CELLS; i++) {
		float d[3];

		lp_grid_direction(grid, i, d);
		for (int c = 0; c < 4; c++)
			map->radiance[i][c] = room(d);
		map->flags[i] = 0;
		map->variance[i] = 1e-4F;
	}
	return 0;
}

static float noise(void)
{
	return NOISE * 3.46F * ((float)rand() / (float)RAND_MAX - 0.5F);
}

/* The camera, turned by `rotation`, sees the room times factor(d), d in its own frame; and `glow`
 * besides where that is 0. */
static struct lp_residual take(float exposure_s, float (*factor)(const float d[3]), float glow,
			       const struct lp_rotation *rotation)
{
	const bool turned = !lp_rotation_is_identity(rotation);

	for (int i = 0; i < CELLS; i++) {
		float d[3], world[3];

		lp_grid_direction(grid, i, d);
		memcpy(world, d, sizeof(world));
		lp_rotate_direction(rotation, world);
		const float f = factor(d), light = f > 0.0F ? f * room(world) : glow;

		for (int c = 0; c < 4; c++)
			radiance[i][c] = fmaxf(light + noise() / exposure_s, 0.0F);
	}
	if (turned) {
		const struct lp_rotation back = lp_rotation_inverse(rotation);

		lp_lookup_set(lookup, &back);
	}
	return (struct lp_residual){.map = map,
				    .lookup = turned ? lookup : NULL,
				    .seen = {.radiance = (const float(*)[4])radiance,
					     .flags = flags,
					     .scale = 1.0F / exposure_s}};
}

/* Its exposure is right. */
static struct lp_cover look(const struct lp_cover *before, const struct lp_residual *view)
{
	return lp_cover_look(before, view, view->seen.scale);
}

static float nothing(const float d[3])
{
	(void)d;
	return 1.0F;
}

static float right_half(const float d[3])
{
	return d[0] > 0.0F ? 0.0F : 1.0F;
}

static float dark_right(const float d[3])
{
	return d[0] > 0.0F ? 0.05F : 1.0F;
}

static float right_dim(const float d[3])
{
	return d[0] > 0.0F ? 0.01F : 1.0F;
}

static float dark(const float d[3])
{
	(void)d;
	return 0.02F;
}

static float dim_left(const float d[3])
{
	return d[0] > 0.0F ? 0.0F : 0.3F;
}

static float picture_goes_dark(const float d[3])
{
	return d[2] < -0.95F ? 0.0F : 1.0F; /* 2.5 % of the sphere */
}

static float right_tenth(const float d[3])
{
	return d[0] > 0.8F ? 0.0F : 1.0F;
}

/* Share of the sphere's right and left half that is told as covered. */
static void expect_halves(const struct lp_cover *cover, double right, double left)
{
	double share[2] = {0.0, 0.0};

	for (int i = 0; i < CELLS; i++) {
		float d[3];

		lp_grid_direction(grid, i, d);
		if (cover->near[lp_cover_block(WIDTH, i)])
			share[d[0] > 0.0F] += lp_grid_solid_angle_sr(grid, i) / (2.0 * M_PI);
	}
	assert_true(share[1] >= right);
	assert_true(share[0] <= left);
}

static const struct lp_cover open_lens;
static const struct lp_rotation *still(void)
{
	static struct lp_rotation identity;

	identity = lp_rotation_of_vector((const double[3]){0.0, 0.0, 0.0});
	return &identity;
}

static void test_a_hand_is_found_and_leaves(void **state)
{
	struct lp_residual view;
	struct lp_cover cover = open_lens;

	(void)state;
	view = take(0.2F, nothing, 0.0F, still());
	assert_false(look(&cover, &view).found);
	for (int glow = 0; glow < 2; glow++) { /* light passes through it, or none */
		view = take(0.2F, right_half, 0.03F * (float)glow, still());
		cover = look(&open_lens, &view);
		assert_true(cover.found);
		expect_halves(&cover, 0.98, 0.25);
	}
	view = take(0.2F, nothing, 0.0F, still());
	assert_false(look(&cover, &view).found);
}

/* In a dark room few cells tell: a quarter of them is bright enough, here and there. */
static void test_a_hand_is_found_by_few_cells(void **state)
{
	(void)state;
	for (int i = 0; i < CELLS; i++)
		if (rand() % 4)
			memset(map->radiance[i], 0, sizeof(map->radiance[i]));
	const struct lp_residual view = take(0.2F, right_tenth, 0.0F, still());

	for (int i = 0; i < CELLS; i++)
		if (!(map->radiance[i][LP_LUMINANCE] > 0.0F))
			memset(radiance[i], 0, sizeof(radiance[i]));
	assert_true(look(&open_lens, &view).found);
}

/* An exposure so short that the room is noise anyway says nothing of the hand. */
static void test_frames_that_do_not_tell_change_nothing(void **state)
{
	struct lp_residual view = take(0.2F, right_half, 0.0F, still());
	struct lp_cover cover = look(&open_lens, &view);

	(void)state;
	for (int n = 0; n < 100; n++) {
		view = take(0.002F, right_half, 0.0F, still());
		cover = look(&cover, &view);
		assert_false(look(&open_lens, &view).found);
	}
	assert_true(cover.found);
	expect_halves(&cover, 0.98, 0.25);
}

static void test_lights_that_go_off_are_no_hand(void **state)
{
	float (*const off[])(const float d[3]) = {dark, dark_right, picture_goes_dark};

	(void)state;
	for (int k = 0; k < 3; k++) {
		const struct lp_residual view = take(0.2F, off[k], 0.0F, still());

		assert_false(look(&open_lens, &view).found);
	}
}

/* A short exposure cannot tell them from a hand; the next long ones can. */
static void test_a_mistake_is_corrected(void **state)
{
	struct lp_residual view = take(0.01F, right_dim, 0.0F, still());
	struct lp_cover cover = look(&open_lens, &view);

	(void)state;
	assert_true(cover.found);
	for (int n = 0; n < 3; n++) {
		view = take(0.2F, right_dim, 0.0F, still());
		cover = look(&cover, &view);
	}
	assert_false(cover.found);
}

/* Nor is a much longer exposure than the frame had: all of it is dark then. */
static void test_a_wrong_exposure_is_no_hand(void **state)
{
	struct lp_residual view = take(0.02F, nothing, 0.0F, still());

	(void)state;
	assert_false(lp_cover_look(&open_lens, &view, 1.0F / 0.4F).found);
	assert_false(lp_cover_look(&open_lens, &view, 1.0F / 0.001F).found);
}

static void test_a_hand_stays_when_the_light_changes(void **state)
{
	struct lp_residual view = take(0.2F, right_half, 0.0F, still());
	const struct lp_cover cover = look(&open_lens, &view);

	(void)state;
	view = take(0.2F, dim_left, 0.0F, still());
	assert_false(look(&open_lens, &view).found);
	assert_true(look(&cover, &view).found);
}

/* The hand is the camera's: it turns with it. */
static void test_a_covered_camera_turns(void **state)
{
	struct lp_cover cover = open_lens;

	(void)state;
	for (int n = 0; n <= 6; n++) {
		const struct lp_rotation turned =
			lp_rotation_of_vector((const double[3]){0.0, 0.5 * n, 0.1 * n});
		const struct lp_residual view = take(0.2F, right_half, 0.02F, &turned);

		cover = look(&cover, &view);
		assert_true(cover.found);
		expect_halves(&cover, 0.98, 0.25);
	}
}

static void test_marks_are_set_and_cleared(void **state)
{
	const struct lp_residual view = take(0.2F, right_half, 0.0F, still());
	const struct lp_cover cover = look(&open_lens, &view);
	int marked = 0;

	(void)state;
	flags[0] = LP_CELL_CLIPPED;
	lp_cover_mark(&cover, grid, flags);
	for (int i = 0; i < CELLS; i++)
		marked += (flags[i] & LP_CELL_COVERED) != 0;
	assert_true(marked > CELLS * 0.48 && marked < CELLS * 0.65);
	lp_cover_mark(&open_lens, grid, flags);
	for (int i = 0; i < CELLS; i++)
		assert_int_equal(flags[i], i ? 0 : LP_CELL_CLIPPED);
}

/* What the map held before the hand came comes back, unless it is long ago. */
static void test_the_map_gives_back_what_it_held(void **state)
{
	struct lp_observation seen = {.radiance = (const float(*)[4])radiance,
				      .flags = flags,
				      .scale = 1.0F,
				      .elapsed_s = 0.03F};

	(void)state;
	lp_radiance_map_forget(map);
	for (int n = 0; n < 3; n++) {
		for (int i = 0; i < CELLS; i++)
			for (int c = 0; c < 4; c++)
				radiance[i][c] = n ? 0.1F / (float)n : 1.0F;
		lp_radiance_map_observe(map, &seen);
	}
	assert_float_equal(lp_radiance_map_before(map, 7, 0.5)[LP_LUMINANCE], 1.0F, 0.0F);
	lp_radiance_map_restore(map, 7, 0.5);
	assert_float_equal(map->radiance[7][LP_LUMINANCE], 1.0F, 0.0F);
	assert_float_equal(map->radiance[8][LP_LUMINANCE], 0.05F, 1e-6F);
	lp_radiance_map_restore(map, 7, 0.5); /* once */
	assert_float_equal(map->radiance[7][LP_LUMINANCE], 1.0F, 0.0F);
	seen.elapsed_s = 1.0F;
	lp_radiance_map_observe(map, &seen);
	assert_float_equal(lp_radiance_map_before(map, 8, 0.5)[LP_LUMINANCE], 0.05F, 1e-6F);
	lp_radiance_map_restore(map, 8, 0.5);
	assert_float_equal(map->radiance[8][LP_LUMINANCE], 0.05F, 1e-6F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_a_hand_is_found_and_leaves, begin),
		cmocka_unit_test_setup(test_a_hand_is_found_by_few_cells, begin),
		cmocka_unit_test_setup(test_frames_that_do_not_tell_change_nothing, begin),
		cmocka_unit_test_setup(test_lights_that_go_off_are_no_hand, begin),
		cmocka_unit_test_setup(test_a_mistake_is_corrected, begin),
		cmocka_unit_test_setup(test_a_wrong_exposure_is_no_hand, begin),
		cmocka_unit_test_setup(test_a_hand_stays_when_the_light_changes, begin),
		cmocka_unit_test_setup(test_a_covered_camera_turns, begin),
		cmocka_unit_test_setup(test_marks_are_set_and_cleared, begin),
		cmocka_unit_test_setup(test_the_map_gives_back_what_it_held, begin),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
