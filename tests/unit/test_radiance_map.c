/* SPDX-License-Identifier: Apache-2.0 */
/* What observations make of a map; and how a turned picture is found on it. */
#include "vision/map/radiance_map.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "light/turn/shear.h"
#include "lp_test.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"
#include "vision/map/lookup.h"
#include "vision/turn/alignment.h"

#define WIDTH 240
#define HEIGHT 120
#define CELLS (WIDTH * HEIGHT)
#define DEG (M_PI / 180.0)

static struct lp_grid *grid;
static struct lp_radiance_map *map;
static struct lp_lookup *lookup;
static struct lp_alignment *alignment;
static struct lp_response response;
static float radiance[CELLS + 16][4];
static uint8_t flags[CELLS + 16];
static float step2[CELLS + 16];

static int set_up(void **state)
{
	struct lp_camera *camera;

	(void)state;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	lp_response_init(&response, camera);
	lp_camera_destroy(camera);
	assert_int_equal(lp_grid_create(WIDTH, HEIGHT, &grid), 0);
	assert_int_equal(lp_radiance_map_create(grid, &map), 0);
	assert_int_equal(lp_lookup_create(grid, &lookup), 0);
	return lp_alignment_create(grid, &alignment);
}

static int tear_down(void **state)
{
	(void)state;
	lp_alignment_destroy(alignment);
	lp_lookup_destroy(lookup);
	lp_radiance_map_destroy(map);
	lp_grid_destroy(grid);
	return 0;
}

static int begin(void **state)
{
	(void)state;
	lp_radiance_map_forget(map);
	memset(flags, 0, sizeof(flags));
	srand(1);
	return 0;
}

static struct lp_observation picture(float scale)
{
	return (struct lp_observation){.radiance = (const float(*)[4])radiance,
				       .flags = flags,
				       .response = &response,
				       .scale = scale,
				       .coded = true,
				       .code_variance = 0.3F,
				       .elapsed_s = 1.0F / 30.0F};
}

static void fill(float value)
{
	for (int i = 0; i < CELLS; i++)
		for (int c = 0; c < 4; c++)
			radiance[i][c] = value;
}

static float noise(void)
{
	return (float)rand() / (float)RAND_MAX - 0.5F;
}

static void test_nothing_is_known_at_first(void **state)
{
	struct lp_observation seen = picture(1.0F);

	(void)state;
	fill(0.3F);
	flags[100] = LP_CELL_UNSEEN;
	const struct lp_map_update update = lp_radiance_map_observe(map, &seen);

	assert_float_equal(map->radiance[0][1], 0.3F, 1e-6F);
	assert_int_equal(map->flags[0], 0);
	assert_int_equal(map->flags[100], LP_CELL_UNSEEN);
	assert_float_equal(update.changed, 0.0F, 0.0F); /* what was not known has not changed */
	assert_true(update.unseen_fraction > 0.0F && update.unseen_fraction < 1e-3F);
	assert_true(map->variance[0] < 0.01F * 0.3F);
	assert_true(map->variance[100] >= LP_VARIANCE_UNKNOWN);
}

/* Noise is averaged; the variance says how well. */
static void test_noise_is_averaged(void **state)
{
	double before = 0.0, after = 0.0, stated = 0.0;

	(void)state;
	for (int n = 0; n < 60; n++) {
		struct lp_observation seen = picture(1.0F);

		for (int i = 0; i < CELLS; i++)
			for (int c = 0; c < 4; c++) /* 3 %: what a camera's frames are trusted to */
				radiance[i][c] = 0.2F * (1.0F + 0.03F * 3.46F * noise());
		assert_true(lp_radiance_map_observe(map, &seen).changed < 0.001F);
	}
	for (int i = 0; i < CELLS; i++) {
		before += pow(radiance[i][LP_LUMINANCE] - 0.2, 2.0) / CELLS;
		after += pow(map->radiance[i][LP_LUMINANCE] - 0.2, 2.0) / CELLS;
		stated += map->variance[i] / CELLS;
	}
	assert_true(after < 0.5 * before);
	assert_true(after < 2.0 * stated && stated < 4.0 * after);
}

/* A change of light is there at once, in every channel, and is told. */
static void test_a_change_is_taken_at_once(void **state)
{
	struct lp_observation seen = picture(1.0F);

	(void)state;
	fill(0.2F);
	for (int n = 0; n < 30; n++)
		lp_radiance_map_observe(map, &seen);
	for (int i = 0; i < CELLS / 2; i++)
		for (int c = 0; c < 4; c++)
			radiance[i][c] = 0.4F;
	const struct lp_map_update update = lp_radiance_map_observe(map, &seen);

	assert_float_equal(map->radiance[10][0], 0.4F, 1e-6F);
	assert_float_equal(map->radiance[CELLS - 10][0], 0.2F, 1e-6F);
	assert_float_equal(update.changed, 0.1F / 0.3F, 0.01F);
}

/* Frames of a room of light 0.2, until it is well known; then one in which a twentieth of the
 * sphere is `changed`, and all else `elsewhere`. */
static struct lp_map_update change(float changed, float elsewhere)
{
	const struct lp_observation seen = picture(1.0F);

	fill(0.2F);
	for (int n = 0; n < 30; n++)
		lp_radiance_map_observe(map, &seen);
	fill(elsewhere);
	for (int r = 0; r < HEIGHT; r++)
		for (int c = 0; c < WIDTH / 20; c++)
			for (int k = 0; k < 4; k++)
				radiance[r * WIDTH + c][k] = changed;
	return lp_radiance_map_observe(map, &seen);
}

/* Who walks by changes the cells that they hide, and none beside; another exposure's error, as of
 * any frame, counts no more than before. */
static void test_who_walks_by_leaves_the_other_cells_as_they_are(void **state)
{
	const int other = CELLS / 2 + WIDTH / 2;

	(void)state;
	for (int dark = 0; dark < 2; dark++) {
		const struct lp_map_update update = change(dark ? 0.01F : 0.6F, 0.204F);

		assert_true(update.changed > 0.04F);
		assert_false(update.unsettled);
		assert_float_equal(map->radiance[other - WIDTH / 2][LP_LUMINANCE],
				   dark ? 0.01F : 0.6F, 1e-6F);
		assert_true(map->radiance[other][LP_LUMINANCE] < 0.2025F);
		lp_radiance_map_forget(map);
	}
}

/* A lamp that is switched lights all of the room, by less than any cell tells alone. */
static void test_a_lamp_that_is_switched_lights_the_other_cells(void **state)
{
	const int other = CELLS / 2 + WIDTH / 2;

	(void)state;
	for (int off = 0; off < 2; off++) {
		const float elsewhere = off ? 0.18F : 0.22F;
		const struct lp_map_update update = change(off ? 0.01F : 0.6F, elsewhere);

		assert_true(update.unsettled);
		assert_float_equal(map->radiance[other][LP_LUMINANCE], elsewhere, 0.005F);
		lp_radiance_map_forget(map);
	}
}

/* A clipped cell is a lower bound. */
static void test_clipped_cells_bound_from_below(void **state)
{
	struct lp_observation longer = picture(1.0F), shorter = picture(100.0F);

	(void)state;
	fill(0.9F);
	memset(flags, LP_CELL_CLIPPED, CELLS);
	struct lp_map_update update = lp_radiance_map_observe(map, &longer);

	assert_float_equal(update.clipped_fraction, 1.0F, 1e-4F);
	assert_float_equal(update.clipped_share, 1.0F, 1e-4F);
	fill(20.0F); /* a shorter exposure tells */
	memset(flags, 0, CELLS);
	update = lp_radiance_map_observe(map, &shorter);
	assert_float_equal(update.clipped_fraction, 0.0F, 0.0F);
	assert_float_equal(map->radiance[5][1], 20.0F, 1e-4F);
	fill(0.9F); /* and the longer one takes nothing of that back */
	memset(flags, LP_CELL_CLIPPED, CELLS);
	for (int n = 0; n < 30; n++)
		update = lp_radiance_map_observe(map, &longer);
	assert_float_equal(map->radiance[5][1], 20.0F, 1e-4F);
	assert_int_equal(map->flags[5], 0);
	fill(60.0F); /* until the bound is above what was known */
	update = lp_radiance_map_observe(map, &shorter);
	assert_float_equal(map->radiance[5][1], 60.0F, 1e-4F);
	assert_int_equal(map->flags[5], LP_CELL_CLIPPED);
	assert_true(update.changed > 0.5F);
	fill(0.1F); /* the lamp is off */
	memset(flags, 0, CELLS);
	lp_radiance_map_observe(map, &longer);
	assert_float_equal(map->radiance[5][1], 0.1F, 1e-6F);
	assert_int_equal(map->flags[5], 0);
}

/* Of a turned picture: the cells look in the wrong place by so much, 1 sigma. */
static struct lp_observation misplaced(float scale, float sigma)
{
	struct lp_observation seen = picture(scale);

	for (int i = 0; i < CELLS; i++)
		step2[i] = sigma * sigma;
	seen.place_variance = step2;
	return seen;
}

/* Every cell is known to be so bright. */
static void know(float value, float scale)
{
	const struct lp_observation seen = picture(scale);

	memset(flags, 0, CELLS);
	fill(value);
	for (int n = 0; n < 30; n++)
		lp_radiance_map_observe(map, &seen);
	memset(flags, LP_CELL_CLIPPED, CELLS);
}

/* Frames that misplace the light of a clipped lamp do not add up in the cell beside it, until
 * nothing else has been seen of the cell for some seconds. */
static void test_misplaced_bounds_do_not_add_up(void **state)
{
	struct lp_observation seen;

	(void)state;
	know(20.0F, 100.0F);
	seen = misplaced(100.0F, 10.0F);
	for (int n = 0; n < 240; n++) {
		fill(20.0F + 10.0F * fabsf(noise()));
		lp_radiance_map_observe(map, &seen);
		if (n == 10)
			assert_true(map->radiance[5][1] < 21.0F);
		if (n == 90)
			assert_int_equal(map->flags[5], 0);
	}
	assert_int_equal(map->flags[5], LP_CELL_CLIPPED);
}

static void test_a_bound_of_twice_what_is_known_counts(void **state)
{
	struct lp_observation seen;

	(void)state;
	know(20.0F, 100.0F);
	seen = misplaced(100.0F, 40.0F);
	fill(36.0F);
	lp_radiance_map_observe(map, &seen);
	assert_int_equal(map->flags[5], 0);
	assert_float_equal(map->radiance[5][1], 20.0F, 0.5F);
	fill(50.0F);
	seen.longer = true; /* a shorter exposure tells more */
	lp_radiance_map_observe(map, &seen);
	assert_int_equal(map->flags[5], 0);
	seen.longer = false;
	lp_radiance_map_observe(map, &seen);
	assert_int_equal(map->flags[5], LP_CELL_CLIPPED);
	assert_float_equal(map->radiance[5][1], 50.0F, 1e-4F);
}

/* A lamp that a drifting frame of reference moves across a dark cell comes and goes by parts. */
static void test_a_clipped_lamp_comes_and_goes_by_parts(void **state)
{
	struct lp_observation seen;

	(void)state;
	know(0.05F, 0.1F);
	seen = misplaced(100.0F, 40.0F);
	for (int n = 0; n <= 100; n++) {
		const float share = 1.0F - fabsf((float)n / 50.0F - 1.0F);

		fill(1.0F + 60.0F * share);
		lp_radiance_map_observe(map, &seen);
		assert_float_equal(map->radiance[5][1], radiance[5][1], 3.0F);
		assert_int_equal(map->flags[5], LP_CELL_CLIPPED);
	}
}

/* A clipped pixel does not show in the mean of a cell of middle brightness: a longer exposure does
 * not make the cell darker that a shorter one has seen clipped, until that one shows it darker,
 * too, or comes no more. */
static void test_a_clipped_pixel_hides_in_a_longer_exposure(void **state)
{
	struct lp_observation longer = picture(1.0F), shorter = picture(100.0F);
	int waited = 0;

	(void)state;
	for (int round = 0; round < 3; round++) {
		fill(2.0F); /* one pixel of 64, and more */
		memset(flags, LP_CELL_CLIPPED, CELLS);
		(void)lp_radiance_map_observe(map, &shorter);
		fill(0.3F);
		memset(flags, 0, CELLS);
		(void)lp_radiance_map_observe(map, &longer);
		assert_float_equal(map->radiance[5][1], 2.0F, 1e-4F);
		assert_int_equal(map->flags[5], LP_CELL_CLIPPED);
	}
	(void)lp_radiance_map_observe(map, &shorter);
	assert_float_equal(map->radiance[5][1], 0.3F, 1e-4F);
	assert_int_equal(map->flags[5], 0);

	fill(2.0F);
	memset(flags, LP_CELL_CLIPPED, CELLS);
	(void)lp_radiance_map_observe(map, &shorter);
	fill(0.3F);
	memset(flags, 0, CELLS);
	while (map->flags[5] && ++waited < 100)
		(void)lp_radiance_map_observe(map, &longer);
	assert_in_range(waited, 10, 30);
	assert_float_equal(map->radiance[5][1], 0.3F, 1e-4F);

	fill(2.0F);
	memset(flags, LP_CELL_CLIPPED, CELLS);
	(void)lp_radiance_map_observe(map, &shorter);
	fill(0.004F); /* so dark that not one pixel can clip */
	memset(flags, 0, CELLS);
	(void)lp_radiance_map_observe(map, &longer);
	assert_float_equal(map->radiance[5][1], 0.004F, 1e-5F);
}

/* Beside a clipped cell light may be that cell's, but darkness is not: what a misplaced frame has
 * left there goes. A cell so bright that a few of its pixels may clip, or one beside a cell that is
 * not seen, says nothing. */
static void test_what_is_darker_beside_a_clipped_cell_is_learned(void **state)
{
	const struct {
		uint8_t before, flag;
		float seen, known;
	} cases[] = {{0, LP_CELL_BESIDE, 0.004F, 0.004F},
		     {LP_CELL_CLIPPED, LP_CELL_BESIDE, 0.004F, 0.004F},
		     {0, LP_CELL_BESIDE, 0.9F, 0.5F},
		     {0, LP_CELL_BESIDE, 0.1F, 0.5F},
		     {LP_CELL_CLIPPED, LP_CELL_BESIDE, 0.1F, 0.5F},
		     {0, LP_CELL_BESIDE | LP_CELL_BESIDE_DARK, 0.004F, 0.5F}};

	(void)state;
	for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
		struct lp_observation seen = picture(1.0F);

		lp_radiance_map_forget(map);
		memset(flags, 0, sizeof(flags));
		fill(0.004F);
		for (int c = 0; c < 4; c++)
			radiance[100][c] = 0.5F;
		flags[100] = cases[k].before;
		(void)lp_radiance_map_observe(map, &seen);
		for (int c = 0; c < 4; c++)
			radiance[100][c] = cases[k].seen;
		flags[100] = cases[k].flag;
		(void)lp_radiance_map_observe(map, &seen);
		assert_float_equal(map->radiance[100][LP_LUMINANCE], cases[k].known, 1e-6F);
	}
}

static void test_any_unit_will_do(void **state)
{
	(void)state;
	for (float unit = 1e-9F; unit < 2e9F; unit *= 1e3F) {
		struct lp_observation seen = picture(unit);

		lp_radiance_map_forget(map);
		fill(0.3F * unit);
		for (int n = 0; n < 5; n++)
			lp_radiance_map_observe(map, &seen);
		fill(0.6F * unit);
		lp_radiance_map_observe(map, &seen);
		assert_float_equal(map->radiance[77][2] / unit, 0.6F, 1e-5F);
		seen.coded = false; /* float frames are exact */
		fill(0.0F);
		lp_radiance_map_observe(map, &seen);
		lp_radiance_map_observe(map, &seen);
		assert_float_equal(map->radiance[77][2], 0.0F, 0.0F);
		assert_float_equal(map->variance[77], 0.0F, 0.0F);
	}
}

/* What neighbours say of a cell is taken where nothing is known. It adds nothing to what is known
 * better, it is no change of light, and said again it is no more certain. */
static void test_what_is_filled_gives_way(void **state)
{
	struct lp_observation seen = picture(1.0F);

	(void)state;
	fill(0.3F);
	flags[100] = LP_CELL_FILLED;
	for (int n = 0; n < 30; n++)
		lp_radiance_map_observe(map, &seen);
	assert_int_equal(map->flags[100], 0);
	assert_true(lp_radiance_map_observe(map, &seen).filled_fraction > 0.0F); /* and says so */
	assert_float_equal(map->radiance[100][1], 0.3F, 1e-6F);
	assert_true(map->variance[100] > 0.2F * 0.2F * 0.3F * 0.3F);
	assert_true(map->variance[99] < 0.04F * 0.04F * 0.3F * 0.3F);
	radiance[100][LP_LUMINANCE] = radiance[100][1] = 0.4F; /* follows its neighbours */
	lp_radiance_map_observe(map, &seen);
	assert_float_equal(map->radiance[100][1], 0.4F, 1e-6F);

	flags[100] = 0; /* another place of the picture sees it */
	radiance[100][LP_LUMINANCE] = radiance[100][1] = 0.9F;
	lp_radiance_map_observe(map, &seen);
	assert_float_equal(map->radiance[100][1], 0.9F, 0.05F);
	flags[100] = LP_CELL_FILLED;
	radiance[100][LP_LUMINANCE] = radiance[100][1] = 0.3F;
	for (int n = 0; n < 30; n++)
		assert_float_equal(lp_radiance_map_observe(map, &seen).changed, 0.0F, 0.0F);
	assert_float_equal(map->radiance[100][1], 0.9F, 0.05F);
	assert_float_equal(lp_radiance_map_observe(map, &seen).filled_fraction, 0.0F, 0.0F);
	for (int n = 0; n < 30 * 20; n++) /* until it is old */
		lp_radiance_map_observe(map, &seen);
	assert_float_equal(map->radiance[100][1], 0.3F, 1e-6F);

	flags[100] = LP_CELL_CLIPPED;
	radiance[100][LP_LUMINANCE] = radiance[100][1] = 1.0F;
	lp_radiance_map_observe(map, &seen);
	flags[100] = LP_CELL_FILLED;
	radiance[100][LP_LUMINANCE] = radiance[100][1] = 0.3F;
	lp_radiance_map_observe(map, &seen);
	assert_float_equal(map->radiance[100][1], 1.0F, 1e-6F); /* at least so much is there */
}

/* A smooth room with a window and lamps, seen from a turned camera. */
static float room(const double d[3])
{
	const double lamp[3][3] = {{0.3, 0.9, -0.31}, {-0.7, 0.5, 0.51}, {0.1, -0.2, 0.97}};
	double light = 0.3 + 0.15 * sin(5.0 * d[0] + 1.0) * cos(4.0 * d[1]) + 0.1 * sin(7.0 * d[2]);

	for (int k = 0; k < 3; k++) {
		const double near = d[0] * lamp[k][0] + d[1] * lamp[k][1] + d[2] * lamp[k][2];

		light += 0.5 * exp(40.0 * (near - 1.0));
	}
	return (float)light;
}

static void look(const struct lp_rotation *rotation, float gain)
{
	for (int i = 0; i < CELLS; i++) {
		float direction[3];
		double d[3], turned[3];

		lp_grid_direction(grid, i, direction);
		for (int a = 0; a < 3; a++)
			d[a] = direction[a];
		lp_rotate(rotation, d, turned);
		for (int c = 0; c < 4; c++)
			radiance[i][c] = gain * room(turned) * (1.0F + 0.02F * noise());
	}
}

/* Poles and seam included: what is looked up is what is there. */
static void test_lookup_of_a_turned_picture(void **state)
{
	static float turned[CELLS + 16][4];

	(void)state;
	for (int n = 0; n < 6; n++) {
		const struct lp_rotation rotation = lp_rotation_of_vector(
			(const double[]){1.1 * (n % 3), 0.7 * n, 0.4 * (n % 2)});
		const struct lp_rotation back = lp_rotation_inverse(&rotation);
		double worst = 0.0, sum = 0.0;

		look(&rotation, 1.0F);
		lp_lookup_set(lookup, &back);
		lp_lookup_radiance(lookup, (const float(*)[4])radiance, turned, step2);
		for (int i = 0; i < CELLS; i++) {
			float direction[3];

			lp_grid_direction(grid, i, direction);
			const double d[3] = {direction[0], direction[1], direction[2]};
			const double off = fabs(turned[i][LP_LUMINANCE] - room(d));

			worst = fmax(worst, off);
			sum += off * lp_grid_solid_angle_sr(grid, i) / (4.0 * M_PI);
		}
		assert_true(sum < 0.004);
		assert_true(worst < 0.05);
	}
}

/* A turn about the vertical moves what lies ahead, and not what is at the zenith. */
static void test_variance_of_a_place_is_that_of_its_direction(void **state)
{
	const double across[3][3] = {{1.0, 0.3, -0.7}, {0.3, 2.0, 0.5}, {-0.7, 0.5, 1.5}};
	static float variance[CELLS + 16];

	(void)state;
	for (int i = 0; i < CELLS; i++)
		step2[i] = 1.0F + (float)(i % 5);
	lp_lookup_place_variance(lookup, step2, 0.25F, across, variance);
	for (int i = 0; i < CELLS; i++) {
		double expected = 0.25;
		float d[3];

		lp_grid_direction(grid, i, d);
		for (int a = 0; a < 3; a++)
			for (int b = 0; b < 3; b++)
				expected += d[a] * across[a][b] * d[b];
		assert_float_equal(variance[i], step2[i] * expected, 2e-5);
	}
}

/* No mark is lost, and a mark spreads to what lies next to it. */
static void test_marks_are_not_lost(void **state)
{
	static uint8_t turned[CELLS + 16];
	const struct lp_rotation rotation = lp_rotation_of_vector((const double[]){0.4, 0.3, -0.2});

	(void)state;
	lp_lookup_set(lookup, &rotation);
	for (int cell = 0; cell < CELLS; cell += 977) {
		float direction[3];
		int marked = 0;

		memset(flags, 0, CELLS);
		flags[cell] = LP_CELL_CLIPPED;
		lp_grid_direction(grid, cell, direction);
		const double d[3] = {direction[0], direction[1], direction[2]};
		const struct lp_rotation back = lp_rotation_inverse(&rotation);
		double there[3];

		lp_rotate(&back, d, there);
		lp_lookup_marks(lookup, flags, turned);
		const int at = lp_grid_cell(grid, (const float[]){(float)there[0], (float)there[1],
								  (float)there[2]});

		/* near a pole a cell of the picture is smaller than the map's */
		assert_int_equal(turned[at] & ~(LP_CELL_CLIPPED | LP_CELL_BESIDE), 0);
		assert_true(turned[at]);
		for (int i = 0; i < CELLS; i++)
			marked += turned[i] != 0;
		assert_true(marked >= 4);
	}
}

static double off_deg(const struct lp_rotation *found, const struct lp_rotation *truth)
{
	const struct lp_rotation back = lp_rotation_inverse(truth);
	const struct lp_rotation apart = lp_rotation_product(&back, found);
	double vector[3];

	lp_rotation_vector(&apart, vector);
	return sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]) / DEG;
}

/* Turns up to ten degrees about any axis are found to a tenth of a degree, whatever the gain. */
static void test_a_turned_picture_is_aligned(void **state)
{
	const double none[3][3] = {{0}};
	const struct lp_rotation identity = lp_rotation_identity();
	struct lp_observation seen = picture(2.0F);

	(void)state;
	look(&identity, 1.0F);
	lp_radiance_map_observe(map, &seen);
	for (int n = 0; n < 12; n++) {
		const double angle = (n % 4 == 0   ? 0.5
				      : n % 4 == 1 ? 3.0
				      : n % 4 == 2 ? 6.0
						   : 10.0) *
				     DEG;
		const double axis[3][3] = {{0, 1, 0}, {0.6, 0, 0.8}, {0.577, 0.577, -0.577}};
		double vector[3];

		for (int a = 0; a < 3; a++)
			vector[a] = angle * axis[n / 4][a];
		const struct lp_rotation truth = lp_rotation_of_vector(vector);
		const float gain = n % 2 ? 1.0F : 0.25F;

		look(&truth, gain);
		seen = picture(2.0F);
		lp_alignment_load(alignment, map, &seen, &(struct lp_shear){0});
		const struct lp_alignment_result result =
			lp_alignment_solve(alignment, &identity, none, 0.1);
		const struct lp_rotation found = lp_rotation_of_vector(result.turn);

		assert_true(off_deg(&found, &truth) < 0.1);
		assert_true(result.agreement > 0.9F);
		assert_float_equal(result.log_gain, log(gain), 0.05);
		for (int a = 0; a < 3; a++)
			assert_true(result.information[a][a] > 1.0 / (0.5 * DEG * 0.5 * DEG));
	}
}

/* Another room agrees with nothing, and darkness says nothing: the guess remains. */
static void test_what_cannot_be_aligned_is_told(void **state)
{
	const struct lp_rotation identity = lp_rotation_identity();
	const double firm[3][3] = {{1e6, 0, 0}, {0, 1e6, 0}, {0, 0, 1e6}};
	struct lp_observation seen = picture(2.0F);

	(void)state;
	look(&identity, 1.0F);
	lp_radiance_map_observe(map, &seen);
	for (int i = 0; i < CELLS; i++)
		for (int c = 0; c < 4; c++)
			radiance[i][c] = (i / 8 + i / (8 * WIDTH)) % 2 ? 0.02F : 1.5F;
	lp_alignment_load(alignment, map, &seen, &(struct lp_shear){0});
	struct lp_alignment_result result = lp_alignment_solve(alignment, &identity, firm, 0.001);

	assert_true(result.agreement < 0.4F);
	fill(0.0F);
	lp_alignment_load(alignment, map, &seen, &(struct lp_shear){0});
	result = lp_alignment_solve(alignment, &identity, firm, 0.001);
	for (int a = 0; a < 3; a++) {
		assert_float_equal(result.turn[a], 0.0, 1e-9);
		assert_float_equal(result.information[a][a], 0.0, 1e-9);
	}
}

/* The map's own frame turns, and holds the same light. */
static void test_the_map_turns(void **state)
{
	const struct lp_rotation rotation = lp_rotation_of_vector((const double[]){0.2, -0.9, 0.1});
	const struct lp_rotation identity = lp_rotation_identity();
	struct lp_observation seen = picture(2.0F);
	double sum = 0.0;

	(void)state;
	look(&identity, 1.0F);
	flags[3000] = LP_CELL_CLIPPED;
	lp_radiance_map_observe(map, &seen);
	lp_radiance_map_turn(map, lookup, &rotation);
	look(&rotation, 1.0F);
	for (int i = 0; i < CELLS; i++)
		sum += fabs(map->radiance[i][1] - radiance[i][1]) *
		       lp_grid_solid_angle_sr(grid, i) / (4.0 * M_PI);
	assert_true(sum < 0.008);
	int clipped = 0;

	for (int i = 0; i < CELLS; i++)
		clipped += map->flags[i] == LP_CELL_CLIPPED;
	assert_true(clipped >= 1 && clipped < 30);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_nothing_is_known_at_first, begin),
		cmocka_unit_test_setup(test_noise_is_averaged, begin),
		cmocka_unit_test_setup(test_a_change_is_taken_at_once, begin),
		cmocka_unit_test_setup(test_who_walks_by_leaves_the_other_cells_as_they_are, begin),
		cmocka_unit_test_setup(test_a_lamp_that_is_switched_lights_the_other_cells, begin),
		cmocka_unit_test_setup(test_clipped_cells_bound_from_below, begin),
		cmocka_unit_test_setup(test_misplaced_bounds_do_not_add_up, begin),
		cmocka_unit_test_setup(test_a_bound_of_twice_what_is_known_counts, begin),
		cmocka_unit_test_setup(test_a_clipped_lamp_comes_and_goes_by_parts, begin),
		cmocka_unit_test_setup(test_a_clipped_pixel_hides_in_a_longer_exposure, begin),
		cmocka_unit_test_setup(test_what_is_darker_beside_a_clipped_cell_is_learned, begin),
		cmocka_unit_test_setup(test_any_unit_will_do, begin),
		cmocka_unit_test_setup(test_what_is_filled_gives_way, begin),
		cmocka_unit_test_setup(test_lookup_of_a_turned_picture, begin),
		cmocka_unit_test_setup(test_variance_of_a_place_is_that_of_its_direction, begin),
		cmocka_unit_test_setup(test_marks_are_not_lost, begin),
		cmocka_unit_test_setup(test_a_turned_picture_is_aligned, begin),
		cmocka_unit_test_setup(test_what_cannot_be_aligned_is_told, begin),
		cmocka_unit_test_setup(test_the_map_turns, begin),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
