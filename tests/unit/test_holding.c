/* SPDX-License-Identifier: Apache-2.0 */
/* Remembered lamps keep their borders while detection draws others from panorama to panorama. */
#include "light/lamps/holding.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "light/find/detection.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"
#include "lp_test.h"
#include "scene.h"

#define WIDTH 240
#define UNIFORM_SIGMA 0.741F /* 1.4826 times the median deviation of noise up to 1 */
#define FRAME_S (1.0F / 30.0F)

struct fixture {
	struct lp_grid *grid;
	struct lp_panorama panorama;
	struct lp_detection *detection;
	struct lp_lamp_memory memory;
	float noise; /* around the discs: uniform, up to so much more or less */
	float clips; /* cells above it clip; 0: none */
};

static int set_up(void **state)
{
	const struct lp_detector_options options = {.detector = LP_DETECTOR_ADAPTIVE};
	struct fixture *f = calloc(1, sizeof(*f));

	f->panorama = new_panorama(WIDTH);
	assert_int_equal(lp_grid_create(WIDTH, WIDTH / 2, &f->grid), 0);
	assert_int_equal(lp_detection_create(f->grid, &options, &f->detection), 0);
	*state = f;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	lp_detection_destroy(f->detection);
	lp_grid_destroy(f->grid);
	free_panorama(&f->panorama);
	free(f);
	return 0;
}

/* One frame: as the pipeline does, without a camera's pixels. */
static void look(struct fixture *f, const struct disc *discs, int count, double background)
{
	const struct lp_memory_times times = {.elapsed_s = FRAME_S};
	struct lp_lamp_sighting sightings[LP_MAX_LAMPS];

	fill_panorama(&f->panorama, discs, count, background);
	for (int i = 0; i < WIDTH * WIDTH / 2; i++) {
		const float uniform = (float)((i * 2654435761U) >> 16) / 32768.0F - 1.0F;

		for (int c = 0; c < 4 && f->panorama.cells[i][3] <= (float)background; c++)
			f->panorama.cells[i][c] += f->noise * uniform;
	}
	for (int i = 0; i < WIDTH * WIDTH / 2; i++)
		f->panorama.flags[i] =
			f->clips > 0.0F && f->panorama.cells[i][3] > f->clips ? LP_CELL_CLIPPED : 0;
	const float mean = lp_grid_mean_luminance(f->grid, &f->panorama);

	lp_detect(f->detection, &f->panorama, mean);
	lp_hold_lamps(&f->memory, f->detection, &f->panorama, mean, FRAME_S);
	for (int k = 0; k < f->detection->finder->count; k++) {
		const struct lp_lamp *lamp = &f->detection->finder->lamps[k];

		sightings[k] =
			(struct lp_lamp_sighting){.on_grid = *lamp,
						  .pixels = *lamp,
						  .enters = lp_detection_enters(f->detection, lamp),
						  .width_deg = lp_detection_width_deg(f->detection,
										      lamp)};
	}
	lp_lamp_memory_update(&f->memory, sightings, f->detection->finder->count, &times);
}

static int seen(const struct fixture *f)
{
	int count = 0;

	for (int p = 0; p < LP_MAX_LAMPS; p++)
		count += f->memory.list[p].id && f->memory.list[p].seen;
	return count;
}

/* Light between two lamps comes and goes; with it they are one region for detection. */
static void test_lamps_that_melt_into_one_stay_two(void **state)
{
	const struct disc discs[] = {{0, 0, 2, 50}, {8, 0, 2, 45}, {4, 0, 3, 40}};
	struct fixture *f = *state;
	bool melted = false;

	for (int n = 0; n < 60; n++) {
		look(f, discs, n % 4 == 3 ? 3 : 2, 0.1);
		melted |= f->detection->regions->count == 1;
		assert_int_equal(f->memory.last_id, 2);
		assert_int_equal(seen(f), 2);
	}
	assert_true(melted);
}

/* A sky that is brighter than the lamp: only the sky is looked at then. The lamp is held, as strong
 * as it was. */
static void test_a_lamp_that_detection_misses_keeps_its_strength(void **state)
{
	const struct disc lamp = {30, 20, 3, 30};
	const struct disc with_sky[] = {{30, 20, 3, 30}, {180, 0, 45, 40}};
	struct fixture *f = *state;

	look(f, &lamp, 1, 0.1);
	const float strength = f->memory.list[0].on_grid.irradiance[LP_LUMINANCE];
	const int count = f->memory.list[0].on_grid.count;

	look(f, with_sky, 2, 0.1);
	assert_int_equal(f->detection->regions->count, 1);
	assert_true(f->memory.list[0].seen);
	assert_int_equal(f->memory.list[0].on_grid.count, count);
	assert_float_equal(f->memory.list[0].on_grid.irradiance[LP_LUMINANCE] / strength, 1.0,
			   0.05);
}

/* What came as clutter does, as the pieces that who walks by cuts off a window: as soon as
 * detection does not tell it apart any more it is not held. */
static void test_what_is_doubted_is_not_held(void **state)
{
	const struct disc lamps[] = {{-60, 0, 3, 40}, {30, 20, 3, 30}};
	const struct disc with_sky[] = {{-60, 0, 3, 40}, {30, 20, 3, 30}, {180, 0, 45, 40}};
	struct fixture *f = *state;

	for (int n = 0; n < 150; n++)
		look(f, lamps, 1, 0.1);
	look(f, lamps, 2, 0.1);
	assert_int_equal(seen(f), 2);
	look(f, with_sky, 3, 0.1);
	assert_true(f->memory.list[0].seen);
	assert_false(f->memory.list[1].seen);
}

static void test_a_lamp_that_is_off_is_gone(void **state)
{
	const struct disc discs[] = {{0, 0, 2, 50}, {90, 30, 3, 40}};
	struct fixture *f = *state;

	look(f, discs, 2, 0.1);
	assert_int_equal(seen(f), 2);
	look(f, discs, 1, 0.1);
	assert_int_equal(seen(f), 1);
}

/* How long two lamps must be seen that were taken for one for `known_s`, until both are found. */
static float seconds_until_two(struct fixture *f, float known_s)
{
	const struct disc one = {4, 0, 6, 20}, two[] = {{0, 0, 1.5, 120}, {8, 0, 1.5, 100}};
	int n = 0;

	for (int k = 0; k * FRAME_S < known_s; k++)
		look(f, &one, 1, 0.1);
	assert_int_equal(seen(f), 1);
	for (; n < 3 * (int)(LP_BORDERS_S / FRAME_S) && seen(f) < 2; n++)
		look(f, two, 2, 0.1);
	assert_int_equal(seen(f), 2);
	return (float)n * FRAME_S;
}

static void test_other_borders_that_last_are_taken(void **state)
{
	assert_float_equal(seconds_until_two(*state, 3.0F * LP_BORDERS_S), LP_BORDERS_S, 0.2);
}

/* In the first seconds the map is still being filled. */
static void test_borders_that_are_new_change_sooner(void **state)
{
	assert_float_equal(seconds_until_two(*state, 0.5F), 0.5, 0.2);
}

/* The cells at the rim of a lamp that clips are left out, as they may be a sun's glow. As soon as
 * it does not clip any more all of it counts, however long it has been known. */
static void test_a_lamp_that_clips_no_more_has_its_own_borders(void **state)
{
	const struct disc lamp[] = {{30, 20, 2, 30}, {30, 20, 5, 12}};
	const double strength = disc_irradiance(&lamp[0]) + disc_irradiance(&lamp[1]);
	struct fixture *f = *state;

	f->clips = 20.0F;
	for (int n = 0; n < 90; n++)
		look(f, lamp, 2, 0.1);
	assert_true(f->memory.list[0].on_grid.irradiance[LP_LUMINANCE] < 0.8 * strength);
	f->clips = 0.0F;
	look(f, lamp, 2, 0.1);
	assert_int_equal(f->memory.last_id, 1);
	assert_true(f->memory.list[0].seen);
	assert_float_equal(f->memory.list[0].on_grid.irradiance[LP_LUMINANCE] / strength, 1.0,
			   0.02);
}

/* Noise that would not let a lamp enter does not send off one that is known; more of it does. */
static void test_noise_around_a_known_lamp(void **state)
{
	const struct disc lamp_and_sky[] = {{30, 20, 5, 9.5}, {180, 0, 45, 9}};
	struct fixture *f = *state;

	look(f, lamp_and_sky, 2, 2);
	assert_int_equal(seen(f), 1); /* the sky is too large */
	for (int n = 0; n < 10; n++) {
		f->noise = 9.5F / UNIFORM_SIGMA / (n < 9 ? 4.0F : 2.5F);
		look(f, lamp_and_sky, 2, 2);
		assert_int_equal(seen(f), n < 9);
	}
}

/* What is about as wide as a lamp may be stays what it was. */
static void test_a_lamp_does_not_become_an_area_light_by_noise(void **state)
{
	struct fixture *f = *state;

	for (int n = 0; n < 40; n++) {
		const double change = n % 2 ? 0.7 : -0.7;
		const struct disc discs[] = {{0, 0, 6.2 + change, 50}, {120, 0, 8.0 + change, 50}};

		look(f, discs, 2, 0.1);
		assert_int_equal(f->memory.last_id, 2);
		assert_int_equal(seen(f), 2);
		assert_true(f->memory.list[0].wide != f->memory.list[1].wide);
	}
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_lamps_that_melt_into_one_stay_two),
		TEST(test_a_lamp_that_detection_misses_keeps_its_strength),
		TEST(test_what_is_doubted_is_not_held),
		TEST(test_a_lamp_that_is_off_is_gone),
		TEST(test_other_borders_that_last_are_taken),
		TEST(test_borders_that_are_new_change_sooner),
		TEST(test_a_lamp_that_clips_no_more_has_its_own_borders),
		TEST(test_noise_around_a_known_lamp),
		TEST(test_a_lamp_does_not_become_an_area_light_by_noise),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
