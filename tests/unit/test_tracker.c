/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/tracker.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "light/send/model.h"
#include "lp_test.h"

#define FRAME_NS 33333333LL

static struct lp_light lamp(float azimuth_deg, float strength)
{
	const float a = azimuth_deg * (float)M_PI / 180.0F;

	/* ids as the memory of lamps gives them: here by the place */
	return (struct lp_light){.id = 1 + (uint32_t)lroundf(azimuth_deg / 45.0F),
				 .direction = {sinf(a), 0.0F, -cosf(a)},
				 .irradiance = {strength, strength, strength},
				 .angular_radius_deg = 2.0F,
				 .direction_sigma_deg = 0.1F,
				 .irradiance_sigma = 0.02F,
				 .distance_m = NAN};
}

static struct lp_light_estimate at(int64_t t_ns, int count, const struct lp_light *lights)
{
	struct lp_light_estimate e = {.t_capture_ns = t_ns, .light_count = count};

	for (int k = 0; k < count; k++) {
		e.lights[k] = lights[k];
		e.sh_total[0][0] += lights[k].irradiance[0];
	}
	return e;
}

static void test_first_estimate_is_taken_as_it_is(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 1000.0F};
	const struct lp_light light = lamp(10.0F, 5.0F);
	struct lp_light_estimate raw = at(0, 1, &light), smoothed;

	(void)state;
	lp_tracker_update(&tracker, &raw, &smoothed);
	assert_float_equal(smoothed.lights[0].irradiance[0], 5.0F, 0.0F);
	assert_float_equal(smoothed.sh_total[0][0], 5.0F, 0.0F);
}

/* The declared time constant is the one that a step shows, at any frame rate. */
static void test_time_constant(void **state)
{
	const int64_t periods[] = {1000000, FRAME_NS, 100000000};

	(void)state;
	for (int p = 0; p < 3; p++) {
		struct lp_tracker tracker = {.time_constant_ms = 200.0F};
		struct lp_light light = lamp(0.0F, 1.0F);
		struct lp_light_estimate raw = at(0, 1, &light), smoothed;
		int64_t t = 0;

		lp_tracker_update(&tracker, &raw, &smoothed);
		light = lamp(0.0F, 2.0F);
		while (t < 200000000) {
			t += periods[p];
			raw = at(t, 1, &light);
			lp_tracker_update(&tracker, &raw, &smoothed);
		}
		assert_float_equal(smoothed.lights[0].irradiance[0], 2.0 - exp(-(double)t / 200e6),
				   1e-4);
	}
}

/* What smoothing does to lights it does to the SH, so that AMBIENT (their difference) stays put. */
static void test_lights_and_sh_stay_consistent(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 150.0F};
	struct lp_light_estimate raw, smoothed;

	(void)state;
	for (int n = 0; n < 300; n++) {
		const struct lp_light lights[2] = {lamp(0.0F, 5.0F), lamp(90.0F, 3.0F)};
		const int count = n < 100 ? 1 : n < 200 ? 2 : 0; /* appears; all vanish */
		float sum = 0.0F;

		raw = at(n * FRAME_NS, count, lights);
		raw.sh_total[0][0] += 7.0F; /* ambient */
		lp_tracker_update(&tracker, &raw, &smoothed);
		for (int k = 0; k < smoothed.light_count; k++)
			sum += smoothed.lights[k].irradiance[0];
		/* the faintest fifth of a hundredth is no longer listed */
		assert_float_equal(smoothed.sh_total[0][0] - sum, 7.0F, 0.2F);
	}
	assert_int_equal(smoothed.light_count, 0);
}

static void test_an_absent_lamp_is_held_while_it_fades(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 100.0F};
	const struct lp_light light = lamp(0.0F, 5.0F);
	struct lp_light_estimate raw = at(0, 1, &light), smoothed;
	int64_t t = 0;

	(void)state;
	lp_tracker_update(&tracker, &raw, &smoothed);
	for (int n = 0; n < 3; n++) {
		t += FRAME_NS;
		raw = at(t, 0, NULL);
		lp_tracker_update(&tracker, &raw, &smoothed);
		assert_int_equal(smoothed.light_count, 1);
		assert_int_equal(smoothed.lights[0].id, light.id);
		assert_true(smoothed.lights[0].flags & LP_LIGHT_HELD);
	}
	t += FRAME_NS;
	raw = at(t, 1, &light);
	lp_tracker_update(&tracker, &raw, &smoothed);
	assert_int_equal(smoothed.light_count, 1);
	assert_false(smoothed.lights[0].flags & LP_LIGHT_HELD);
}

/* A ninth lamp is found when one of eight has gone: that one fades to its end first. */
static void test_a_lamp_that_fades_keeps_its_place(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 100.0F};
	struct lp_light lights[LP_MAX_LIGHTS + 1];
	struct lp_light_estimate raw, smoothed;
	float before = INFINITY;
	bool entered = false;

	(void)state;
	for (int k = 0; k <= LP_MAX_LIGHTS; k++) {
		lights[k] = lamp(45.0F * (float)k, 10.0F - (float)k);
		lights[k].id = 1 + (uint32_t)k;
	}
	raw = at(0, LP_MAX_LIGHTS, lights);
	lp_tracker_update(&tracker, &raw, &smoothed);
	for (int n = 1; n < 30; n++) { /* all but the third: id 3, strength 8 */
		const struct lp_light *fading = NULL;

		raw = at(n * FRAME_NS, LP_MAX_LIGHTS, lights);
		memcpy(&raw.lights[2], &lights[3], (LP_MAX_LIGHTS - 2) * sizeof(*lights));
		lp_tracker_update(&tracker, &raw, &smoothed);
		for (int k = 0; k < smoothed.light_count; k++) {
			if (smoothed.lights[k].id == 3)
				fading = &smoothed.lights[k];
			entered |= smoothed.lights[k].id == LP_MAX_LIGHTS + 1;
			assert_true(k == 0 || smoothed.lights[k].irradiance[1] <=
						      smoothed.lights[k - 1].irradiance[1]);
		}
		if (!fading)
			assert_true(before < 0.05F * lights[2].irradiance[1]);
		before = fading ? fading->irradiance[1] : 0.0F;
	}
	assert_true(entered);
	assert_float_equal(before, 0.0F, 0.0F);
}

/* The frame of reference turns: what is smoothed turns with it. */
static void test_turning_turns_lights_and_sh(void **state)
{
	const struct lp_rotation turn =
		lp_rotation_of_vector((const double[]){0.0, M_PI / 2.0, 0.0});
	struct lp_tracker tracker = {.time_constant_ms = 100.0F};
	const struct lp_light light = lamp(0.0F, 5.0F); /* along -Z; a quarter turn: along -X */
	struct lp_light_estimate raw = at(0, 1, &light), smoothed;

	(void)state;
	raw.sh_total[1][0] = 1.0F; /* Y(1, -1) ~ y */
	raw.sh_total[2][0] = 2.0F; /* Y(1, 0) ~ z */
	lp_tracker_update(&tracker, &raw, &smoothed);
	lp_tracker_turn(&tracker, &turn);
	assert_float_equal(tracker.track[0].light.direction[0], -1.0F, 1e-6F);
	assert_float_equal(tracker.sh_total[1][0], 1.0F, 1e-6F);
	assert_float_equal(tracker.sh_total[2][0], 0.0F, 1e-6F);
	assert_float_equal(tracker.sh_total[3][0], 2.0F, 1e-6F); /* z becomes x */
}

/* A lamp two metres ahead, seen from a metre beside: by geometry. One whose distance is not known
 * stays. */
static void test_what_is_near_goes_with_the_probe(void **state)
{
	const struct lp_light far_away = lamp(0.0F, 8.0F), *first;
	struct lp_tracker tracker = {.time_constant_ms = 100.0F};
	struct lp_light near = far_away;
	struct lp_light_estimate raw, smoothed;

	(void)state;
	near.distance_m = 2.0F;
	memcpy(near.direction, (const float[]){0.0F, 0.0F, -1.0F}, sizeof(near.direction));
	raw = at(0, 1, &near);
	lp_tracker_update(&tracker, &raw, &smoothed);
	lp_tracker_go(&tracker, (const double[]){1.0, 0.0, 0.0});
	first = &tracker.track[0].light;
	assert_float_equal(first->direction[0], -1.0 / sqrt(5.0), 1e-6);
	assert_float_equal(first->direction[2], -2.0 / sqrt(5.0), 1e-6);
	assert_float_equal(first->distance_m, sqrt(5.0), 1e-6);
	assert_float_equal(first->irradiance[0], 8.0 * 4.0 / 5.0, 1e-5);
	double change[LP_MAX_SH_COUNT][3] = {{0.0}};

	lp_sh_add_lamp(1, near.direction, near.irradiance, 0.0, -1.0, change);
	lp_sh_add_lamp(1, first->direction, first->irradiance, 0.0, 1.0, change);
	for (int i = 0; i < 4; i++)
		assert_float_equal(tracker.sh_total[i][0], raw.sh_total[i][0] + change[i][0], 1e-5);
	tracker = (struct lp_tracker){.time_constant_ms = 100.0F};
	raw = at(0, 1, &far_away);
	raw.lights[0].distance_m = NAN;
	lp_tracker_update(&tracker, &raw, &smoothed);
	const struct lp_light before = *first;

	lp_tracker_go(&tracker, (const double[]){1.0, 0.0, 0.0});
	assert_memory_equal(first, &before, sizeof(before));
}

static void test_time_may_stand_still_or_go_back(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 100.0F};
	const struct lp_light light = lamp(0.0F, 5.0F);
	struct lp_light_estimate raw, smoothed;
	const int64_t times[] = {5000000000, 5000000000, 1000000000, INT64_MAX / 2, 0};

	(void)state;
	for (int n = 0; n < 5; n++) {
		raw = at(times[n], 1, &light);
		lp_tracker_update(&tracker, &raw, &smoothed);
		assert_int_equal(smoothed.light_count, 1);
		assert_float_equal(smoothed.lights[0].irradiance[0], 5.0F, 1e-6F);
	}
}

/* A day at 12 frames a second, lamps coming and going: no id is lost, nothing drifts, nothing is
 * NaN. */
static void test_a_million_frames(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 150.0F};
	struct lp_light_estimate raw, smoothed;

	(void)state;
	srand(3);
	for (int n = 0; n < 1000000; n++) {
		struct lp_light lights[LP_MAX_LIGHTS];
		const int count = n / 1000 % (LP_MAX_LIGHTS + 1);

		for (int k = 0; k < count; k++)
			lights[k] = lamp(45.0F * (float)k + (float)(rand() % 100) * 0.01F,
					 1.0F + (float)k);
		raw = at(n * 83333333LL, count, lights);
		lp_tracker_update(&tracker, &raw, &smoothed);
		assert_true(smoothed.light_count <= LP_MAX_LIGHTS);
		for (int k = 0; k < smoothed.light_count; k++) {
			const float *d = smoothed.lights[k].direction;

			assert_true(isfinite(smoothed.lights[k].irradiance[0]));
			assert_true(fabsf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0F) < 1e-5F);
			for (int j = 0; j < k; j++)
				assert_int_not_equal(smoothed.lights[j].id, smoothed.lights[k].id);
		}
	}
}

/* What jumps is smoothed no more: lamps and coefficients change by as much at once, one that goes
 * off is no longer listed, one that goes on is there; all the rest settles on as before. */
static void test_a_jump_has_no_delay(void **state)
{
	struct lp_tracker tracker = {.time_constant_ms = 300.0F};
	const struct lp_light old[] = {lamp(0.0F, 4.0F), lamp(90.0F, 2.0F)};
	const struct lp_light first[] = {lamp(0.0F, 4.0F), lamp(90.0F, 3.0F)};
	const struct lp_light next[] = {lamp(90.0F, 3.0F), lamp(180.0F, 1.0F)};
	struct lp_light_estimate before = at(0, 2, old), after, smoothed;

	(void)state;
	lp_tracker_update(&tracker, &before, &smoothed);
	before = at(FRAME_NS, 2, first);
	lp_tracker_update(&tracker, &before, &smoothed);
	const float settling = smoothed.lights[1].irradiance[0];

	assert_true(settling > 2.0F && settling < 2.3F);
	after = at(FRAME_NS, 2, next);
	lp_tracker_jump(&tracker, &before, &after);
	lp_tracker_update(&tracker, &after, &smoothed);
	assert_int_equal(smoothed.light_count, 2);
	assert_float_equal(smoothed.lights[0].irradiance[0], settling, 1e-6F);
	assert_float_equal(smoothed.lights[1].irradiance[0], 1.0F, 1e-6F);
	assert_float_equal(smoothed.sh_total[0][0], settling + 1.0F, 1e-5F);
	after.t_capture_ns += 5000 * 1000000LL;
	lp_tracker_update(&tracker, &after, &smoothed);
	assert_float_equal(smoothed.lights[0].irradiance[0], 3.0F, 1e-4F);
}

/* A light whose every number is `value`, but for what must be of one length, yes or no. */
static struct lp_light_estimate all_fields(int64_t t_ns, int value, const float axis[3])
{
	struct lp_light_estimate e = {.t_capture_ns = t_ns, .light_count = 1};
	struct lp_light *light = &e.lights[0];

	memset(light, value, sizeof(*light));
	light->id = 1;
	light->polarization.judged = light->polarization.known = value & 1;
	memcpy(light->direction, axis, sizeof(light->direction));
	memcpy(light->axis, axis, sizeof(light->axis));
	return e;
}

/* Without a time constant the smoothed light is the raw one, byte for byte, whatever fields it has:
 * what is not smoothed is passed on. */
static void test_every_field_of_a_light_is_passed_on(void **state)
{
	const float axes[][3] = {{1.0F, 0.0F, 0.0F}, {0.0F, 1.0F, 0.0F}, {0.0F, 0.0F, 1.0F}};
	struct lp_tracker tracker = {0};
	struct lp_light_estimate smoothed;

	(void)state;
	for (int n = 0; n < 3; n++) {
		struct lp_light_estimate raw = all_fields(n * FRAME_NS, 0x3d + n, axes[n]);

		lp_tracker_update(&tracker, &raw, &smoothed);
		assert_memory_equal(&smoothed.lights[0], &raw.lights[0], sizeof(raw.lights[0]));
	}
}

/* A light of the tracker turns as the same light of an estimate does, in every field. */
static void test_the_tracker_turns_every_field(void **state)
{
	const float axis[3] = {0.0F, 1.0F, 0.0F};
	const struct lp_rotation turn = lp_rotation_of_vector((const double[3]){0.3, 0.5, -0.2});
	struct lp_light_estimate raw = all_fields(0, 0x3f, axis), smoothed;
	struct lp_tracker tracker = {0};

	(void)state;
	raw.lights[0].direction[0] = 0.6F;
	raw.lights[0].direction[1] = 0.8F;
	lp_tracker_update(&tracker, &raw, &smoothed);
	lp_tracker_turn(&tracker, &turn);
	lp_model_turn(&smoothed, &turn, 0.0F);
	assert_memory_equal(&tracker.track[0].light, &smoothed.lights[0], sizeof(struct lp_light));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_first_estimate_is_taken_as_it_is),
		cmocka_unit_test(test_time_constant),
		cmocka_unit_test(test_lights_and_sh_stay_consistent),
		cmocka_unit_test(test_an_absent_lamp_is_held_while_it_fades),
		cmocka_unit_test(test_a_lamp_that_fades_keeps_its_place),
		cmocka_unit_test(test_turning_turns_lights_and_sh),
		cmocka_unit_test(test_what_is_near_goes_with_the_probe),
		cmocka_unit_test(test_time_may_stand_still_or_go_back),
		cmocka_unit_test(test_a_million_frames),
		cmocka_unit_test(test_a_jump_has_no_delay),
		cmocka_unit_test(test_every_field_of_a_light_is_passed_on),
		cmocka_unit_test(test_the_tracker_turns_every_field),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
