/* SPDX-License-Identifier: Apache-2.0 */
/* The scale of frames that do not tell their exposure. */
#include "vision/doubt/gain.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define CELLS 2000
#define NOISE 0.02F
#define FRAME_S (1.0F / 30.0F)

/* A scene, and a camera whose full scale means `scale`. */
struct world {
	float log_light[CELLS];
	float scale;
	uint32_t chance;
};

/* -1..1 (Numerical Recipes' linear congruential generator). */
static float uniform(struct world *world)
{
	world->chance = 1664525U * world->chance + 1013904223U;
	return (float)world->chance / 2147483648.0F - 1.0F;
}

static struct world *new_world(void)
{
	struct world *world = calloc(1, sizeof(*world));

	assert_non_null(world);
	world->scale = 1.0F;
	for (int k = 0; k < CELLS; k++)
		world->log_light[k] = 2.0F * uniform(world);
	return world;
}

static struct lp_gain *new_gain(void)
{
	struct lp_gain *gain = calloc(1, sizeof(*gain));

	assert_non_null(gain);
	lp_gain_init(gain, 1.0F);
	gain->count = CELLS;
	return gain;
}

/* The camera's next frame, on the scale that is held. */
static void see(struct lp_gain *gain, struct world *world)
{
	for (int k = 0; k < CELLS; k++) {
		gain->cells[k].seen = world->log_light[k] + logf(gain->scale / world->scale) +
				      NOISE * uniform(world);
		gain->cells[k].sigma = NOISE;
	}
}

static void next_frame(struct lp_gain *gain, struct world *world)
{
	see(gain, world);
	const struct lp_gain_look look = lp_gain_look(gain);

	lp_gain_follow(gain, &look, FRAME_S);
}

static void begin(struct lp_gain *gain, struct world *world)
{
	see(gain, world);
	lp_gain_anew(gain, 0.0F, 0.0F);
	for (int n = 0; n < 30; n++)
		next_frame(gain, world);
}

static float off(const struct lp_gain *gain, const struct world *world)
{
	return fabsf(logf(gain->scale / world->scale));
}

static void test_another_exposure_is_followed(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();

	(void)state;
	begin(gain, world);
	for (int n = 0; n < 90; n++) { /* down to a third, and up again */
		world->scale *= n < 30 ? 0.964F : n < 60 ? 1.0F : 1.0F / 0.964F;
		next_frame(gain, world);
		assert_true(off(gain, world) < 0.01F);
	}
	assert_true(lp_gain_sigma(gain) < 0.03F);
	free(gain);
	free(world);
}

/* A lamp is switched: most cells change, each by another factor. Then the exposure follows. */
static void test_a_lamp_is_no_exposure(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();

	(void)state;
	begin(gain, world);
	for (int k = 0; k < CELLS; k++)
		world->log_light[k] += 0.4F * (float)(k % 7) / 7.0F;
	next_frame(gain, world);
	next_frame(gain, world);
	assert_true(gain->scale == 1.0F || off(gain, world) < 0.01F);
	for (int n = 0; n < 30; n++) {
		world->scale *= 1.02F;
		next_frame(gain, world);
	}
	assert_true(off(gain, world) < 0.02F);
	assert_true(lp_gain_sigma(gain) > 0.01F);
	free(gain);
	free(world);
}

/* All light twice as bright at once is light, but says that it might not be. */
static void test_sudden_light_everywhere(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();

	(void)state;
	begin(gain, world);
	for (int k = 0; k < CELLS; k++)
		world->log_light[k] += logf(2.0F);
	next_frame(gain, world);
	assert_true(off(gain, world) < 0.01F);
	assert_true(lp_gain_sigma(gain) > 0.3F);
	for (int n = 0; n < 10; n++) { /* automatic exposure wakes up */
		world->scale *= n ? 1.05F : 1.4F;
		next_frame(gain, world);
		assert_true(off(gain, world) < 0.01F);
	}
	free(gain);
	free(world);
}

static void test_nothing_to_see_is_no_change(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();
	float sigma = 0.0F;

	(void)state;
	begin(gain, world);
	const float scale = gain->scale;

	for (int n = 0; n < 10; n++) {
		for (int k = 0; k < CELLS; k++)
			gain->cells[k].seen = NAN;
		const struct lp_gain_look look = lp_gain_look(gain);

		assert_true(look.agreement == 0.0F);
		lp_gain_follow(gain, &look, FRAME_S);
		assert_true(lp_gain_sigma(gain) > sigma);
		sigma = lp_gain_sigma(gain);
	}
	assert_true(gain->scale == scale);
	free(gain);
	free(world);
}

/* A hundred seconds of exposures that go to and fro all the time. */
static void test_no_drift(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();

	(void)state;
	begin(gain, world);
	for (int n = 0; n < 3000; n++) {
		world->scale = expf(0.4F * sinf((float)n * 0.05F));
		next_frame(gain, world);
		assert_true(off(gain, world) < 0.01F);
	}
	assert_true(off(gain, world) < 3.0F * lp_gain_sigma(gain) + 0.001F);
	free(gain);
	free(world);
}

/* At rest, too: what is known began with frames as noisy as the newest. */
static void test_the_sigma_holds_at_rest(void **state)
{
	struct world *world = new_world();
	struct lp_gain *gain = new_gain();
	int within_1 = 0, within_3 = 0;

	(void)state;
	for (int round = 0; round < 40; round++) {
		lp_gain_init(gain, world->scale);
		gain->count = CELLS;
		see(gain, world);
		lp_gain_anew(gain, 0.0F, 0.0F);
		for (int n = 0; n < 5; n++) {
			next_frame(gain, world);
			within_1 += off(gain, world) <= lp_gain_sigma(gain);
			within_3 += off(gain, world) <= 3.0F * lp_gain_sigma(gain);
		}
	}
	assert_true(within_1 >= 120);
	assert_true(within_3 >= 196);
	free(gain);
	free(world);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_another_exposure_is_followed),
		cmocka_unit_test(test_a_lamp_is_no_exposure),
		cmocka_unit_test(test_sudden_light_everywhere),
		cmocka_unit_test(test_nothing_to_see_is_no_change),
		cmocka_unit_test(test_no_drift),
		cmocka_unit_test(test_the_sigma_holds_at_rest),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
