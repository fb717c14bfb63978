/* SPDX-License-Identifier: Apache-2.0 */
/* What exposures that differ say of a camera's response. */
#include "vision/response/linearity.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "lp_test.h"
#include "random_normal.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"

#define CELLS 700
#define FRAME_S (1.0F / 30.0F)
#define NOISE 0.03F

static struct lp_linearity linearity;

/* A room before a camera. */
struct camera {
	float exposures[3]; /* of a bracket, in turn */
	float power;	    /* light is what the response says to it */
	float local;	    /* 1 sigma of how regions differ in that */
	float rough;	    /* the same of cells, as by rounding */
	float unrest;	    /* 1 sigma of all light from frame to frame, relative */
	float dishonest;    /* of the second exposure, relative */
};

static const struct camera plain = {.exposures = {1.0F, 16.0F, 256.0F}, .power = 1.0F};

/* Own power of a cell, and logarithm of its light: from full scale of the shortest exposure to the
 * noise of the longest. */
static float own_power[CELLS], light[CELLS];

static void furnish(const struct camera *camera)
{
	float region = 0.0F;

	for (int k = 0; k < CELLS; k++) {
		if (k % (CELLS / 50) == 0)
			region = camera->local * random_normal();
		own_power[k] = camera->power * (1.0F + region + camera->rough * random_normal());
		light[k] = -9.0F * (float)(k * 37 % CELLS) / CELLS;
	}
}

static void see(const struct camera *camera, int frame)
{
	struct lp_linearity_look looks[CELLS];
	const float exposure = camera->exposures[frame % 3];
	const float lie = frame % 3 == 1 ? camera->dishonest : 0.0F;
	const float all = camera->unrest * random_normal() + lie;

	for (int k = 0; k < CELLS; k++) {
		/* what the response in use makes of it */
		const float linear =
			(light[k] + logf(exposure) + all) / own_power[k] * expf(linearity.applied);
		const float noisy = linear + NOISE * random_normal();

		looks[k] = (struct lp_linearity_look){.region = k * 50 / CELLS,
						      .log_light = linear > -0.2F || linear < -5.0F
									   ? NAN
									   : noisy - logf(exposure),
						      .log_linear = noisy,
						      .variance = NOISE * NOISE};
	}
	lp_linearity_learn(&linearity, looks, CELLS, logf(exposure), FRAME_S);
	(void)lp_linearity_apply(&linearity);
}

static void watch(const struct camera *camera, int frames)
{
	for (int n = 0; n < frames; n++)
		see(camera, n);
}

static void begin(const struct camera *camera)
{
	lp_linearity_init(&linearity, 0.05F);
	furnish(camera);
}

static void test_a_power_is_learned(void **state)
{
	const float powers[] = {0.85F, 0.97F, 1.0F, 1.04F, 1.2F};

	(void)state;
	for (size_t k = 0; k < sizeof(powers) / sizeof(*powers); k++) {
		struct camera camera = plain;

		camera.power = powers[k];
		begin(&camera);
		watch(&camera, 30);
		assert_float_equal(linearity.log_power, logf(powers[k]), 0.01);
		watch(&camera, 600);
		assert_float_equal(linearity.log_power, logf(powers[k]), 0.002);
		assert_float_equal(linearity.applied, linearity.log_power, 0.003);
		assert_false(linearity.disagrees);
		assert_true(lp_linearity_sigma(&linearity) < 0.01F);
	}
}

/* Neither is light that changes a response, nor are exposures that are a little off. */
static void test_what_else_differs(void **state)
{
	const struct camera others[] = {
		{.exposures = {1.0F, 16.0F, 256.0F}, .power = 1.0F, .unrest = 0.1F},
		{.exposures = {1.0F, 16.0F, 256.0F}, .power = 1.0F, .dishonest = 0.03F},
		{.exposures = {1.0F, 4.0F, 16.0F}, .power = 1.0F, .unrest = 0.05F},
		{.exposures = {1.0F, 16.0F, 256.0F}, .power = 1.0F, .rough = 0.02F},
	};

	(void)state;
	for (size_t k = 0; k < sizeof(others) / sizeof(*others); k++) {
		begin(&others[k]);
		watch(&others[k], 600);
		assert_float_equal(linearity.log_power, 0.0, 0.01);
		assert_false(linearity.disagrees);
	}
}

/* A lamp is switched twice a second: light of half the room changes by a third. */
static void test_lamps_that_are_switched(void **state)
{
	(void)state;
	begin(&plain);
	for (int n = 0; n < 600; n++) {
		for (int k = 0; n % 15 == 0 && k < CELLS / 2; k++)
			light[2 * k] += n / 15 % 2 ? -0.3F : 0.3F;
		see(&plain, n);
	}
	assert_float_equal(linearity.log_power, 0.0, 0.01);
	assert_false(linearity.disagrees);
}

/* Each region's light is another, by a third (1 sigma): no exposures contradict each other. */
static void test_another_room(void **state)
{
	(void)state;
	for (int seed = 0; seed < 20; seed++) {
		begin(&plain);
		watch(&plain, 100 + seed);
		float step = 0.0F;

		for (int k = 0; k < CELLS; k++) {
			step = k % (CELLS / 50) ? step : 0.3F * random_normal();
			light[k] += step;
		}
		for (int n = 0; n < 200; n++) {
			see(&plain, 100 + seed + n);
			assert_false(linearity.disagrees);
		}
		assert_float_equal(linearity.log_power, 0.0, 0.01);
	}
}

/* A film passes more of some regions, always when the exposure is the shortest. */
static void test_what_cannot_be_compared(void **state)
{
	(void)state;
	begin(&plain);
	for (int n = 0; n < 300; n++) {
		for (int k = 0; n % 3 < 2 && k < CELLS; k++)
			light[k] += (n % 3 ? -0.1F : 0.1F) * (float)(k * 50 / CELLS % 3);
		if (n % 3 < 2)
			lp_linearity_forget_looks(&linearity);
		see(&plain, n);
		assert_false(linearity.disagrees);
	}
	assert_float_equal(linearity.log_power, 0.0, 0.01);
}

/* At three strengths; and it ends when that does. */
static void test_regions_that_ask_for_different_powers(void **state)
{
	const float strengths[] = {0.015F, 0.04F, 0.12F};

	(void)state;
	for (size_t k = 0; k < sizeof(strengths) / sizeof(*strengths); k++) {
		struct camera camera = plain;

		camera.local = strengths[k];
		begin(&camera);
		watch(&camera, 90);
		assert_true(linearity.disagrees);
		assert_float_equal(linearity.spread, strengths[k], 0.3 * (double)strengths[k]);
		/* of 256 : 1 */
		assert_true(lp_linearity_sigma(&linearity) > 3.0F * strengths[k]);
		furnish(&plain);
		watch(&plain, 900);
		assert_false(linearity.disagrees);
	}
}

static void test_one_exposure_tells_nothing(void **state)
{
	const struct camera one = {.exposures = {16.0F, 16.0F, 16.0F}, .power = 1.1F};

	(void)state;
	begin(&one);
	watch(&one, 300);
	assert_float_equal(linearity.log_power, 0.0, 1e-6);
	assert_false(linearity.disagrees);
	assert_float_equal(lp_linearity_sigma(&linearity), 0.0, 0.0);
}

static void test_extremes(void **state)
{
	struct lp_linearity_look looks[LP_LINEARITY_CELLS];

	(void)state;
	begin(&plain);
	for (int n = 0; n < 100; n++) { /* all dark, or light that is a thousand times another */
		for (int k = 0; k < LP_LINEARITY_CELLS; k++)
			looks[k] = (struct lp_linearity_look){
				.log_light = n % 3 ? NAN : 7.0F * (float)(n % 2),
				.log_linear = -1.0F - 7.0F * (float)(n % 2),
				.variance = n % 5 ? 1e-6F : 0.0F};
		lp_linearity_learn(&linearity, looks, LP_LINEARITY_CELLS, (float)(n % 2),
				   n % 7 ? FRAME_S : 0.0F);
		assert_true(isfinite(lp_linearity_sigma(&linearity)));
		assert_true(isfinite(lp_linearity_apply(&linearity)));
	}
	assert_float_equal(linearity.log_power, 0.0, 0.01);
	lp_linearity_learn(&linearity, looks, 0, 0.0F, 1e6F);
	assert_true(isfinite(lp_linearity_sigma(&linearity)));
}

static void test_what_was_learned_goes_on_elsewhere(void **state)
{
	static struct lp_linearity next;
	struct camera camera = plain;

	(void)state;
	camera.power = 1.05F;
	begin(&camera);
	watch(&camera, 300);
	lp_linearity_init(&next, 0.05F);
	lp_linearity_inherit(&next, &linearity);
	assert_float_equal(lp_linearity_apply(&next), 1.05, 0.003);
	assert_float_equal(lp_linearity_sigma(&next), lp_linearity_sigma(&linearity), 1e-3);
}

/* Mean light of codes that are spread, by the block's curve and by the sum. */
static void test_a_response_is_bent(void **state)
{
	const float powers[] = {0.8F, 1.04F, 1.3F};
	struct lp_camera *camera = NULL;
	struct lp_response *response = malloc(sizeof(*response));

	(void)state;
	assert_non_null(response);
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	for (size_t p = 0; p < sizeof(powers) / sizeof(*powers); p++) {
		lp_response_init(response, camera);
		lp_response_bend(response, 1.0F);
		const float before = response->pixel[1][100];

		lp_response_bend(response, powers[p]);
		assert_float_equal(response->pixel[1][100], powf(before, powers[p]), 1e-6);
		assert_float_equal(response->pixel[2][255], 1.0, 1e-6);
		assert_true(response->pixel[0][0] >= 0.0F);
		for (int code = 30; code < 240; code += 30) {
			const struct lp_block_response *block =
				&response->block[0][code * LP_CODE_STEPS];
			const float mean = 0.5F * (response->pixel[0][code - 6] +
						   response->pixel[0][code + 6]);

			assert_float_equal(block->linear + block->half_curvature * 36.0F, mean,
					   0.01 * (double)mean);
		}
	}
	lp_camera_destroy(camera);
	free(response);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_power_is_learned),
		cmocka_unit_test(test_what_else_differs),
		cmocka_unit_test(test_lamps_that_are_switched),
		cmocka_unit_test(test_another_room),
		cmocka_unit_test(test_what_cannot_be_compared),
		cmocka_unit_test(test_regions_that_ask_for_different_powers),
		cmocka_unit_test(test_one_exposure_tells_nothing),
		cmocka_unit_test(test_extremes),
		cmocka_unit_test(test_what_was_learned_goes_on_elsewhere),
		cmocka_unit_test(test_a_response_is_bent),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
