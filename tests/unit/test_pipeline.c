/* SPDX-License-Identifier: Apache-2.0 */
/* From frames to estimates: what the flags say, and that lights and SH belong together. */
#include "estimate/pipeline.h"

#include <errno.h>
#include <math.h>

#include "base/clock.h"
#include "light/send/model.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera_file.h"

static const struct lp_demand everything = {.sh_order = LP_MAX_SH_ORDER,
					    .max_lights = LP_MAX_LIGHTS};

static struct lp_pipeline *new_pipeline(enum lp_preset preset, int max_lights)
{
	const struct lp_pipeline_options options = {.preset = preset,
						    .max_lights = max_lights,
						    .sh_order = 2,
						    .smoothing_ms = 100.0F,
						    .ttl_ms = 1000.0F};
	struct lp_pipeline *pipeline;

	assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
	return pipeline;
}

static struct lp_light_estimate estimate(struct lp_pipeline *pipeline, struct lp_frame *frame)
{
	struct lp_estimates estimates;
	float command_us;

	assert_int_equal(lp_pipeline_process(pipeline, frame, &everything, &estimates, &command_us),
			 0);
	assert_true(isnan(command_us)); /* no bracket: the camera is left alone */
	return estimates.raw;
}

static double total_irradiance(const struct lp_light_estimate *e, const float normal[3])
{
	float rgb[3];

	lp_sh_irradiance(2, (const float(*)[3])e->sh_total, normal, rgb);
	return rgb[1];
}

static void test_lamps_and_ambient(void **state)
{
	const struct disc discs[] = {{30, 20, 2, 400}, {180, 50, 0.3, 2e4}, {-60, -30, 6, 40}};
	const enum lp_preset presets[] = {LP_PRESET_BALANCED, LP_PRESET_ACCURATE,
					  LP_PRESET_REFERENCE};

	(void)state;
	for (unsigned int p = 0; p < LP_COUNT(presets); p++) {
		struct lp_pipeline *pipeline = new_pipeline(presets[p], 8);
		const struct lp_light_estimate e =
			estimate(pipeline, scene_frame(1920, 960, discs, 3, 1.5));
		float ambient[LP_MAX_SH_COUNT][3];

		assert_int_equal(e.light_count, 3);
		assert_int_equal(e.flags, 0);
		for (int k = 0; k < 3; k++) {
			double d[3], best = 180.0;

			disc_direction(&discs[k], d);
			for (int j = 0; j < 3; j++)
				best = fmin(best, angle_between_deg(d, e.lights[j].direction));
			assert_true(best < 0.1);
		}
		for (int j = 0; j < 3; j++) {
			assert_true(e.lights[j].id != 0);
			assert_true(lp_facing_share(&e, j) > 0.1F);
			if (j)
				assert_true(e.lights[j].irradiance[1] <=
					    e.lights[j - 1].irradiance[1]);
		}
		/* without the lamps an even sphere of 1.5 is left */
		lp_model_ambient(&e, 2, 3, ambient);
		assert_float_equal(ambient[0][1] / (1.5 * sqrt(4.0 * M_PI)), 1.0, 0.01);
		for (int i = 1; i < 9; i++)
			assert_float_equal(ambient[i][1] / ambient[0][1], 0.0, 0.03);
		lp_pipeline_destroy(pipeline);
	}
}

/* Lights that are not listed stay in AMBIENT. */
static void test_light_limit(void **state)
{
	struct disc discs[9];
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 3);

	(void)state;
	for (int k = 0; k < 9; k++)
		discs[k] = (struct disc){40.0 * k, k % 2 ? 20 : -20, 2, 100.0 + 10 * k};
	const struct lp_light_estimate e = estimate(pipeline, scene_frame(960, 480, discs, 9, 0.5));

	assert_int_equal(e.light_count, 3);
	assert_true(e.flags & LP_ESTIMATE_MORE_LIGHTS);
	assert_true(e.lights[0].irradiance[1] >= e.lights[2].irradiance[1]);
	lp_pipeline_destroy(pipeline);
}

/* Without a subscriber of lamps none is looked for; else there are some to choose from. */
static void test_demand(void **state)
{
	const struct disc discs[] = {{30, 20, 2, 400}, {-60, -30, 6, 40}};
	const struct lp_demand demands[] = {{.sh_order = 2, .max_lights = 1}, {.sh_order = 2}};
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 8);
	struct lp_estimates estimates;
	float command_us;

	(void)state;
	for (int k = 0; k < 2; k++) {
		assert_int_equal(lp_pipeline_process(pipeline, scene_frame(480, 240, discs, 2, 1.0),
						     &demands[k], &estimates, &command_us),
				 0);
		assert_int_equal(estimates.raw.light_count, demands[k].max_lights ? 2 : 0);
		/* what is not listed is still in the total */
		assert_float_equal(estimates.raw.sh_total[0][1] / sqrt(4.0 * M_PI),
				   1.0 + (disc_irradiance(&discs[0]) + disc_irradiance(&discs[1])) /
						   (4.0 * M_PI),
				   0.05);
	}
	lp_pipeline_destroy(pipeline);
}

static void test_black_and_white(void **state)
{
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 8);
	struct lp_light_estimate e = estimate(pipeline, scene_frame(480, 240, NULL, 0, 0.0));
	struct lp_frame *white;

	(void)state;
	assert_true(e.flags & LP_ESTIMATE_NO_LIGHT);
	assert_int_equal(e.light_count, 0);
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		assert_float_equal(e.sh_total[i][0], 0.0, 0.0);
	assert_float_equal(e.predicted_error[0][0], 0.0, 0.0);

	e = estimate(pipeline, scene_frame(480, 240, NULL, 0, 3.0)); /* white furnace */
	assert_int_equal(e.flags, 0);
	for (int n = 0; n < 50; n++) {
		const float a = 0.5F * (float)n, y = 1.0F - 2.0F * ((float)n + 0.5F) / 50.0F;
		const float r = sqrtf(1.0F - y * y);
		const float normal[3] = {r * cosf(a), y, r * sinf(a)};

		assert_float_equal(total_irradiance(&e, normal) / (3.0 * M_PI), 1.0, 1e-5);
	}

	white = new_frame(LP_FORMAT_GREY, 480, 240, 480, (size_t)480 * 240);
	memset((void *)white->data, 255, white->size_bytes);
	white->exposure_us = 1000.0F;
	e = estimate(pipeline, white); /* saturated everywhere: a lower bound, and said so */
	assert_true(e.flags & LP_ESTIMATE_CLIPPED);
	assert_float_equal(e.sh_total[0][1] / (1000.0 * sqrt(4.0 * M_PI)), 1.0, 1e-4);
	lp_pipeline_destroy(pipeline);
}

static void test_flags_of_bad_light(void **state)
{
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 8);
	struct lp_frame *frame = new_frame(LP_FORMAT_GREY, 480, 240, 480, (size_t)480 * 240);

	(void)state;
	memset((void *)frame->data, 2, frame->size_bytes);
	assert_int_equal(estimate(pipeline, frame).flags,
			 LP_ESTIMATE_EXPOSURE_UNKNOWN | LP_ESTIMATE_UNDEREXPOSED);
	frame = new_float_frame(480, 240);
	for (int i = 0; i < 480 * 240 * 3; i++)
		((float *)frame->data)[i] = i % 1000 ? 1.0F : NAN;
	assert_int_equal(estimate(pipeline, frame).flags, LP_ESTIMATE_INVALID_INPUT);
	lp_pipeline_destroy(pipeline);
}

/* A bad frame in mid-stream: refused, and the next one goes on with the same ids. */
static void test_stream_goes_on(void **state)
{
	const struct disc disc = {30, 20, 2, 400};
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 8);
	const struct lp_light_estimate first =
		estimate(pipeline, scene_frame(480, 240, &disc, 1, 1.0));
	struct lp_frame *bad = new_float_frame(480, 240);
	struct lp_estimates estimates;
	struct capture capture;
	float command_us;

	(void)state;
	bad->size_bytes = 100;
	capture_begin(&capture);
	assert_int_equal(lp_pipeline_process(pipeline, bad, &everything, &estimates, &command_us),
			 -EBADMSG);
	assert_contains(capture_end(&capture), "frame");
	const struct lp_light_estimate second =
		estimate(pipeline, scene_frame(480, 240, &disc, 1, 1.0));

	assert_int_equal(second.lights[0].id, first.lights[0].id);
	assert_int_equal(second.sequence, first.sequence + 1);
	lp_pipeline_destroy(pipeline);
}

/* Lowered and raised again while frames come: flagged, and right all the way. */
static void test_another_preset_in_the_middle(void **state)
{
	const struct disc discs[] = {{30, 20, 2, 400}};
	const enum lp_preset steps[] = {LP_PRESET_ACCURATE, LP_PRESET_BALANCED, LP_PRESET_FAST,
					LP_PRESET_FAST, LP_PRESET_ACCURATE};
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_ACCURATE, 8);
	uint32_t sequence = 0;

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(steps); k++) {
		assert_int_equal(lp_pipeline_set_preset(pipeline, steps[k]), 0);
		for (int frame = 0; frame < 2; frame++) {
			const struct lp_light_estimate e =
				estimate(pipeline, scene_frame(960, 480, discs, 1, 1.5));

			assert_int_equal(e.sequence, ++sequence);
			assert_int_equal(e.light_count, 1);
			assert_true(e.lights[0].direction[1] > 0.33F);
			assert_true(e.lights[0].direction[1] < 0.355F);
			assert_int_equal(!!(e.flags & LP_ESTIMATE_DEGRADED),
					 steps[k] < LP_PRESET_ACCURATE);
		}
	}
	lp_pipeline_destroy(pipeline);
}

/* The same scene as an 8-bit camera frame; full scale is radiance 500. */
static struct lp_frame *coded_frame(int width, int height, const struct disc *discs, int count)
{
	struct lp_frame *radiance = scene_frame(width, height, discs, count, 1.5);
	struct lp_frame *frame =
		new_frame(LP_FORMAT_GREY, width, height, width, (size_t)width * height);
	const float *rgb = (const float *)radiance->data;
	uint8_t *codes = (uint8_t *)frame->data;

	for (int i = 0; i < width * height; i++)
		codes[i] = (uint8_t)lrintf(255.0F * powf(fminf(rgb[3 * i] / 500.0F, 1), 1 / 2.2F));
	lp_frame_release(radiance);
	return frame;
}

/* Each knob by itself makes of one preset what another is. */
static void test_knobs(void **state)
{
	const struct disc discs[] = {{30, 20, 1, 400}, {-100, 40, 3, 90}};
	const struct lp_pipeline_options base = {.preset = LP_PRESET_BALANCED,
						 .max_lights = 8,
						 .sh_order = 2};
	struct lp_pipeline_options options[] = {base, base, base, base};
	struct lp_light_estimate e[4];

	(void)state;
	options[1].refine_cells = LP_NONE;
	options[2].preset = LP_PRESET_ACCURATE;
	options[3].preset = LP_PRESET_ACCURATE;
	options[3].decode_divisor = LP_DECODE_BY_BLOCKS;
	for (int k = 0; k < 4; k += 3) {
		options[k].exact_blocks = 20;
		options[k].refine_cells = 60;
	}
	for (unsigned int k = 0; k < LP_COUNT(options); k++) {
		struct lp_pipeline *pipeline;

		assert_int_equal(lp_pipeline_create(&options[k], &pipeline), 0);
		e[k] = estimate(pipeline, coded_frame(1920, 960, discs, 2));
		lp_pipeline_destroy(pipeline);
	}
	assert_memory_equal(e[0].lights, e[3].lights, sizeof(e[0].lights));
	assert_memory_equal(e[0].sh_total, e[3].sh_total, sizeof(e[0].sh_total));
	assert_memory_not_equal(e[0].lights, e[1].lights, sizeof(e[0].lights));
	assert_memory_not_equal(e[0].sh_total, e[2].sh_total, sizeof(e[0].sh_total));
}

/* Radiance of coded_frame()'s even surround, as an sRGB camera understands its code. */
static double surround(void)
{
	const double code = rint(255.0 * pow(1.5 / 500.0, 1 / 2.2)) / 255.0;

	return pow((code + 0.055) / 1.055, 2.4);
}

/* What a ring beside the camera reads of discs in that; full scale is radiance 1. */
static struct lp_ring_sample ring_sample(const struct disc *discs, int count, double lux_per_unit)
{
	struct lp_ring_sample sample = {0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		double irradiance = surround() * M_PI;
		float normal[3];

		lp_ring_direction(k, normal);
		for (int i = 0; i < count; i++) {
			double d[3];

			disc_direction(&discs[i], d);
			irradiance +=
				disc_irradiance(&discs[i]) / 500.0 *
				fmax(d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2], 0.0);
		}
		sample.illuminance_lux[k] = (float)(lux_per_unit * irradiance);
		sample.sigma_relative[k] = 0.03F;
	}
	return sample;
}

/* A lamp that clips has its strength by the ring, and AMBIENT stays what it was; without a ring it
 * is a lower bound. What does not clip is not touched, to the bit. */
static void test_the_ring_finds_what_clips(void **state)
{
	const struct disc clipped[] = {{30, 20, 1.5, 9000}, {180, 40, 2, 300}};
	const struct disc plain[] = {{30, 20, 1.5, 150}, {180, 40, 2, 300}};
	const struct lp_pipeline_options options = {.preset = LP_PRESET_ACCURATE,
						    .max_lights = 8,
						    .sh_order = 2,
						    .scale = {200.0F, 0.03F}};
	const double truth = disc_irradiance(&clipped[0]) / 500.0;
	struct lp_light_estimate e[4];

	(void)state;
	for (int k = 0; k < 4; k++) {
		const struct disc *discs = k < 2 ? clipped : plain;
		const struct lp_ring_sample sample = ring_sample(discs, 2, 200.0);
		struct lp_frame *frame = coded_frame(1920, 960, discs, 2);
		struct lp_pipeline *pipeline;

		frame->exposure_us = 1e6F;
		frame->gain = 1.0F;
		assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
		lp_pipeline_ring(pipeline, k % 2 ? &sample : NULL, NULL);
		e[k] = estimate(pipeline, frame);
		lp_pipeline_destroy(pipeline);
	}
	assert_true(e[0].lights[0].irradiance[1] < 0.2 * truth);
	assert_true(isnan(e[0].lights[0].irradiance_sigma));
	assert_int_equal(e[0].lights[0].flags, LP_LIGHT_CLIPPED);
	assert_float_equal(e[1].lights[0].irradiance[1] / truth, 1.0, 0.1);
	assert_true(e[1].lights[0].irradiance_sigma > 0.005F &&
		    e[1].lights[0].irradiance_sigma < 0.1F);
	assert_int_equal(e[1].lights[0].flags, LP_LIGHT_CLIPPED | LP_LIGHT_RING);
	assert_true(e[1].relighting_sigma < e[0].relighting_sigma);
	for (int k = 0; k < 2; k++) {
		float ambient[LP_MAX_SH_COUNT][3];

		lp_model_ambient(&e[k], 2, e[k].light_count, ambient);
		assert_float_equal(ambient[0][1] / (surround() * sqrt(4.0 * M_PI)), 1.0, 0.05);
	}
	assert_memory_equal(e[2].lights, e[3].lights, sizeof(e[2].lights));
	assert_memory_equal(e[2].sh_total, e[3].sh_total, sizeof(e[2].sh_total));
	assert_float_equal(e[3].cd_m2_per_unit, 200.0, 8.0);
	assert_true(e[3].cd_m2_per_unit_sigma < 0.03F);
}

static void test_options_are_checked(void **state)
{
	static char path[] = "room.camera";
	const struct lp_camera_file no_projection = {.ini = {.path = path}, .projection = -1};
	struct lp_pipeline_options options = {.max_lights = 9};
	struct lp_pipeline *pipeline;
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(lp_pipeline_create(&options, &pipeline), -EINVAL);
	options = (struct lp_pipeline_options){.panorama_width = 100};
	assert_int_equal(lp_pipeline_create(&options, &pipeline), -EINVAL);
	options = (struct lp_pipeline_options){.exact_blocks = 1 << 20};
	assert_int_equal(lp_pipeline_create(&options, &pipeline), -EINVAL);
	options = (struct lp_pipeline_options){.cameras = {&no_projection}};
	assert_int_equal(lp_pipeline_create(&options, &pipeline), -EBADMSG);
	assert_contains(capture_end(&capture),
			"room.camera: camera file: [camera] needs projection");
	lp_pipeline_destroy(NULL);
}

/* A frame of discs at frame `number`, 30 per second, of a known exposure. */
static struct lp_frame *timed_frame(const struct disc *discs, int count, int number)
{
	struct lp_frame *frame = coded_frame(960, 480, discs, count);

	frame->t_read_ns = 2 * LP_NS_PER_S + number * LP_NS_PER_S / 30;
	frame->exposure_us = 1e6F;
	frame->gain = 1.0F;
	return frame;
}

/* Between frames a lamp goes off, as the ring says; then a frame comes that was taken before; then
 * one that shows it. The lamp is gone from the first of these on, raw and smoothed, and all else is
 * as it was. */
static void test_a_lamp_goes_off_between_frames(void **state)
{
	const struct disc discs[] = {{30, 20, 2, 300}, {180, 40, 2, 250}};
	const struct lp_pipeline_options options = {.preset = LP_PRESET_BALANCED,
						    .max_lights = 8,
						    .sh_order = 2,
						    .smoothing_ms = 300.0F,
						    .scale = {200.0F, 0.03F}};
	struct lp_ring_sample both = ring_sample(discs, 2, 200.0);
	struct lp_ring_sample one = ring_sample(discs, 1, 200.0);
	struct lp_pipeline *pipeline;
	struct lp_estimates e;
	float commands_us[LP_MAX_CAMERAS];

	(void)state;
	assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
	one.t_ns = LP_NS_PER_S;
	assert_int_equal(lp_pipeline_step(pipeline, &one, &e, commands_us), -EAGAIN);
	for (int n = 0; n < 5; n++) {
		both.t_ns = LP_NS_PER_S + n * LP_NS_PER_S / 30;
		lp_pipeline_ring(pipeline, &both, &both);
		assert_int_equal(estimate(pipeline, timed_frame(discs, 2, n)).light_count, 2);
	}
	both.t_ns += LP_NS_PER_S / 100;
	assert_int_equal(lp_pipeline_step(pipeline, &both, &e, commands_us), -EAGAIN);
	one.t_ns = both.t_ns + LP_NS_PER_S / 100;
	assert_int_equal(lp_pipeline_step(pipeline, &one, &e, commands_us), 0);
	assert_true(isnan(commands_us[0])); /* no bracket */
	const struct lp_light kept = e.raw.lights[0];
	const float lit = e.raw.sh_total[0][1];
	const int64_t t_frame_ns = e.raw.t_capture_ns;

	assert_int_equal(e.raw.light_count, 1);
	assert_int_equal(e.smoothed.light_count, 1);
	assert_float_equal(kept.irradiance[1], disc_irradiance(&discs[0]) / 500.0, 0.05);
	assert_float_equal(e.smoothed.sh_total[0][1], lit, 0.02F * lit);
	/* the same again is not worth telling */
	one.t_ns += LP_NS_PER_S / 100;
	assert_int_equal(lp_pipeline_step(pipeline, &one, &e, commands_us), -EAGAIN);
	for (int n = 5; n < 12; n++) {
		lp_pipeline_ring(pipeline, n == 5 ? &both : &one, &one);
		assert_int_equal(lp_pipeline_process(pipeline,
						     timed_frame(discs, n == 5 ? 2 : 1, n),
						     &everything, &e, commands_us),
				 0);
		assert_true(e.raw.t_capture_ns > t_frame_ns);
		assert_int_equal(e.raw.light_count, 1);
		assert_int_equal(e.raw.lights[0].id, kept.id);
		assert_float_equal(e.raw.sh_total[0][1], lit, 0.03F * lit);
		assert_float_equal(e.smoothed.sh_total[0][1], lit, 0.03F * lit);
		one.t_ns += LP_NS_PER_S / 30;
	}
	lp_pipeline_destroy(pipeline);
}

/* A lens that sees three quarters of the sphere or a sixth of it, and the same picture again and
 * again: an even wall, with or without a lamp. What stands in for the rest never adds to itself. */
static void test_what_is_not_seen_does_not_grow(void **state)
{
	static char path[] = "module.camera";
	enum { SIDE_PX = 240, FRAMES = 60 };
	const float seen_deg[] = {120.0F, 97.0F, 88.0F, 48.0F};

	(void)state;
	for (unsigned int k = 0; k < 2 * LP_COUNT(seen_deg); k++) {
		const float theta_deg = seen_deg[k / 2];
		const float px_per_rad = SIDE_PX / 2.0F / (theta_deg * (float)M_PI / 180.0F);
		struct lp_camera_file camera = {.ini = {.path = path},
						.projection = LP_FISHEYE,
						.width_px = SIDE_PX,
						.height_px = SIDE_PX,
						.read_out_ms = NAN};
		camera.lens[0] = (struct lp_lens_fields){.present = true,
							 .cx_px = SIDE_PX / 2.0F,
							 .cy_px = SIDE_PX / 2.0F,
							 .fx_px = px_per_rad,
							 .fy_px = px_per_rad,
							 .max_theta_deg = theta_deg};
		const struct lp_pipeline_options options = {.cameras = {&camera},
							    .preset = LP_PRESET_ACCURATE,
							    .max_lights = 8,
							    .sh_order = 2};
		struct lp_pipeline *pipeline;
		float first = 0.0F;

		assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
		for (int n = 0; n < FRAMES; n++) {
			struct lp_frame *frame = new_float_frame(SIDE_PX, SIDE_PX);
			float *rgb = (float *)frame->data;

			for (int i = 0; i < 3 * SIDE_PX * SIDE_PX; i++)
				rgb[i] = 1.0F;
			for (int i = 0; i < 3 * 64 && k % 2; i++) /* 8 x 8 pixels */
				rgb[3 * (SIDE_PX * (100 + i / 24) + 100) + i % 24] = 100.0F;
			frame->t_read_ns = 2 * LP_NS_PER_S + n * LP_NS_PER_S / 30;
			const struct lp_light_estimate e = estimate(pipeline, frame);
			float ambient[LP_MAX_SH_COUNT][3];

			lp_model_ambient(&e, 2, e.light_count, ambient);
			first = n ? first : e.sh_total[0][1];
			assert_true(e.flags & LP_ESTIMATE_PARTIAL_VIEW);
			assert_int_equal(e.light_count, k % 2);
			assert_float_equal(e.sh_total[0][1] / first, 1.0, 1e-3);
			assert_float_equal(ambient[0][1] / sqrt(4.0 * M_PI), 1.0, 0.02);
		}
		lp_pipeline_destroy(pipeline);
	}
}

/* Which discs shine, and when lamps are looked for; 30 frames a second. */
struct story {
	double apart_deg; /* of the second lamp from the first */
	int off, on;	  /* frames at which the first one goes, and the second comes */
	int looked_for;	  /* from this frame on */
	bool listed;	  /* the second one, in the end */
};

static bool second_lamp_is_listed(const struct story *story)
{
	const struct disc discs[] = {{0.0, 10.0, 2.0, 400.0}, {story->apart_deg, 10.0, 2.0, 100.0}};
	struct lp_pipeline *pipeline = new_pipeline(LP_PRESET_BALANCED, 8);
	struct lp_estimates estimates;
	bool found = false;
	double d[3];

	disc_direction(&discs[1], d);
	for (int n = 0; n < 100; n++) {
		const bool both = n < story->off && n >= story->on,
			   none = n >= story->off && n < story->on;
		struct lp_frame *frame = scene_frame(240, 120, discs + (n >= story->off),
						     none   ? 0
						     : both ? 2
							    : 1,
						     1.0);
		const struct lp_demand demand = {.sh_order = 2,
						 .max_lights = n >= story->looked_for ? 8 : 0};
		float command_us;

		/* after the first one the camera sees nothing for long */
		frame->t_read_ns = (n ? 1000 : 1) * 1000000000LL + n * 33333333LL;
		assert_int_equal(lp_pipeline_process(pipeline, frame, &demand, &estimates,
						     &command_us),
				 0);
	}
	for (int k = 0; k < estimates.smoothed.light_count; k++)
		found |= angle_between_deg(d, estimates.smoothed.lights[k].direction) < 3.0;
	lp_pipeline_destroy(pipeline);
	return found;
}

/* A lamp's light is judged where the lamp is: it has come, whatever other lamps do meanwhile, and
 * the lamp is listed. Where a lamp has only been told apart it waits, but in the first frame. */
static void test_whether_light_came(void **state)
{
	static const struct story stories[] = {
		{20.0, 60, 60, 0, true},   {45.0, 60, 60, 0, true},   {180.0, 60, 60, 0, true},
		{45.0, 100, 60, 0, true},  {45.0, 40, 60, 0, true},   {45.0, 60, 0, 0, true},
		{45.0, 100, 0, 60, false}, {45.0, 100, 45, 60, true}, {45.0, 100, 33, 60, false},
		{45.0, 60, 0, 60, false},
	};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(stories); i++)
		assert_int_equal(second_lamp_is_listed(&stories[i]), stories[i].listed);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_lamps_and_ambient),
		cmocka_unit_test(test_light_limit),
		cmocka_unit_test(test_demand),
		cmocka_unit_test(test_black_and_white),
		cmocka_unit_test(test_flags_of_bad_light),
		cmocka_unit_test(test_stream_goes_on),
		cmocka_unit_test(test_another_preset_in_the_middle),
		cmocka_unit_test(test_knobs),
		cmocka_unit_test(test_the_ring_finds_what_clips),
		cmocka_unit_test(test_a_lamp_goes_off_between_frames),
		cmocka_unit_test(test_what_is_not_seen_does_not_grow),
		cmocka_unit_test(test_whether_light_came),
		cmocka_unit_test(test_options_are_checked),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
