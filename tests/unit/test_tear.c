/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures whose first rows have the exposure of the frame before. */
#include "vision/response/tear.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "lp_test.h"
#include "random_normal.h"

#define MOST_WIDTH 240
#define MOST_CELLS (MOST_WIDTH * MOST_WIDTH / 2)

static struct lp_tear tear;
static float light[MOST_CELLS], radiance[MOST_CELLS][4];
static uint8_t clipped[MOST_CELLS];

struct camera {
	float exposures[3]; /* of a bracket, in turn: full scale is 1 */
	float torn;	    /* share of the rows */
	float unrest;	    /* 1 sigma of all light from frame to frame, relative */
	int turn;	    /* rows by which the picture wanders from frame to frame */
	int width, height;  /* in cells */
};

static const struct camera plain = {.exposures = {0.02F, 0.3F, 5.0F},
				    .width = MOST_WIDTH,
				    .height = MOST_WIDTH / 2};

/* From the brightest above to the darkest below, and edges between. */
static void furnish(const struct camera *camera)
{
	float row = 0.0F;

	for (int y = 0; y < camera->height; y++) {
		row = y % 15 ? row : random_normal() - 4.0F * (float)y / (float)camera->height;

		for (int x = 0; x < camera->width; x++)
			light[y * camera->width + x] = expf(row + 0.5F * random_normal());
	}
}

static void see(const struct camera *camera, int frame)
{
	struct lp_cells cells = {.width = camera->width,
				 .height = camera->height,
				 .radiance = radiance,
				 .clipped = clipped,
				 .scale = 7.0F};
	const float exposure = camera->exposures[frame % 3];
	const float before = camera->exposures[(frame + 2) % 3];
	const float all = expf(camera->unrest * random_normal());

	for (int y = 0; y < camera->height; y++) {
		const bool is_torn = (float)y < camera->torn * (float)camera->height;
		const int from = abs(y + frame * camera->turn) % camera->height;

		for (int x = 0; x < camera->width; x++) {
			const float linear = all * light[from * camera->width + x] *
					     (is_torn ? before : exposure);
			const int cell = y * camera->width + x;

			clipped[cell] = linear >= 1.0F;
			radiance[cell][LP_LUMINANCE] = cells.scale * fminf(linear, 1.0F);
		}
	}
	lp_tear_learn(&tear, &cells, logf(exposure));
}

static void watch(const struct camera *camera, int frames)
{
	for (int n = 0; n < frames; n++)
		see(camera, n);
}

static void test_a_tear_is_found_where_it_is(void **state)
{
	const float shares[] = {0.1F, 0.33F, 0.5F, 0.8F};

	(void)state;
	for (size_t k = 0; k < sizeof(shares) / sizeof(*shares); k++) {
		struct camera camera = plain;

		camera.torn = shares[k];
		lp_tear_init(&tear);
		furnish(&camera);
		watch(&camera, 120);
		assert_true(tear.found);
		assert_float_equal(tear.share, shares[k], 1.5 / LP_TEAR_ROWS);
		/* exposures are 15 times apart, and once in three 250 times */
		assert_true(lp_tear_sigma(&tear) > 10.0F * shares[k]);
		watch(&plain, 200); /* it comes to an end */
		assert_false(tear.found);
		assert_float_equal(lp_tear_sigma(&tear), 0.0, 0.0);
	}
}

static void test_what_is_no_tear(void **state)
{
	struct camera others[] = {plain, plain, plain, plain, plain};

	(void)state;
	others[1].unrest = 0.3F;
	others[2].turn = 1;
	others[3].turn = 7;
	others[3].unrest = 0.1F;
	memcpy(others[4].exposures, (float[]){0.1F, 0.1F, 0.1F}, sizeof(others[4].exposures));
	others[4].torn = 0.5F;
	for (size_t k = 0; k < sizeof(others) / sizeof(*others); k++) {
		lp_tear_init(&tear);
		for (int n = 0; n < 300; n++) {
			if (n % 100 == 0)
				furnish(&others[k]);
			see(&others[k], n);
			assert_false(tear.found);
		}
	}
}

/* One exposure is left: no picture is torn. */
static void test_a_tear_is_gone_with_the_bracket(void **state)
{
	struct camera camera = plain;

	(void)state;
	camera.torn = 0.4F;
	lp_tear_init(&tear);
	furnish(&camera);
	watch(&camera, 120);
	assert_true(tear.found);
	camera.exposures[0] = camera.exposures[2] = camera.exposures[1];
	watch(&camera, 200);
	assert_false(tear.found);
}

/* All dark, all bright, pictures of hardly any cells, exposures that are far apart. */
static void test_extremes(void **state)
{
	const struct camera some[] = {
		{.exposures = {1e-9F, 1e-8F, 1e-7F}, .width = 240, .height = 120},
		{.exposures = {1e9F, 1e8F, 1e7F}, .width = 240, .height = 120},
		{.exposures = {1e-9F, 0.1F, 1e9F}, .width = 240, .height = 120, .torn = 0.3F},
		{.exposures = {0.02F, 0.3F, 5.0F}, .width = 1, .height = 1},
		{.exposures = {0.02F, 0.3F, 5.0F}, .width = 8, .height = 4},
	};

	(void)state;
	for (size_t k = 0; k < sizeof(some) / sizeof(*some); k++) {
		lp_tear_init(&tear);
		furnish(&some[k]);
		for (int n = 0; n < 100; n++) {
			see(&some[k], n);
			assert_false(tear.found);
			assert_true(isfinite(lp_tear_sigma(&tear)));
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_tear_is_found_where_it_is),
		cmocka_unit_test(test_what_is_no_tear),
		cmocka_unit_test(test_a_tear_is_gone_with_the_bracket),
		cmocka_unit_test(test_extremes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
