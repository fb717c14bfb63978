/* SPDX-License-Identifier: Apache-2.0 */
/* Stills beside a live camera: what they tell of lamps that the live one clips, how it ages, and
 * what tells nothing any more when it comes. */
#include "estimate/pipeline.h"

#include <errno.h>
#include <math.h>

#include "jpeg_encode.h"
#include "lp_test.h"
#include "scene.h"

#define LIVE 0
#define STILLS 1
#define LIVE_US 1e6F  /* full scale: radiance 1 */
#define STILL_US 5e3F /* full scale: radiance 200 */
#define BACKGROUND 0.3

static const struct lp_demand everything = {.sh_order = LP_MAX_SH_ORDER,
					    .max_lights = LP_MAX_LIGHTS};
/* A lamp of several cells of the panorama, and one that only pixels measure. */
static const struct disc lamps[] = {{30, 20, 1.5, 100}, {30, 20, 0.3, 150}};
static struct disc lamp, dim;

static struct lp_pipeline *pipeline;
static double now_s, step_s; /* of live frames */
static int width_px, height_px;

/* Of lamps[]; dim: as many times weaker as no longer clips. */
static void choose(int k, int width)
{
	lamp = dim = lamps[k];
	dim.radiance *= 0.003;
	width_px = width;
	height_px = width / 2;
}

static int setup(void **state)
{
	const struct lp_pipeline_options options = {.camera_count = 2,
						    .preset = LP_PRESET_ACCURATE,
						    .max_lights = 8,
						    .sh_order = 2,
						    .orientation = LP_ORIENTATION_VISUAL};

	(void)state;
	now_s = step_s = 1.0;
	choose(0, 960);
	return lp_pipeline_create(&options, &pipeline);
}

static int teardown(void **state)
{
	(void)state;
	lp_pipeline_destroy(pipeline);
	return 0;
}

static double srgb_encode(double linear)
{
	return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

/* The last picture that was rendered: most are wanted again. */
static struct {
	struct disc disc;
	float exposure_us;
	int width_px;
	uint8_t codes[1920 * 960];
} rendered;

/* A camera's picture of the disc, and of some more for it to hold on to. */
static void render(const struct disc *disc, float exposure_us)
{
	const struct disc discs[] = {*disc, {-80, 10, 20, 0.2}, {150, -20, 15, 0.3}};
	double *radiance;

	if (memcmp(&rendered.disc, disc, sizeof(*disc)) == 0 &&
	    rendered.exposure_us == exposure_us && rendered.width_px == width_px)
		return;
	radiance = render_scene(discs, 3, BACKGROUND, width_px, height_px);
	for (int i = 0; i < width_px * height_px; i++)
		rendered.codes[i] = (uint8_t)lround(
			255.0 * srgb_encode(fmin(radiance[i] * (double)exposure_us * 1e-6, 1.0)));
	free(radiance);
	rendered.disc = *disc;
	rendered.exposure_us = exposure_us;
	rendered.width_px = width_px;
}

static struct lp_frame *picture(const struct disc *disc, float exposure_us, double t_s)
{
	struct lp_frame *frame = new_frame(LP_FORMAT_GREY, width_px, height_px, width_px,
					   (size_t)width_px * height_px);

	render(disc, exposure_us);
	memcpy((uint8_t *)frame->data, rendered.codes, frame->size_bytes);
	frame->exposure_us = exposure_us;
	frame->gain = 1.0F;
	frame->t_read_ns = frame->t_arrival_ns = (int64_t)(t_s * 1e9 + 1e3 * (double)exposure_us);
	return frame;
}

static struct lp_light_estimate process(struct lp_frame *frame, int camera, int expected)
{
	static struct lp_estimates estimates;
	float command_us;

	frame->camera = (uint8_t)camera;
	assert_int_equal(lp_pipeline_process(pipeline, frame, &everything, &estimates, &command_us),
			 expected);
	return estimates.raw;
}

static struct lp_light_estimate live(const struct disc *disc, double seconds)
{
	struct lp_light_estimate estimate = {0};

	for (const double end_s = now_s + seconds; now_s < end_s; now_s += step_s)
		estimate = process(picture(disc, LIVE_US, now_s), LIVE, 0);
	return estimate;
}

static struct lp_light_estimate still(const struct disc *disc, double age_s, int expected)
{
	struct lp_frame *frame = picture(disc, STILL_US, now_s - age_s);

	frame->flags = LP_FRAME_STILL;
	return process(frame, STILLS, expected);
}

/* The lamp among the lights; its irradiance 0: it is not there. */
static struct lp_light find(const struct lp_light_estimate *estimate)
{
	double d[3];

	disc_direction(&lamp, d);
	for (int k = 0; k < estimate->light_count; k++)
		if (angle_between_deg(d, estimate->lights[k].direction) < 2.0)
			return estimate->lights[k];
	return (struct lp_light){0};
}

/* Live frames for a while; the lamp stays what it was, less and less certain. */
static struct lp_light_estimate age(double seconds, const struct lp_light_estimate *before)
{
	const struct lp_light_estimate after = live(&lamp, seconds);
	const struct lp_light then = find(before), now = find(&after);

	assert_int_equal(now.id, then.id);
	assert_float_equal(now.irradiance[1] / disc_irradiance(&lamp), 1.0, 0.05);
	assert_false(now.flags & LP_LIGHT_CLIPPED);
	assert_true(now.irradiance_sigma > then.irradiance_sigma);
	assert_true(after.relighting_sigma > before->relighting_sigma);
	return after;
}

/* The sun once a minute: it stays, and becomes less certain. */
static void test_a_still_shows_what_the_live_camera_clips(void **state)
{
	(void)state;
	for (int k = 0; k < 2; k++) {
		struct lp_light_estimate before, after;
		struct lp_light found;

		choose(k, k ? 1920 : 960);
		before = live(&lamp, 3.0);
		assert_true(before.flags & LP_ESTIMATE_CLIPPED);
		assert_true(find(&before).irradiance[1] < 0.2 * disc_irradiance(&lamp));
		after = still(&lamp, 2.0, 0);
		found = find(&after);
		assert_float_equal(found.irradiance[1] / disc_irradiance(&lamp), 1.0, 0.05);
		assert_false(found.flags & LP_LIGHT_CLIPPED);
		assert_false(after.flags & LP_ESTIMATE_CLIPPED);
		/* time does not go back for who reads the estimates */
		assert_true(after.t_capture_ns >= before.t_capture_ns);
		for (int step = 0; step < 3; step++)
			after = age(20.0, &after);
		/* 10 % per root second (vision/map/radiance_map.cpp, light/lamps/lamp_memory.c) */
		assert_float_equal(find(&after).irradiance_sigma, 0.1 * sqrt(62.0), 0.1);
		after = still(&lamp, 2.0, 0);
		assert_true(find(&after).irradiance_sigma < 0.3);
		teardown(NULL);
		setup(NULL);
	}
}

/* Clouds come: the live camera sees that the sun does not clip any more. */
static void test_it_vanishes_when_the_live_camera_sees_less(void **state)
{
	struct lp_light_estimate estimate;

	(void)state;
	for (int k = 0; k < 2; k++) {
		choose(k, k ? 1920 : 960);
		(void)live(&lamp, 3.0);
		(void)still(&lamp, 2.0, 0);
		(void)live(&lamp, 20.0);
		estimate = live(&dim, 2.0);
		assert_true(find(&estimate).irradiance[1] < 2.0 * disc_irradiance(&dim));
		teardown(NULL);
		setup(NULL);
	}
}

/* What was taken before the lamp was switched off comes afterwards. */
static void test_a_still_of_other_light_is_left_out(void **state)
{
	const struct disc large = {30, 20, 12, 0.6}, off = {30, 20, 12, 0};
	struct lp_light_estimate before, after;

	(void)state;
	step_s = 0.25;
	(void)live(&large, 3.0);
	before = live(&off, 2.0);
	(void)still(&large, 3.0, -EAGAIN);
	after = live(&off, 0.5);
	assert_float_equal(after.sh_total[0][1] / before.sh_total[0][1], 1.0, 0.005);
	/* one that was taken since then counts */
	(void)still(&off, 1.0, 0);
}

/* Little light that changed meanwhile: the newer frames are right there. */
static void test_a_still_does_not_overrule_newer_frames(void **state)
{
	const struct disc small = {100, 0, 2, 0.6}, off = {100, 0, 2, 0};
	struct lp_light_estimate before, after;

	(void)state;
	(void)live(&small, 3.0);
	before = live(&off, 4.0);
	after = still(&small, 5.5, 0);
	assert_int_equal(after.light_count, before.light_count);
	assert_float_equal(after.sh_total[0][1] / before.sh_total[0][1], 1.0, 0.005);
}

static void turn_right(struct lp_frame *frame, int px)
{
	uint8_t *data = (uint8_t *)frame->data, row[4096];

	for (int y = 0; y < height_px; y++) {
		memcpy(row, data + (size_t)y * width_px, (size_t)width_px);
		for (int x = 0; x < width_px; x++)
			data[(size_t)y * width_px + (x + px) % width_px] = row[x];
	}
}

static void test_a_still_from_before_a_turn_is_left_out(void **state)
{
	(void)state;
	(void)live(&lamp, 3.0);
	for (int k = 1; k <= 10; k++, now_s += 0.05) {
		struct lp_frame *frame = picture(&lamp, LIVE_US, now_s);

		turn_right(frame, 4 * k);
		(void)process(frame, LIVE, 0);
	}
	(void)still(&lamp, 1.0, -EAGAIN);
}

/* Stills alone: an estimate with each. */
static void test_stills_alone(void **state)
{
	struct lp_light_estimate estimate;

	(void)state;
	for (int k = 0; k < 3; k++, now_s += 60.0) {
		estimate = still(&lamp, 2.0, 0);
		assert_float_equal(find(&estimate).irradiance[1] / disc_irradiance(&lamp), 1.0,
				   0.05);
	}
}

/* Light of a JPEG of that width. */
static float light_of(enum lp_preset preset, int width)
{
	static const struct jpeg_kind kind = {.components = 3, .h = 2, .v = 2, .quality = 80};
	const struct lp_pipeline_options options = {.preset = preset,
						    .max_lights = 8,
						    .sh_order = 2};
	struct lp_frame *frame = new_frame(LP_FORMAT_MJPEG, width, width / 2, 0, 1);
	struct lp_estimates estimates;
	unsigned long bytes;
	float command_us;

	free((void *)frame->data);
	frame->data = encode_jpeg(&kind, width, width / 2, &bytes);
	frame->size_bytes = bytes;
	frame->exposure_us = STILL_US;
	frame->flags = LP_FRAME_STILL;
	lp_pipeline_destroy(pipeline);
	assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
	assert_int_equal(lp_pipeline_process(pipeline, frame, &everything, &estimates, &command_us),
			 0);
	return estimates.raw.sh_total[0][1];
}

/* Stills of a THETA X: 5504x2752, or 11008x5504. Blocks tell what all pixels do. */
static void test_large_stills(void **state)
{
	const float truth = light_of(LP_PRESET_REFERENCE, 5504);

	(void)state;
	/* the pattern clips, and is as rough as can be */
	assert_float_equal(light_of(LP_PRESET_BALANCED, 5504) / truth, 1.0, 0.05);
	assert_float_equal(light_of(LP_PRESET_BALANCED, 11008) / truth, 1.0, 0.05);
}

#define TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_a_still_shows_what_the_live_camera_clips),
		TEST(test_it_vanishes_when_the_live_camera_sees_less),
		TEST(test_a_still_of_other_light_is_left_out),
		TEST(test_a_still_does_not_overrule_newer_frames),
		TEST(test_a_still_from_before_a_turn_is_left_out),
		TEST(test_stills_alone),
		TEST(test_large_stills),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
