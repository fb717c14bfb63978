/* SPDX-License-Identifier: Apache-2.0 */
/* Detection on the grid: regions, lamps and the detectors over them. */
#include "light/find/detection.h"

#include <math.h>
#include <stdlib.h>

#include "light/math/grid.h"
#include "lp_test.h"
#include "scene.h"

#define WIDTH 240

struct fixture {
	struct lp_grid *grid;
	struct lp_panorama panorama;
	struct lp_detection *detection;
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

static float mean_of(const struct fixture *f)
{
	double sum = 0.0;

	for (int i = 0; i < WIDTH * WIDTH / 2; i++)
		sum += (double)f->panorama.cells[i][3] * lp_grid_solid_angle_sr(f->grid, i);
	return (float)(sum / (4.0 * M_PI));
}

static const struct lp_lamp_finder *detect(struct fixture *f, const struct disc *discs, int count,
					   double background)
{
	fill_panorama(&f->panorama, discs, count, background);
	assert_float_equal(lp_grid_mean_luminance(f->grid, &f->panorama), mean_of(f),
			   1e-5 * mean_of(f));
	lp_detect(f->detection, &f->panorama, mean_of(f));
	return f->detection->finder;
}

static void expect(const struct lp_lamp_finder *finder, const struct disc *discs, int count,
		   double within_deg)
{
	assert_int_equal(finder->count, count);
	for (int k = 0; k < count; k++) {
		double d[3], best = 180.0;
		int nearest = 0;

		disc_direction(&discs[k], d);
		for (int j = 0; j < finder->count; j++) {
			const double a = angle_between_deg(d, finder->lamps[j].direction);

			if (a < best) {
				best = a;
				nearest = j;
			}
		}
		assert_true(best < within_deg);
		assert_float_equal(finder->lamps[nearest].irradiance[3] /
					   disc_irradiance(&discs[k]),
				   1.0, 0.05);
	}
}

static void test_lamps_anywhere(void **state)
{
	/* in front, on the seam, over both poles, beside a pole, in the corner of cells */
	const struct disc discs[] = {
		{30, 20, 4, 50},  {180, 0, 3, 60},  {-179.5, 40, 2, 100},   {0, 90, 5, 40},
		{77, -88, 3, 60}, {10, 86, 2, 100}, {45.75, 30.75, 1, 300},
	};

	for (unsigned int k = 0; k < LP_COUNT(discs); k++)
		expect(detect(*state, &discs[k], 1, 0.2), &discs[k], 1, 0.3);
}

static void test_several_lamps_of_unlike_strength(void **state)
{
	const struct disc discs[] = {{0, 10, 1, 2000},
				     {90, 30, 3, 40},
				     {180, 60, 7, 12},
				     {-90, -20, 2, 60}};

	expect(detect(*state, discs, 4, 0.1), discs, 4, 0.3);
}

static void test_two_lamps_close_together_stay_two(void **state)
{
	const struct disc discs[] = {{0, 0, 2, 50}, {9, 0, 2, 45}};

	expect(detect(*state, discs, 2, 0.1), discs, 2, 0.3);
}

static void test_no_lamp_in_smooth_light(void **state)
{
	struct fixture *f = *state;

	detect(f, NULL, 0, 1.0);
	assert_int_equal(f->detection->finder->count, 0);
	detect(f, NULL, 0, 0.0);
	assert_int_equal(f->detection->finder->count, 0);
	for (int i = 0; i < WIDTH * WIDTH / 2; i++) { /* a sky: bright above, dark below */
		float d[3];

		lp_grid_direction(f->grid, i, d);
		for (int c = 0; c < 4; c++)
			f->panorama.cells[i][c] = 1.0F + 0.95F * d[1];
	}
	lp_detect(f->detection, &f->panorama, mean_of(f));
	assert_int_equal(f->detection->finder->count, 0);
}

static void test_no_lamp_in_noise(void **state)
{
	struct fixture *f = *state;

	srand(7);
	for (int i = 0; i < WIDTH * WIDTH / 2; i++)
		for (int c = 0; c < 4; c++) /* the same in all channels: worse than real noise */
			f->panorama.cells[i][c] =
				c ? f->panorama.cells[i][0] : 0.5F + (float)rand() / RAND_MAX;
	lp_detect(f->detection, &f->panorama, mean_of(f));
	assert_int_equal(f->detection->finder->count, 0);
}

/* Of a sky that is all bright only the brightest tenth of the sphere is looked at; a lamp below it
 * is found all the same. */
static void test_a_bright_sky_is_not_searched(void **state)
{
	const struct disc lamp = {40, -30, 3, 500};
	struct fixture *f = *state;
	float area_sr = 0.0F;

	fill_panorama(&f->panorama, &lamp, 1, 0.1);
	for (int i = 0; i < WIDTH * WIDTH / 2; i++) {
		float d[3];

		lp_grid_direction(f->grid, i, d);
		for (int c = 0; c < 4 && d[1] > 0.5F; c++) /* a quarter of the sphere, an octave */
			f->panorama.cells[i][c] = 20.0F * d[1];
	}
	lp_detect(f->detection, &f->panorama, mean_of(f));
	for (int k = 0; k < f->detection->regions->candidate_count; k++)
		area_sr +=
			lp_grid_solid_angle_sr(f->grid, f->detection->regions->candidates[k].cell);
	assert_in_range((int)(area_sr * 100.0F), 120, 170); /* the last step is whole */
	expect(f->detection->finder, &lamp, 1, 0.3);
}

/* What is as bright all over and larger than that tenth is no lamp either; a window is. */
static void test_no_lamp_is_as_large_as_a_sky(void **state)
{
	const struct disc sky = {60, 0, 40, 10}, window = {60, 0, 30, 10};

	assert_int_equal(detect(*state, &sky, 1, 0.1)->count, 0);
	assert_true(detect(*state, &window, 1, 0.1)->count > 0);
}

/* A lamp in a hole of such a sky, two cells of the dark around it: its surround is the dark, for
 * the sky is a source of its own. */
static void test_a_sky_is_no_lamps_surround(void **state)
{
	const struct disc lamp = {0, 0, 4, 30};
	const double cell_deg = 360.0 / WIDTH, hole_deg = lamp.radius_deg + 2.0 * cell_deg;
	struct fixture *f = *state;
	double axis[3];

	disc_direction(&lamp, axis);
	for (int i = 0; i < WIDTH * WIDTH / 2; i++) {
		float d[3];

		lp_grid_direction(f->grid, i, d);
		const double apart_deg = angle_between_deg(axis, d);
		const float radiance = apart_deg < lamp.radius_deg		  ? 30.0F
				       : apart_deg > hole_deg && apart_deg < 45.0 ? 10.0F
										  : 0.1F;

		for (int c = 0; c < 4; c++)
			f->panorama.cells[i][c] = radiance;
	}
	lp_detect(f->detection, &f->panorama, mean_of(f));
	assert_int_equal(f->detection->finder->count, 1);
	assert_float_equal(f->detection->finder->lamps[0].background[3], 0.1, 1e-3);
}

/* A wide source stays one, with the ellipse that has its extent. */
static void test_a_window_is_one_ellipse(void **state)
{
	struct fixture *f = *state;
	/* side by side: three times as wide as high, tilted by 30 degrees */
	const double tilt = 30 * TEST_DEG, centre[3] = {0.0, 0.0, -1.0};
	const double along[3] = {cos(tilt), sin(tilt), 0.0};
	double flux = 0.0;

	for (int i = 0; i < WIDTH * WIDTH / 2; i++) {
		float d[3];

		lp_grid_direction(f->grid, i, d);
		const double x = d[0] * along[0] + d[1] * along[1];
		const double y = d[1] * along[0] - d[0] * along[1];
		const bool lit = d[2] < 0.0F && x * x / 9.0 + y * y < pow(sin(8 * TEST_DEG), 2);

		for (int c = 0; c < 4; c++)
			f->panorama.cells[i][c] = lit ? 10.0F : 0.1F;
		flux += lit * 9.9 * (double)lp_grid_solid_angle_sr(f->grid, i);
	}
	lp_detect(f->detection, &f->panorama, mean_of(f));
	const struct lp_lamp *lamp = &f->detection->finder->lamps[0];

	assert_int_equal(f->detection->finder->count, 1);
	assert_true(angle_between_deg(centre, lamp->direction) < 0.5);
	assert_float_equal(lamp->irradiance[3] / flux, 1.0, 0.01);
	assert_float_equal(lamp->half_angle_deg[0], asin(3 * sin(8 * TEST_DEG)) / TEST_DEG, 0.8);
	assert_float_equal(lamp->half_angle_deg[1], 8.0, 0.5);
	assert_float_equal(fabs(lamp->axis[0] * along[0] + lamp->axis[1] * along[1]), 1.0, 1e-3);
	assert_float_equal(lp_detection_width_deg(f->detection, lamp), 13.9, 0.5);
}

/* The surround is not the lamp's light: a lamp over a bright wall counts what it adds. */
static void test_irradiance_is_above_the_surround(void **state)
{
	const struct disc disc = {60, 5, 5, 9};
	const struct lp_lamp_finder *finder = detect(*state, &disc, 1, 3.0);

	expect(finder, &disc, 1, 0.2);
	assert_float_equal(finder->lamps[0].background[3], 3.0, 1e-5);
	/* cells that the rim crosses make it look larger */
	assert_float_equal(finder->lamps[0].solid_angle_sr /
				   (2.0 * M_PI * (1.0 - cos(5 * TEST_DEG))),
			   1.0, 0.15);
}

static void test_results_scale_with_the_light(void **state)
{
	const struct disc disc = {60, 5, 3, 100};
	struct fixture *f = *state;
	const struct lp_lamp reference = detect(f, &disc, 1, 1.0)->lamps[0];

	for (double scale = 1e-6; scale < 1e7; scale *= 1e3) {
		const struct disc scaled = {60, 5, 3, 100 * scale};
		const struct lp_lamp_finder *finder = detect(f, &scaled, 1, scale);

		assert_int_equal(finder->count, 1);
		for (int a = 0; a < 3; a++)
			assert_float_equal(finder->lamps[0].direction[a], reference.direction[a],
					   1e-5);
		assert_float_equal(finder->lamps[0].irradiance[3] / scale, reference.irradiance[3],
				   1e-4 * reference.irradiance[3]);
	}
}

static void test_the_published_recipe_finds_a_lamp(void **state)
{
	const struct disc disc = {30, 20, 4, 500};
	const struct lp_detector_options options[] = {
		{.detector = LP_DETECTOR_RESEARCH},
		{.detector = LP_DETECTOR_RESEARCH, .threshold = 50.0F},
	};
	struct fixture *f = *state;
	double d[3];

	disc_direction(&disc, d);
	fill_panorama(&f->panorama, &disc, 1, 0.1);
	for (unsigned int k = 0; k < LP_COUNT(options); k++) {
		struct lp_detection *detection;

		assert_int_equal(lp_detection_create(f->grid, &options[k], &detection), 0);
		lp_detect(detection, &f->panorama, mean_of(f));
		assert_true(detection->finder->count >= 1);
		assert_true(angle_between_deg(d, detection->finder->lamps[0].direction) < 1.0);
		lp_detection_destroy(detection);
	}
}

/* The published recipe takes all that is brighter than the median for lamps, or than a static
 * value: here a wall that the films would have dimmed. */
static void test_the_published_recipe_has_a_static_threshold(void **state)
{
	const struct disc discs[] = {{30, 20, 4, 500}, {-120, -30, 8, 20}};
	const float thresholds[] = {0.0F, 50.0F};
	const int expected[] = {2, 1};
	struct fixture *f = *state;

	fill_panorama(&f->panorama, discs, 2, 0.1);
	for (int k = 0; k < 2; k++) {
		const struct lp_detector_options options = {.detector = LP_DETECTOR_RESEARCH,
							    .threshold = thresholds[k]};
		struct lp_detection *detection;

		assert_int_equal(lp_detection_create(f->grid, &options, &detection), 0);
		lp_detect(detection, &f->panorama, mean_of(f));
		assert_int_equal(detection->finder->count, expected[k]);
		lp_detection_destroy(detection);
	}
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_lamps_anywhere),
		TEST(test_several_lamps_of_unlike_strength),
		TEST(test_two_lamps_close_together_stay_two),
		TEST(test_no_lamp_in_smooth_light),
		TEST(test_no_lamp_in_noise),
		TEST(test_a_bright_sky_is_not_searched),
		TEST(test_no_lamp_is_as_large_as_a_sky),
		TEST(test_a_sky_is_no_lamps_surround),
		TEST(test_a_window_is_one_ellipse),
		TEST(test_irradiance_is_above_the_surround),
		TEST(test_results_scale_with_the_light),
		TEST(test_the_published_recipe_finds_a_lamp),
		TEST(test_the_published_recipe_has_a_static_threshold),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
