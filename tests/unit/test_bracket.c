/* SPDX-License-Identifier: Apache-2.0 */
/* Brackets on simulated cameras that round commands, do not follow them, or see other light;
 * through the whole pipeline, so that what is merged is judged by the light that comes out. */
#include "estimate/exposures/bracket.h"

#include <math.h>
#include <string.h>

#include "bracket_room.h"
#include "include/ring_sample.h"
#include "light/clipped/ring_fusion.h"

static void test_reported_exposures_need_no_verifying(void **state)
{
	struct camera camera = {.delay_frames = 3, .reports_exposure = true};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
	struct outcome outcome = run(pipeline, &camera, 90, 1.0F);

	(void)state;
	assert_int_equal(outcome.refused, 0);
	assert_int_equal(outcome.last.flags, 0);
	expect_right_light(&outcome, 1.0F, 0.03);
	lp_pipeline_destroy(pipeline);
}

/* Commands do not wait for each other: however late they take effect, each exposure comes in every
 * round of as many frames. But a camera that begins its delay anew with each command is waited for.
 */
static void test_reported_exposures_take_turns(void **state)
{
	(void)state;
	for (int delay = 0; delay <= 4; delay++)
		for (int restarts = 0; restarts < 2; restarts++) {
			struct camera camera = {.delay_frames = delay,
						.reports_exposure = true,
						.restarts = restarts};
			struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
			int changes = 0;

			run(pipeline, &camera, 90, 1.0F);
			for (int n = 0; n < 30; n++) {
				const float before_us = camera.in_effect_us;

				run(pipeline, &camera, 1, 1.0F);
				changes += camera.in_effect_us != before_us;
			}
			assert_true(changes >= (restarts && delay ? 30 / (delay + 2) : 30));
			lp_pipeline_destroy(pipeline);
		}
}

/* A camera on automatic, or driven by another program: detected, flagged, never merged. */
static void test_a_camera_that_ignores_commands(void **state)
{
	struct camera camera = {.ignores = true};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	struct outcome outcome = run(pipeline, &camera, 60, 1.0F);
	assert_contains(capture_end(&capture), "ignores exposure commands");
	assert_true(outcome.last.flags & LP_ESTIMATE_EXPOSURE_IGNORED);
	assert_true(outcome.last.flags & LP_ESTIMATE_EXPOSURE_UNKNOWN);
	assert_int_equal(outcome.last.exposure_count, 1);
	assert_true(isnan(outcome.last.exposure_us));
	/* it is tried again, and works when the camera comes to its senses */
	camera.ignores = false;
	outcome = run(pipeline, &camera, 500, 1.0F);
	assert_int_equal(outcome.last.flags, 0);
	expect_right_light(&outcome, 1.0F, 0.03);
	lp_pipeline_destroy(pipeline);
}

/* Its frames tell by the light that is known how they were exposed, so that the light stays on one
 * scale; also while it is tried whether the camera follows by now. */
static void test_automatic_exposure_leaves_the_light(void **state)
{
	struct camera camera = {.ignores = true};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
	struct outcome outcome = run(pipeline, &camera, 60, 1.0F);
	const float light = outcome.last.sh_total[0][1];

	(void)state;
	for (int n = 0; n < 400; n++) {
		camera.in_effect_us *= n % 100 < 40 ? 0.98F : n % 100 < 80 ? 1.0F / 0.98F : 1.0F;
		outcome = run(pipeline, &camera, 1, 1.0F);
		assert_int_equal(outcome.refused, 0);
		assert_true(outcome.last.flags & LP_ESTIMATE_EXPOSURE_UNKNOWN);
		/* lamps clip: what is known of them is the more, the shorter the exposure is */
		assert_float_equal(outcome.last.sh_total[0][1] / light, 1.0, 0.06);
		assert_true(outcome.last.scale_sigma < 0.1F);
	}
	lp_pipeline_destroy(pipeline);
}

#define LUX_PER_UNIT 50.0

/* What a ring beside the camera reads: the sum over pixels of radiance, solid angle and cosine. */
static struct lp_ring_sample ring_sample(float level)
{
	const double step = M_PI / HEIGHT;
	struct lp_ring_sample sample = {0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		double irradiance = 0.0;
		float normal[3];

		lp_ring_direction(k, normal);
		for (int i = 0; i < WIDTH * HEIGHT; i++) {
			const double t = step * (i / WIDTH + 0.5),
				     l = step * (i % WIDTH + 0.5) - M_PI;
			const double facing = sin(t) * sin(l) * normal[0] + cos(t) * normal[1] -
					      sin(t) * cos(l) * normal[2];

			irradiance += fmax(facing, 0.0) * sin(t) * step * step * level *
				      radiance_at(i % WIDTH, i / WIDTH);
		}
		sample.illuminance_lux[k] = (float)(LUX_PER_UNIT * irradiance);
		sample.sigma_relative[k] = 0.03F;
	}
	return sample;
}

/* With a ring the light is absolute, however the camera exposes it. */
static void test_the_ring_makes_automatic_exposure_absolute(void **state)
{
	const float levels[] = {1.0F, 0.5F};
	struct camera camera = {.ignores = true};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 0);

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(levels); k++) {
		const struct lp_ring_sample sample = ring_sample(levels[k]);
		const double truth = LUX_PER_UNIT * true_mean(levels[k]);

		for (int n = 0; n < 60; n++) {
			camera.in_effect_us *= n < 30 ? 0.98F : 1.0F;
			lp_pipeline_ring(pipeline, &sample, &sample);
			const struct outcome outcome = run(pipeline, &camera, 1, levels[k]);
			const double light = outcome.last.cd_m2_per_unit *
					     outcome.last.sh_total[0][1] / sqrt(4.0 * M_PI);

			assert_true(outcome.last.flags & LP_ESTIMATE_EXPOSURE_UNKNOWN);
			if (n > 15)
				assert_float_equal(light / truth, 1.0, 0.1);
		}
	}
	lp_pipeline_destroy(pipeline);
}

/* The whole room darker or brighter at once looks like another exposure: it must not become one. */
static void test_a_change_of_all_light(void **state)
{
	const float levels[] = {0.06F, 1.0F, 4.0F, 0.3F};
	struct camera camera = {.delay_frames = 2, .step_us = 10.0F};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
	struct outcome outcome = run(pipeline, &camera, 100, 1.0F);

	(void)state;
	expect_right_light(&outcome, 1.0F, 0.03);
	for (unsigned int k = 0; k < LP_COUNT(levels); k++) {
		outcome = run(pipeline, &camera, 150, levels[k]);
		expect_right_light(&outcome, levels[k], 0.05);
		assert_false(outcome.last.flags & LP_ESTIMATE_EXPOSURE_IGNORED);
	}
	lp_pipeline_destroy(pipeline);
}

/* Whatever frame of the bracket it comes in: within so many frames, and until then one of the flags
 * says so. */
static void expect_soon(struct lp_pipeline *pipeline, struct camera *camera, float level,
			int frames, uint32_t flags)
{
	int right = 0;

	for (int n = 0; n < frames; n++) {
		const struct outcome outcome = run(pipeline, camera, 1, level);
		const double light = outcome.last.sh_total[0][1] / sqrt(4.0 * M_PI);

		if (!outcome.estimates)
			continue;
		right = fabs(light / true_mean(level) - 1.0) < 0.1 ? right + 1 : 0;
		assert_true(right || outcome.last.flags & flags);
		assert_false(outcome.last.flags & LP_ESTIMATE_EXPOSURE_IGNORED);
	}
	assert_true(right >= 1);
}

/* Fifty times darker or brighter: known within 0.4 s. */
static void test_sudden_changes_of_all_light(void **state)
{
	(void)state;
	for (int phase = 0; phase < 9; phase++) { /* three exposures, of three frames each */
		struct camera camera = {.delay_frames = 2, .step_us = 10.0F};
		struct lp_pipeline *pipeline = new_pipeline(&camera, 3);

		run(pipeline, &camera, 120 + phase, 1.0F);
		expect_soon(pipeline, &camera, 0.02F, 12, LP_ESTIMATE_BRACKET_INCOMPLETE);
		/* lamps clip until exposures are short enough again */
		run(pipeline, &camera, 60, 0.02F);
		expect_soon(pipeline, &camera, 1.0F, 12,
			    LP_ESTIMATE_BRACKET_INCOMPLETE | LP_ESTIMATE_CLIPPED);
		lp_pipeline_destroy(pipeline);
	}
}

static void test_darkness(void **state)
{
	struct camera camera = {.delay_frames = 2, .step_us = 10.0F};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);
	struct outcome outcome = run(pipeline, &camera, 150, 0.0F);

	(void)state;
	assert_true(outcome.estimates > 50);
	assert_true(outcome.last.flags & LP_ESTIMATE_UNDEREXPOSED);
	assert_false(outcome.last.flags & LP_ESTIMATE_EXPOSURE_IGNORED);
	outcome = run(pipeline, &camera, 150, 1.0F); /* and the light goes on */
	expect_right_light(&outcome, 1.0F, 0.05);
	lp_pipeline_destroy(pipeline);
}

/* Until a camera has ever done what it was told, a frame has what was commanded; from then on,
 * before that delay has passed, what it had. */
static void test_what_a_frame_most_likely_has(void **state)
{
	const struct lp_bracket_limits limits = {.min_us = 100, .max_us = 33000};
	struct lp_bracket b;

	(void)state;
	lp_bracket_init(&b, 3, &limits);
	b.state = LP_BRACKET_RUNNING;
	b.could = 2;
	b.settled_us = 16000;
	b.commanded_us = 250;
	lp_bracket_frame(&b, 1);
	b.frames_since_command = 0;
	assert_float_equal(lp_bracket_expected_us(&b, 2), 250, 0);
	b.delay.changes = 1;
	b.delay.least_frames = b.delay.most_frames = 3;
	assert_float_equal(lp_bracket_expected_us(&b, 2), 16000, 0);
	assert_float_equal(lp_bracket_expected_us(&b, 3), 16000, 0);
	assert_float_equal(lp_bracket_expected_us(&b, 4), 250, 0);
	b.could = 1;
	b.settled_us = 250;
	assert_float_equal(lp_bracket_expected_us(&b, 2), 250, 0);
}

/* One exposure when one suffices. */
static void test_number_of_exposures_by_the_scene(void **state)
{
	const struct lp_bracket_limits limits = {.min_us = 1.0F,
						 .max_us = 33000.0F,
						 .delay_frames = 0};
	const struct lp_exposure_matches newest = {{{NAN, 60.0F}, {1.0F, NAN}}};
	const struct {
		float median, peak;
		int count;
	} scenes[] = {{30.0F, 60.0F, 1}, {30.0F, 240.0F, 1}, {30.0F, 3000.0F, 2}, {30.0F, 1e5F, 4}};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(scenes); k++) {
		struct lp_bracket bracket;
		float command_us;

		lp_bracket_init(&bracket, 4, &limits);
		for (int n = 0; n < 400; n++) {
			lp_bracket_frame(&bracket, n);
			const struct lp_bracket_decision d = lp_bracket_judge(&bracket, &newest);
			/* something of the peak's brightness clips when it is put above 0.5 */
			const struct lp_bracket_scene scene = {
				.median = scenes[k].median,
				.peak = scenes[k].peak,
				.clipped =
					scenes[k].peak * bracket.plan.us[bracket.plan.count - 1] >
					0.5e6F};

			if (d.accept)
				lp_bracket_next(&bracket, &scene, &command_us);
		}
		assert_int_equal(bracket.plan.count, scenes[k].count);
		assert_true(scenes[k].peak * bracket.plan.us[bracket.plan.count - 1] < 0.5e6F);
		if (bracket.plan.count > 1)
			assert_float_equal(log2f(bracket.plan.us[0] * scenes[k].median / 0.25e6F),
					   0.0, 0.8);
	}
}

/* A lamp smaller than a cell clips while its cell's mean is low: the shortest exposure comes to
 * rest all the same, and lets go when the lamp goes out. */
static void test_a_lamp_smaller_than_a_cell(void **state)
{
	const struct lp_bracket_limits limits = {.min_us = 1.0F, .max_us = 33000.0F};
	struct lp_bracket bracket;
	float resting_us = 0.0F, command_us;

	(void)state;
	lp_bracket_init(&bracket, 3, &limits);
	for (int n = 0; n < 600; n++) {
		const bool on = n < 400;
		const float peak = on ? 3e4F : 60.0F, pixel = on ? 20.0F * peak : 80.0F;
		const float shortest_us = bracket.plan.us[bracket.plan.count - 1];
		const struct lp_bracket_scene scene = {.median = 30.0F,
						       .peak = peak,
						       .clipped = pixel * shortest_us > 1e6F};

		lp_bracket_frame(&bracket, n);
		if (lp_bracket_reported(&bracket, bracket.commanded_us).accept)
			lp_bracket_next(&bracket, &scene, &command_us);
		if (n == 200)
			resting_us = shortest_us;
		if (n > 200 && on)
			assert_float_equal(shortest_us, resting_us, 0.0);
	}
	assert_true(resting_us * 3e4F * 20.0F < 1e6F);
	assert_int_equal(bracket.plan.count, 1);
	assert_true(bracket.plan.us[0] > 500.0F);
}

/* A camera that looks around keeps a short exposure ready, where the scene that it sees needs none.
 */
static void test_a_camera_that_looks_around(void **state)
{
	const struct lp_bracket_limits limits = {.min_us = 1.0F, .max_us = 33000.0F};

	(void)state;
	for (int around = 0; around < 2; around++) {
		const struct lp_bracket_scene scene = {.median = 30.0F,
						       .peak = 60.0F,
						       .looks_around = around};
		struct lp_bracket bracket;
		float command_us;

		lp_bracket_init(&bracket, 3, &limits);
		for (int n = 0; n < 100; n++) {
			lp_bracket_frame(&bracket, n);
			if (lp_bracket_reported(&bracket, bracket.commanded_us).accept)
				lp_bracket_next(&bracket, &scene, &command_us);
		}
		assert_int_equal(bracket.plan.count, around ? 3 : 1);
		if (around)
			assert_float_equal(log2f(bracket.plan.us[0] / bracket.plan.us[2]), 10.0,
					   0.1);
	}
}

/* The governor changes the preset at any moment of a bracket: nothing is merged wrongly. */
static void test_another_preset_amid_a_bracket(void **state)
{
	struct camera camera = {.delay_frames = 3, .step_us = 10.0F};
	struct lp_pipeline *pipeline = new_pipeline(&camera, 3);

	(void)state;
	run(pipeline, &camera, 120, 1.0F);
	for (int moment = 0; moment < 6; moment++) {
		const bool lower = moment % 2 == 0;
		struct outcome outcome;

		run(pipeline, &camera, moment, 1.0F);
		assert_int_equal(lp_pipeline_set_preset(pipeline, lower ? LP_PRESET_FAST
									: LP_PRESET_BALANCED),
				 0);
		outcome = run(pipeline, &camera, 80, 1.0F);
		assert_int_equal(outcome.last.exposure_count, 3);
		assert_int_equal(outcome.last.flags, lower ? LP_ESTIMATE_DEGRADED : 0);
		assert_true(outcome.first_complete >= 0 && outcome.first_complete < 60);
		expect_right_light(&outcome, 1.0F, 0.03);
	}
	lp_pipeline_destroy(pipeline);
}

/* The ring says that the light is other before any frame does: the plan moves along, and what is
 * missing now is commanded first. Only where frames report their exposures. */
static void test_light_that_changes_between_frames(void **state)
{
	const struct lp_bracket_limits limits = {.min_us = 100, .max_us = 33000};
	struct lp_bracket b;
	float command_us = NAN;

	(void)state;
	lp_bracket_init(&b, 3, &limits);
	assert_false(lp_bracket_light_changed(&b, 10.0F, &command_us));
	lp_bracket_frame(&b, 1);
	(void)lp_bracket_reported(&b, lp_bracket_first_us(&b));
	b.plan.count = 3;
	b.plan.at = 1;
	memcpy(b.plan.us, (float[]){16000, 2000, 250}, 3 * sizeof(float));
	b.plan.shortest_us = 250;
	b.commanded_us = 2000;
	assert_false(lp_bracket_light_changed(&b, 1.3F, &command_us)); /* not worth it */
	assert_true(isnan(command_us));
	assert_true(lp_bracket_light_changed(&b, 2.0F, &command_us));
	assert_float_equal(command_us, 125.0F, 1.0F);
	assert_float_equal(b.plan.us[0], 8000.0F, 1.0F);
	assert_true(lp_bracket_light_changed(&b, 0.25F, &command_us));
	assert_float_equal(command_us, 32000.0F, 1.0F);
	b.report.waits = true;
	assert_false(lp_bracket_light_changed(&b, 4.0F, &command_us));
}

static void test_values_that_a_camera_can_take(void **state)
{
	const struct lp_source_caps silent = {.exposure_min_us = NAN,
					      .exposure_max_us = NAN,
					      .exposure_step_us = NAN,
					      .exposure_delay_frames = -1};
	const struct lp_bracket_limits any = lp_bracket_limits_of(&silent);
	const struct lp_bracket_limits steps = {.min_us = 100, .max_us = 50000, .step_us = 100};

	(void)state;
	assert_int_equal(any.delay_frames, -1);
	assert_true(lp_bracket_allowed(&any, 0.01F) == 1.0F);
	assert_true(lp_bracket_allowed(&any, 123.4F) == 123.4F);
	assert_true(lp_bracket_allowed(&any, 1e6F) == 33000.0F);
	assert_true(lp_bracket_allowed(&steps, 3.0F) == 100.0F);
	assert_true(lp_bracket_allowed(&steps, 149.0F) == 100.0F);
	assert_true(lp_bracket_allowed(&steps, 151.0F) == 200.0F);
	assert_true(lp_bracket_allowed(&steps, 1e6F) == 50000.0F);
}

/* Of a list the nearest in stops, and nothing between. */
static void test_values_of_a_list(void **state)
{
	const struct lp_source_caps caps = {.exposure_min_us = 62.5F,
					    .exposure_max_us = 33333.3F,
					    .exposure_count = 4,
					    .exposures_us = {62.5F, 1000, 8000, 33333.3F}};
	const struct lp_bracket_limits limits = lp_bracket_limits_of(&caps);

	(void)state;
	assert_true(lp_bracket_allowed(&limits, 1) == 62.5F);
	assert_true(lp_bracket_allowed(&limits, 240) == 62.5F);
	assert_true(lp_bracket_allowed(&limits, 260) == 1000);
	assert_true(lp_bracket_allowed(&limits, 2700) == 1000);
	assert_true(lp_bracket_allowed(&limits, 2900) == 8000);
	assert_true(lp_bracket_allowed(&limits, 1e9F) == 33333.3F);
}

/* A camera whose exposure was set before its stream began: the first frame counts. */
static void test_an_exposure_in_force_is_not_waited_for(void **state)
{
	const struct lp_exposure_matches nothing = {.codes = {{NAN}}}; /* of one candidate */
	struct lp_bracket_limits limits = {.min_us = 60.0F,
					   .max_us = 33000.0F,
					   .delay_frames = 30,
					   .in_force_us = 8000.0F};
	struct lp_bracket_decision decision;
	struct lp_bracket b;

	(void)state;
	lp_bracket_init(&b, 3, &limits);
	lp_bracket_frame(&b, 1);
	decision = lp_bracket_judge(&b, &nothing);
	assert_true(decision.accept);
	assert_float_equal(decision.exposure_us, 8000.0F, 0.1F);
	limits.in_force_us = 2000.0F;
	lp_bracket_init(&b, 3, &limits);
	lp_bracket_frame(&b, 1);
	assert_false(lp_bracket_judge(&b, &nothing).accept);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_an_exposure_in_force_is_not_waited_for),
		cmocka_unit_test(test_another_preset_amid_a_bracket),
		cmocka_unit_test(test_light_that_changes_between_frames),
		cmocka_unit_test(test_values_that_a_camera_can_take),
		cmocka_unit_test(test_values_of_a_list),
		cmocka_unit_test(test_reported_exposures_take_turns),
		cmocka_unit_test(test_reported_exposures_need_no_verifying),
		cmocka_unit_test(test_a_camera_that_ignores_commands),
		cmocka_unit_test(test_automatic_exposure_leaves_the_light),
		cmocka_unit_test(test_the_ring_makes_automatic_exposure_absolute),
		cmocka_unit_test(test_a_change_of_all_light),
		cmocka_unit_test(test_sudden_changes_of_all_light),
		cmocka_unit_test(test_darkness),
		cmocka_unit_test(test_what_a_frame_most_likely_has),
		cmocka_unit_test(test_number_of_exposures_by_the_scene),
		cmocka_unit_test(test_a_lamp_smaller_than_a_cell),
		cmocka_unit_test(test_a_camera_that_looks_around),
	};

	return cmocka_run_group_tests(tests, prepare, NULL);
}
