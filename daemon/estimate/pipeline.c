/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/pipeline_state.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#include "base/select.h"
#include "estimate/place/room_stage.h"
#include "estimate/surroundings.h"
#include "include/frame.h"
#include "include/luminance.h"
#include "light/math/grid.h"
#include "light/send/model.h"
#include "vision/camera/camera.h"

/* Most of the light has changed when this share has. */
#define MOST_CHANGED 0.5F
/* A restless light: so much of it changes in a frame, in such a share of the last frames; and the
 * gain of that share's running mean. */
#define RESTLESS_CHANGE 0.003F
#define RESTLESS 0.4F
#define RESTLESS_GAIN 0.1F

/* Mean radiance of the cells that are seen, without the lamps that were found in them. */
static void seen_ambient(const struct lp_panorama *panorama, const struct lp_grid *grid,
			 const struct lp_lamp_finder *finder, float ambient[4])
{
	const double seen_sr = 4.0 * M_PI * panorama->seen_fraction;
	double sum[4] = {0.0};

	for (int i = 0; i < panorama->width * panorama->height; i++)
		for (int c = 0; c < 4 && !(panorama->flags[i] & LP_CELL_UNSEEN); c++)
			sum[c] += (double)panorama->cells[i][c] * lp_grid_solid_angle_sr(grid, i);
	for (int k = 0; k < finder->count; k++)
		for (int c = 0; c < 4; c++)
			sum[c] -= finder->lamps[k].irradiance[c];
	for (int c = 0; c < 4; c++)
		ambient[c] = seen_sr > 0.0 ? (float)fmax(sum[c] / seen_sr, 0.0) : 0.0F;
}

/* The panorama with the mean of the rest, lamps apart, where no camera pixel looks. The filled
 * cells are a copy: nothing may write into the map but what a camera sees. */
static struct lp_panorama filled(const struct lp_pipeline *p, const struct lp_panorama *panorama)
{
	const int cells = panorama->width * panorama->height;
	struct lp_panorama copy = *panorama;
	float ambient[4];

	if (panorama->seen_fraction >= 1.0F)
		return copy;
	seen_ambient(panorama, lp_imager_grid(p->imager), p->detection->finder, ambient);
	copy.cells = p->filled;
	memcpy(copy.cells, panorama->cells, (size_t)cells * sizeof(*copy.cells));
	for (int i = 0; i < cells; i++)
		if (copy.flags[i] & LP_CELL_UNSEEN)
			memcpy(copy.cells[i], ambient, sizeof(ambient));
	return copy;
}

/* From the anchor frame to the camera's, at the estimate's capture time. */
static void turn_to_camera(const struct lp_imager *imager, struct lp_light_estimate *e)
{
	const struct lp_rotation back = lp_rotation_inverse(lp_imager_rotation(imager));
	const struct lp_imager_turn turn = lp_imager_turn(imager);

	if (!lp_rotation_is_identity(&back))
		lp_model_turn(e, &back,
			      hypotf(turn.sigma_deg, turn.time_sigma_s * turn.rate_deg_per_s));
}

bool lp_pipeline_control(struct lp_pipeline *pipeline, const struct lp_camera_control *control,
			 float *command_us)
{
	struct lp_pipeline_camera *camera = &pipeline->cameras[control->camera];

	camera->bracketing = !control->lost && control->settable && pipeline->options.brackets > 0;
	camera->reports_exposure = control->reports_exposure;
	if (control->lost)
		lp_imager_lose(pipeline->imager, control->camera);
	else if (camera->bracketing || pipeline->camera_count > 1)
		lp_imager_begin(pipeline->imager, control->camera);
	if (!control->lost)
		lp_imager_expect_exposure(pipeline->imager, control->camera);
	if (!camera->bracketing)
		return false;
	lp_bracket_init(&camera->bracket, pipeline->options.brackets, &control->limits);
	*command_us = lp_bracket_first_us(&camera->bracket);
	return true;
}

/* Whether the light has changed in most of the last frames: lamps that flicker, maybe in step with
 * the exposures, so that no single lamp shows it. */
static bool is_restless(struct lp_pipeline *p, float changed)
{
	p->restless += RESTLESS_GAIN * ((changed > RESTLESS_CHANGE ? 1.0F : 0.0F) - p->restless);
	return p->restless > RESTLESS || lp_lamp_memory_flicker(&p->lamps.memory) > 0.0F;
}

/* Of several cameras, each exposes for what it sees itself. */
static bool is_in_view(const struct lp_pipeline *p, int cell)
{
	return p->camera_count == 1 || p->view[cell];
}

/* Whether the newest frame's camera may look away from what is known. */
static bool sees_part(const struct lp_pipeline *p)
{
	return p->camera_count > 1 || !lp_camera_is_whole(p->cameras[0].geometry);
}

/* Share of the sphere that clips in the camera's view. A shorter exposure does not help where it
 * does not look. */
static float clipped_in_view(const struct lp_pipeline *p, const struct lp_panorama *panorama)
{
	double clipped_sr = 0.0;

	if (!sees_part(p))
		return panorama->clipped_fraction;
	for (int i = 0; i < panorama->width * panorama->height; i++)
		if ((panorama->flags[i] & LP_CELL_CLIPPED) && p->view[i])
			clipped_sr += lp_grid_solid_angle_sr(lp_imager_grid(p->imager), i);
	return (float)(clipped_sr / (4.0 * M_PI));
}

/* Median of a sample of cells, and the peak. */
static struct lp_bracket_scene look_at_scene(struct lp_pipeline *p,
					     const struct lp_panorama *panorama)
{
	struct lp_imager_status status;

	lp_imager_status(p->imager, &status);
	struct lp_bracket_scene scene = {.changed = status.changed > MOST_CHANGED,
					 .restless = is_restless(p, status.changed),
					 .looks_around = lp_imager_sees_little(p->imager)};
	int count = 0;

	if (sees_part(p))
		lp_imager_view(p->imager, p->view);
	scene.clipped = clipped_in_view(p, panorama) > LP_LEAST_CLIPPED_FRACTION ||
			status.newest_clips > LP_LEAST_CLIPPED_FRACTION ||
			lp_lamp_memory_flicker_clips(&p->lamps.memory);

	for (int r = 0; r < panorama->height; r += 2) {
		/* rows count by their length, so that poles do not */
		const int step = (int)fminf(4.0F / lp_imager_grid(p->imager)->row_sin[r],
					    (float)panorama->width);

		for (int c = r % 4; c < panorama->width; c += step) {
			const int cell = r * panorama->width + c;

			if (!(panorama->flags[cell] & LP_CELL_UNSEEN) && is_in_view(p, cell))
				p->scratch[count++] = panorama->cells[cell][LP_LUMINANCE];
		}
	}
	if (count)
		scene.median = lp_select(p->scratch, count, count / 2);
	for (int i = 0; i < panorama->width * panorama->height; i++)
		if (is_in_view(p, i))
			scene.peak = fmaxf(scene.peak, panorama->cells[i][LP_LUMINANCE]);
	return scene;
}

static struct lp_bracket_decision judge(struct lp_pipeline *p, struct lp_pipeline_camera *camera,
					float reported_us)
{
	struct lp_bracket *b = &camera->bracket;

	if (camera->reports_exposure)
		return lp_bracket_reported(b, reported_us);
	if (b->state == LP_BRACKET_IGNORED)
		return lp_bracket_ignored(b, lp_imager_scale(p->imager));
	struct lp_exposure_matches matches;

	lp_imager_match(p->imager, b->could_us, b->could, &matches);
	return lp_bracket_judge(b, &matches);
}

static struct lp_lamp_stage_work lamp_work(const struct lp_pipeline *p)
{
	return (struct lp_lamp_stage_work){.wanted_lights = p->wanted_lights,
					   .refine_cells = p->preset.refine_cells,
					   .has_film = p->options.film.transmission > 0.0F};
}

/* The frame loaded last corrects what is known. */
static int accept(struct lp_pipeline *p, float exposure_us)
{
	const struct lp_lamp_stage_work work = lamp_work(p);
	double way_m[3];

	lp_imager_settle(p->imager, exposure_us);
	if (lp_lamp_stage_go(&p->lamps, p->imager, way_m))
		lp_tracker_go(&p->tracker, way_m);
	lp_lamp_stage_steer(&p->lamps, p->imager, p->detection, &work);
	return lp_imager_accept(p->imager, exposure_us);
}

static int add(struct lp_pipeline *p, struct lp_frame *frame)
{
	const float exposure_us = lp_frame_exposure_us(frame);
	const int ret = lp_imager_load(p->imager, frame, exposure_us);

	return ret < 0 ? ret : accept(p, exposure_us);
}

/* The bracket says whether and as what the frame counts. 0, -EAGAIN or an error. */
static int add_to_bracket(struct lp_pipeline *p, struct lp_pipeline_camera *camera,
			  struct lp_frame *frame, float *command_us)
{
	const float reported_us = lp_frame_exposure_us(frame);
	const bool ignored = camera->bracket.state == LP_BRACKET_IGNORED;
	const uint64_t sequence = frame->sequence;
	const float expected_us = camera->reports_exposure ? reported_us
				  : ignored		   ? NAN
					    : lp_bracket_expected_us(&camera->bracket, sequence);
	int ret = lp_imager_load(p->imager, frame, expected_us);

	if (ret < 0)
		return ret;
	lp_bracket_frame(&camera->bracket, sequence);
	const struct lp_bracket_decision decision = judge(p, camera, reported_us);

	if (decision.command) {
		*command_us = decision.command_us;
		lp_imager_expect_exposure(p->imager, (int)(camera - p->cameras));
	}
	if (decision.forget)
		lp_imager_forget(p->imager);
	if (!decision.accept)
		return -EAGAIN;
	ret = accept(p, decision.exposure_us);
	if (ret < 0)
		return ret;
	const struct lp_bracket_scene scene = look_at_scene(p, lp_imager_panorama(p->imager));
	float next_us;

	if (lp_bracket_next(&camera->bracket, &scene, &next_us))
		*command_us = next_us;
	return 0;
}

/* Once the camera holds still again, its own frame is the anchor frame. */
static void rest(struct lp_pipeline *p)
{
	struct lp_rotation turn;

	if (!lp_imager_rest(p->imager, &turn))
		return;
	lp_pipeline_turn_anchor(p, &turn);
}

void lp_pipeline_finish(struct lp_pipeline *pipeline, struct lp_estimates *estimates)
{
	lp_tracker_update(&pipeline->tracker, &estimates->raw, &estimates->smoothed);
	/* Smoothed light lags behind a change, and says by how much. */
	estimates->smoothed.relighting_sigma =
		hypotf(estimates->raw.relighting_sigma,
		       lp_model_distance(&estimates->raw, &estimates->smoothed));
	turn_to_camera(pipeline->imager, &estimates->raw);
	turn_to_camera(pipeline->imager, &estimates->smoothed);
}

/* What reflections are made of, if anybody wants them. */
static void look_around(struct lp_pipeline *p, const struct lp_demand *demand,
			const struct lp_panorama *panorama, const struct lp_light_estimate *raw,
			struct lp_surroundings *surroundings)
{
	const struct lp_view_of_lamps view = {.grid = lp_imager_grid(p->imager),
					      .panorama = panorama,
					      .memory = &p->lamps.memory,
					      .finder = p->detection->finder,
					      .rotation = lp_imager_rotation(p->imager)};

	if (!demand->reflection_size || !p->surround)
		return;
	surroundings->size = demand->reflection_size;
	lp_surroundings_look(surroundings, &view, raw, p->surround);
}

/* A probe that goes learns the room around it. */
static void find_room(struct lp_pipeline *p, const struct lp_panorama *panorama,
		      struct lp_light_estimate *raw)
{
	if (!p->room || !p->lamps.is_placed || lp_lamp_memory_doubts_places(&p->lamps.memory))
		return;
	lp_room_stage_look(p->room, panorama, p->detection, &p->lamps.memory, &p->lamps.pose);
	lp_room_stage_tell(p->room, &p->lamps.pose, &raw->room);
}

int lp_pipeline_process(struct lp_pipeline *pipeline, struct lp_frame *frame,
			const struct lp_demand *demand, struct lp_estimates *estimates,
			float *command_us)
{
	const int64_t t_arrival_ns = frame->t_arrival_ns;
	const float wheel_deg = frame->wheel_deg;
	const float wheel_sigma_deg = frame->wheel_sigma_deg;
	struct lp_pipeline_camera *camera = &pipeline->cameras[frame->camera];
	double total[LP_SH_MAX_COUNT][3];
	struct lp_imager_status status;
	int ret;

	pipeline->wanted_lights = demand->max_lights < pipeline->options.max_lights
					  ? demand->max_lights
					  : pipeline->options.max_lights;
	*command_us = NAN;
	ret = camera->bracketing ? add_to_bracket(pipeline, camera, frame, command_us)
				 : add(pipeline, frame);
	if (ret < 0)
		return ret;
	const struct lp_panorama *seen = lp_imager_panorama(pipeline->imager);
	const float mean = lp_grid_mean_luminance(lp_imager_grid(pipeline->imager), seen);

	if (pipeline->wanted_lights) { /* else all light is in the SH anyway */
		lp_detect(pipeline->detection, seen, mean);
		lp_lamp_stage_hold(&pipeline->lamps, pipeline->detection, seen, mean);
	} else {
		pipeline->detection->finder->count = 0;
	}
	const struct lp_panorama whole = filled(pipeline, seen);
	const struct lp_lamp_stage_work work = lamp_work(pipeline);

	lp_lamp_stage_update(&pipeline->lamps, pipeline->imager, pipeline->detection, &work, seen);
	lp_imager_expect_flicker(pipeline->imager, lp_lamp_memory_flicker(&pipeline->lamps.memory));
	lp_imager_status(pipeline->imager, &status);
	lp_ring_stage_update(&pipeline->ring, pipeline->imager, &whole,
			     pipeline->detection->finder->cells, &pipeline->lamps.memory,
			     status.exposure_unknown);
	estimates->ring = lp_ring_stage_status(&pipeline->ring);
	estimates->places_left_out = pipeline->places_left_out = status.places_left_out;
	memset(&estimates->raw, 0, sizeof(estimates->raw));
	lp_pipeline_fill(pipeline, &whole, mean, total, &estimates->raw);
	estimates->raw.t_arrival_ns = t_arrival_ns;
	estimates->raw.wheel_deg = wheel_deg;
	estimates->raw.wheel_sigma_deg = wheel_sigma_deg;
	estimates->raw.orientation = lp_pipeline_orientation(pipeline, whole.t_capture_ns);
	find_room(pipeline, seen, &estimates->raw);
	lp_pipeline_use_ring(pipeline, (const double(*)[3])total, &estimates->raw);
	look_around(pipeline, demand, &whole, &estimates->raw, estimates->surroundings);
	lp_pipeline_finish(pipeline, estimates);
	rest(pipeline);
	return 0;
}

bool lp_pipeline_polarization(const struct lp_pipeline *pipeline, struct lp_polarization_grid *grid)
{
	return lp_imager_polarization_grid(pipeline->imager, grid);
}
