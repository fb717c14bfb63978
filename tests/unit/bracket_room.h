/* SPDX-License-Identifier: Apache-2.0 */
/* A room before a simulated camera that takes commands late, rounds them, or does not follow; its
 * frames go through the whole pipeline. prepare() comes first. */
#ifndef LP_TEST_BRACKET_ROOM_H
#define LP_TEST_BRACKET_ROOM_H

#include <errno.h>
#include <math.h>
#include <string.h>

#include "estimate/pipeline.h"
#include "include/source.h"
#include "lp_test.h"
#include "scene.h"

#define WIDTH 480
#define HEIGHT 240
#define MOST_DELAY 8
#define MOST_LATE 64 /* commands */

struct camera {
	int delay_frames;
	float step_us;
	bool ignores, reports_exposure;
	bool loses;  /* a tenth of its frames on the way */
	bool counts; /* its frames, so that lost ones are known */
	float in_effect_us;
	int first_late_frames; /* the first command comes so much later, and those after it */
	int unsteady_frames;   /* commands come up to so much later, in their order */
	float late_us[MOST_LATE];
	int due_frame[MOST_LATE], late;
	bool restarts; /* a command makes it forget those before that have not taken effect yet */
	float queue_us[MOST_DELAY + 1]; /* takes effect after so many frames */
	int frames;
};

/* Twelve stops: a dim room with texture, a bright wall, two lamps. */
static inline float radiance_at(int x, int y)
{
	const float texture = 0.6F + 0.4F * sinf((float)x * 0.9F) * sinf((float)y * 0.7F);
	const int dx = x - 120, dy = y - 80, ex = x - 400, ey = y - 60;

	if (dx * dx + dy * dy < 36 || ex * ex + ey * ey < 16)
		return 20000.0F;
	return (x / 60 % 3 == 0 ? 60.0F : 8.0F) * texture;
}

/* Thousands of frames are taken of the scene, so what can be is computed once. */
static float root_radiance[WIDTH * HEIGHT];

/* sRGB code in 256ths, by the root of the light, so that dark tones are fine enough. */
#define CODE_STEPS 4096
static uint16_t code_of_root[CODE_STEPS + 1];

static inline int prepare(void **state)
{
	(void)state;
	for (int i = 0; i < WIDTH * HEIGHT; i++)
		root_radiance[i] = sqrtf(radiance_at(i % WIDTH, i / WIDTH));
	for (int i = 0; i <= CODE_STEPS; i++) {
		const float root = (float)i / CODE_STEPS, light = root * root;
		const float v = light <= 0.0031308F ? 12.92F * light
						    : 1.055F * powf(light, 1 / 2.4F) - 0.055F;

		code_of_root[i] = (uint16_t)lroundf(255.0F * 256.0F * v);
	}
	return 0;
}

/* 0..255 (Numerical Recipes' linear congruential generator): added to 256ths of a code, noise of
 * one code. */
static inline unsigned int dither(void)
{
	static uint32_t state;

	state = 1664525U * state + 1013904223U;
	return state >> 24;
}

static inline struct lp_frame *expose(const struct camera *camera, float level)
{
	struct lp_frame *frame = new_frame(LP_FORMAT_GREY, WIDTH, HEIGHT, WIDTH, WIDTH * HEIGHT);
	const float factor = CODE_STEPS * sqrtf(level * camera->in_effect_us * 1e-6F);
	uint8_t *data = (uint8_t *)frame->data;

	for (int i = 0; i < WIDTH * HEIGHT; i++) {
		const float root = root_radiance[i] * factor;
		const int step = root < CODE_STEPS ? (int)root : CODE_STEPS;

		data[i] = (uint8_t)((code_of_root[step] + dither()) >> 8);
	}
	frame->t_read_ns += camera->frames * 33333333LL;
	frame->sequence = camera->counts ? camera->frames : 0;
	if (camera->reports_exposure)
		frame->exposure_us = camera->in_effect_us;
	return frame;
}

/* Most commands come soon; one in four is late. */
static inline void send_late(struct camera *camera, float command_us)
{
	const int spread = dither() < 64 ? camera->unsteady_frames : 3;
	const int due = camera->unsteady_frames ? camera->frames + (int)dither() * spread / 256
						: camera->first_late_frames;
	const int last = camera->late ? camera->due_frame[camera->late - 1] : 0;

	assert_true(camera->late < MOST_LATE);
	camera->late_us[camera->late] = command_us;
	camera->due_frame[camera->late++] = due > last ? due : last;
}

static inline void receive_late(struct camera *camera)
{
	while (camera->late && camera->due_frame[0] < camera->frames) {
		camera->queue_us[camera->delay_frames] = camera->late_us[0];
		camera->late--;
		memmove(camera->late_us, camera->late_us + 1,
			sizeof(camera->late_us) - sizeof(float));
		memmove(camera->due_frame, camera->due_frame + 1,
			sizeof(camera->due_frame) - sizeof(int));
	}
}

static inline void take_command(struct camera *camera, float command_us)
{
	if (camera->ignores || isnan(command_us))
		return;
	if (camera->step_us > 0.0F)
		command_us = roundf(command_us / camera->step_us) * camera->step_us;
	if (camera->restarts)
		memset(camera->queue_us, 0, sizeof(camera->queue_us));
	if (camera->unsteady_frames || camera->frames < camera->first_late_frames) {
		send_late(camera, command_us);
		return;
	}
	camera->queue_us[camera->delay_frames] = command_us;
}

static inline void next_frame(struct camera *camera)
{
	camera->frames++;
	receive_late(camera);
	if (camera->queue_us[0] > 0.0F)
		camera->in_effect_us = camera->queue_us[0];
	memmove(camera->queue_us, camera->queue_us + 1, MOST_DELAY * sizeof(float));
	camera->queue_us[MOST_DELAY] = 0.0F;
}

struct outcome {
	int estimates, refused;
	struct lp_light_estimate last;
	int64_t first_complete; /* frame of the first estimate without BRACKET_INCOMPLETE */
};

static inline struct lp_pipeline *new_pipeline(struct camera *camera, int brackets)
{
	const struct lp_pipeline_options options = {.max_lights = 8,
						    .sh_order = 2,
						    .brackets = brackets,
						    .scale = {NAN, NAN},
						    .preset = LP_PRESET_BALANCED};
	const struct lp_camera_control control = {.settable = true,
						  .reports_exposure = camera->reports_exposure,
						  .limits = {.min_us = 10.0F,
							     .max_us = 33000.0F,
							     .step_us = camera->step_us,
							     .delay_frames = -1}};
	struct lp_pipeline *pipeline;
	float command_us = NAN;

	assert_int_equal(lp_pipeline_create(&options, &pipeline), 0);
	assert_int_equal(lp_pipeline_control(pipeline, &control, &command_us), brackets > 0);
	camera->in_effect_us = 3000.0F; /* whatever it was left at */
	take_command(camera, command_us);
	return pipeline;
}

static inline struct outcome run(struct lp_pipeline *pipeline, struct camera *camera, int frames,
				 float level)
{
	static const struct lp_demand demand = {.sh_order = 2, .max_lights = 8};
	struct outcome outcome = {.first_complete = -1};
	struct lp_estimates estimates;
	float command_us;

	for (int n = 0; n < frames; n++) {
		next_frame(camera);
		while (camera->loses && dither() < 256 / 10)
			next_frame(camera);
		const int ret = lp_pipeline_process(pipeline, expose(camera, level), &demand,
						    &estimates, &command_us);

		take_command(camera, command_us);
		assert_true(ret == 0 || ret == -EAGAIN);
		outcome.refused += ret < 0;
		if (ret < 0)
			continue;
		outcome.estimates++;
		outcome.last = estimates.raw;
		if (outcome.first_complete < 0 &&
		    !(estimates.raw.flags & LP_ESTIMATE_BRACKET_INCOMPLETE))
			outcome.first_complete = n;
	}
	return outcome;
}

/* Mean radiance of the scene: what sh_total[0] must be, / sqrt(4 pi). */
static inline double true_mean(float level)
{
	double sum = 0.0, weight = 0.0;

	for (int y = 0; y < HEIGHT; y++)
		for (int x = 0; x < WIDTH; x++) {
			const double w = sin(M_PI * (y + 0.5) / HEIGHT);

			sum += w * level * radiance_at(x, y);
			weight += w;
		}
	return sum / weight;
}

static inline void expect_right_light(const struct outcome *outcome, float level, double tolerance)
{
	assert_float_equal(outcome->last.sh_total[0][1] / sqrt(4.0 * M_PI) / true_mean(level), 1.0,
			   tolerance);
}

#endif
