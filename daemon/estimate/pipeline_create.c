/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/pipeline_state.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "light/math/sh.h"
#include "vision/camera/camera.h"

static const struct lp_preset_work presets[] = {
	[LP_PRESET_FAST] = {LP_DECODE_BLOCKS, 1, 0, 0, LP_PANORAMA_WIDTH / 2},
	[LP_PRESET_BALANCED] = {LP_DECODE_BLOCKS, 1, 16, 49, LP_PANORAMA_WIDTH},
	[LP_PRESET_ACCURATE] = {LP_DECODE_PIXELS, 1, 0, 1024, LP_PANORAMA_WIDTH},
	[LP_PRESET_REFERENCE] = {LP_DECODE_PIXELS, 1, 0, 1024, 2 * LP_PANORAMA_WIDTH},
};

static int check(const struct lp_pipeline_options *o)
{
	if (o->camera_count < 0 || o->camera_count > LP_MAX_CAMERAS) {
		lp_error("options", "pipeline", "at most %d cameras", LP_MAX_CAMERAS);
		return -EINVAL;
	}
	if (o->max_lights < 0 || o->max_lights > LP_MAX_LIGHTS || o->sh_order < 0 ||
	    o->sh_order > LP_MAX_SH_ORDER) {
		lp_error("options", "pipeline", "lights 0..%d, SH order 0..%d", LP_MAX_LIGHTS,
			 LP_MAX_SH_ORDER);
		return -EINVAL;
	}
	if (o->exact_blocks > LP_MOST_EXACT_BLOCKS || o->refine_cells > LP_MOST_REFINE_CELLS) {
		lp_error("options", "pipeline", "exact-blocks up to %d, refine-cells up to %d",
			 LP_MOST_EXACT_BLOCKS, LP_MOST_REFINE_CELLS);
		return -EINVAL;
	}
	if (o->panorama_width && (o->panorama_width % 8 || o->panorama_width < 16 ||
				  o->panorama_width > LP_PANORAMA_MAX_WIDTH)) {
		lp_error("panorama-width", "pipeline", "a multiple of 8, 16..%d",
			 LP_PANORAMA_MAX_WIDTH);
		return -EINVAL;
	}
	return 0;
}

static struct lp_preset_work effective_preset(const struct lp_pipeline_options *o,
					      enum lp_preset preset)
{
	struct lp_preset_work p = presets[preset];

	if (o->panorama_width)
		p.panorama_width = o->panorama_width;
	if (o->decode_divisor == LP_DECODE_BY_BLOCKS) {
		p.decode = LP_DECODE_BLOCKS;
	} else if (o->decode_divisor) {
		p.decode = LP_DECODE_PIXELS;
		p.divisor = o->decode_divisor;
	}
	if (o->exact_blocks)
		p.exact_blocks = o->exact_blocks == LP_NONE ? 0 : o->exact_blocks;
	if (o->refine_cells)
		p.refine_cells = o->refine_cells == LP_NONE ? 0 : o->refine_cells;
	return p;
}

/* What depends on the preset. */
struct stages {
	struct lp_imager *imager;
	struct lp_detection *detection;
	struct lp_sh_projector *projector;
	float *scratch;
	float *before;
	uint8_t *view;
	float (*filled)[4];
	float (*surround)[4];
};

static void destroy_stages(const struct stages *stages)
{
	free(stages->view);
	free(stages->filled);
	free(stages->surround);
	free(stages->scratch);
	free(stages->before);
	lp_sh_projector_destroy(stages->projector);
	lp_detection_destroy(stages->detection);
	lp_imager_destroy(stages->imager);
}

/* One sheet in front of each lens; an equirectangular camera has one across its forward axis. */
static struct lp_film film_of(const struct lp_pipeline *p)
{
	const struct lp_film_numbers *numbers = &p->options.film;
	struct lp_film film =
		lp_film_of_one_sheet(numbers->transmission, numbers->extinction, numbers->index);

	film.is_stack = numbers->is_stack;
	film.offset_deg = numbers->offset_deg;
	film.rest_s = numbers->rest_s;
	const struct lp_camera *camera = p->cameras[0].geometry; /* the only one that has a film */

	for (int k = 0; k < camera->lens_count && k < LP_MAX_SHEETS; k++) {
		film.sheet_count = k + 1;
		for (int i = 0; i < 9; i++)
			film.lens[k].m[i / 3][i % 3] = camera->lens[k].rotation[i / 3][i % 3];
	}
	return film;
}

static int create_stages(const struct lp_pipeline *p, const struct lp_preset_work *preset,
			 struct stages *stages)
{
	const int width = preset->panorama_width, height = width / 2;
	const struct lp_imager_options imager = {.panorama_width = width,
						 .decode = preset->decode,
						 .divisor = preset->divisor,
						 .exact_blocks = preset->exact_blocks,
						 .film = film_of(p),
						 .follow_turns = p->options.orientation !=
								 LP_ORIENTATION_NONE,
						 .use_orientation = p->options.orientation >
								    LP_ORIENTATION_VISUAL};
	int ret;

	*stages = (struct stages){0};
	ret = lp_imager_create(p->cameras[0].geometry, &imager, &stages->imager);
	for (int k = 1; k < p->camera_count && ret == 0; k++)
		ret = lp_imager_add_camera(stages->imager, p->cameras[k].geometry);
	if (ret == 0)
		ret = lp_detection_create(lp_imager_grid(stages->imager), &p->options.detector,
					  &stages->detection);
	if (ret == 0)
		ret = lp_sh_projector_create(width, height, LP_SH_MAX_ORDER, &stages->projector);
	if (ret == 0) {
		stages->scratch = calloc((size_t)width * height, sizeof(*stages->scratch));
		stages->before = calloc((size_t)width * height, sizeof(*stages->before));
		stages->view = calloc((size_t)width * height, 1);
		stages->filled = calloc((size_t)width * height, sizeof(*stages->filled));
		ret = stages->scratch && stages->before && stages->view && stages->filled ? 0
											  : -ENOMEM;
	}
	if (ret == 0 && p->options.reflection_size) {
		stages->surround = calloc((size_t)width * height, sizeof(*stages->surround));
		ret = stages->surround ? 0 : -ENOMEM;
	}
	if (ret < 0)
		destroy_stages(stages);
	return ret;
}

void lp_pipeline_turn_anchor(struct lp_pipeline *p, const struct lp_rotation *turn)
{
	const struct lp_rotation back = lp_rotation_inverse(turn);

	lp_lamp_stage_turn(&p->lamps, turn);
	lp_tracker_turn(&p->tracker, turn);
	lp_ring_steps_turn(&p->steps, turn);
	lp_ring_poses_turn(&p->ring.poses, turn);
	p->origin = lp_rotation_product(&p->origin, &back);
}

int lp_pipeline_set_preset(struct lp_pipeline *pipeline, enum lp_preset preset)
{
	const struct lp_preset_work effective = effective_preset(&pipeline->options, preset);
	const struct stages old = {pipeline->imager,  pipeline->detection,    pipeline->projector,
				   pipeline->scratch, pipeline->lamps.before, pipeline->view,
				   pipeline->filled,  pipeline->surround};
	struct stages stages;
	int ret = create_stages(pipeline, &effective, &stages);

	if (ret == 0) {
		ret = lp_ring_stage_resize(&pipeline->ring, lp_imager_grid(stages.imager));
		if (ret < 0)
			destroy_stages(&stages);
	}
	if (ret < 0) {
		lp_error("pipeline", "preset", "%s — the preset stays as it is", lp_strerror(ret));
		return ret;
	}
	if (!pipeline->imager)
		pipeline->origin = lp_rotation_identity();
	else { /* the new one's anchor frame is the camera's, as it is now */
		const struct lp_rotation turn =
			lp_rotation_inverse(lp_imager_rotation(pipeline->imager));

		lp_pipeline_turn_anchor(pipeline, &turn);
		lp_lamp_memory_lose_cells(&pipeline->lamps.memory);
		lp_imager_inherit(stages.imager, pipeline->imager);
	}
	destroy_stages(&old);
	pipeline->imager = stages.imager;
	pipeline->detection = stages.detection;
	pipeline->projector = stages.projector;
	pipeline->scratch = stages.scratch;
	pipeline->lamps.before = stages.before;
	pipeline->lamps.has_before = false;
	pipeline->view = stages.view;
	pipeline->filled = stages.filled;
	pipeline->surround = stages.surround;
	pipeline->preset = effective;
	pipeline->in_force = preset;
	return 0;
}

enum lp_preset lp_pipeline_preset(const struct lp_pipeline *pipeline)
{
	return pipeline->in_force;
}

int lp_pipeline_create(const struct lp_pipeline_options *options, struct lp_pipeline **pipeline)
{
	struct lp_pipeline *p;
	int ret = check(options);

	if (ret < 0)
		return ret;
	p = calloc(1, sizeof(*p));
	if (!p)
		return -ENOMEM;
	p->options = *options;
	memset(p->options.cameras, 0, sizeof(p->options.cameras)); /* were borrowed */
	p->camera_count = options->camera_count ? options->camera_count : 1;
	p->tracker.time_constant_ms = options->smoothing_ms;
	lp_ring_stage_init(&p->ring, &options->scale);
	for (int k = 0; k < p->camera_count && ret == 0; k++)
		ret = lp_camera_create(options->cameras[k], &p->cameras[k].geometry);
	if (ret == 0 && (options->orientation == LP_ORIENTATION_FRAMES ||
			 options->orientation == LP_ORIENTATION_CLIENT))
		ret = lp_room_create(&p->room);
	if (ret == 0)
		ret = lp_pipeline_set_preset(p, options->preset);
	if (ret < 0) {
		lp_pipeline_destroy(p);
		return ret;
	}
	*pipeline = p;
	return 0;
}

void lp_pipeline_destroy(struct lp_pipeline *pipeline)
{
	if (!pipeline)
		return;
	destroy_stages(&(struct stages){pipeline->imager, pipeline->detection, pipeline->projector,
					pipeline->scratch, pipeline->lamps.before, pipeline->view,
					pipeline->filled, pipeline->surround});
	lp_room_destroy(pipeline->room);
	lp_ring_stage_finish(&pipeline->ring);
	for (int k = 0; k < pipeline->camera_count; k++)
		lp_camera_destroy(pipeline->cameras[k].geometry);
	free(pipeline);
}
