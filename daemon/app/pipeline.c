/* SPDX-License-Identifier: Apache-2.0 */
#include "app/pipeline.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app/lamp_stage.h"
#include "base/clock.h"
#include "base/log.h"
#include "include/frame.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/grid.h"
#include "light/model.h"
#include "light/rotation.h"
#include "light/select.h"
#include "light/sh.h"
#include "light/tracker.h"
#include "vision/camera.h"
#include "vision/imager.h"
#include "vision/sh_project.h"

#define DEG (180.0F / (float)M_PI)
/* What the grid, the blocks of a JPEG and its rounding bring at best: docs/users/accuracy.md. */
#define LEAST_RELIGHTING_SIGMA 0.004
/* Thresholds of flags: chosen by hand (docs/maintainers/constants.md). */
/* Below this mean code of the longest exposure most of an 8-bit picture is noise. */
#define DARK_CODE 4.0F
#define LEAST_CLIPPED_FRACTION 1e-5F
/* 1 sigma of when an exposure was: what a turning camera adds to every direction. */
#define TIMING_SIGMA_S 0.002F
/* 1 sigma of the drift of the anchor frame in a second of turning, in sigmas of its frames. */
#define DRIFT_SIGMAS 4.0

/* A restless light: so much of it changes in a frame, in such a share of the last frames; and the
 * gain of that share's running mean. */
#define RESTLESS_CHANGE 0.003F
#define RESTLESS 0.4F
#define RESTLESS_GAIN 0.1F
/* 1 sigma of light that is not seen, relative, after its first second; grows with its root. */
#define COVERED_WALK 0.1

/* What each preset means; `make bench` measures the trade. */
struct preset {
	enum lp_decode decode;
	int divisor;
	int exact_blocks;
	int refine_cells; /* largest lamp refined, in cells that hold its light; 0: none */
	int panorama_width;
};

static const struct preset presets[] = {
	[LP_PRESET_FAST] = {LP_DECODE_BLOCKS, 1, 0, 0, LP_PANORAMA_WIDTH / 2},
	[LP_PRESET_BALANCED] = {LP_DECODE_BLOCKS, 1, 16, 49, LP_PANORAMA_WIDTH},
	[LP_PRESET_ACCURATE] = {LP_DECODE_PIXELS, 1, 0, 1024, LP_PANORAMA_WIDTH},
	[LP_PRESET_REFERENCE] = {LP_DECODE_PIXELS, 1, 0, 1024, 2 * LP_PANORAMA_WIDTH},
};

struct lp_pipeline {
	struct lp_pipeline_options options;
	struct preset preset;	 /* in force, with what single options say */
	enum lp_preset in_force; /* may be lower than options.preset */
	struct lp_camera *camera;
	struct lp_imager *imager;
	struct lp_detection *detection;
	struct lp_sh_projector *projector;
	struct lp_lamp_stage lamps;
	struct lp_ring_stage ring;
	struct lp_tracker tracker;
	struct lp_bracket bracket;
	bool bracketing, reports_exposure;
	float restless;	   /* share of the last frames that showed changed light */
	float *scratch;	   /* cells of the panorama, for its median */
	int wanted_lights; /* by the options and the most demanding subscriber */
	uint32_t sequence;
	struct lp_rotation origin; /* anchor frame to that of the first frame */
	double drift_deg2;	   /* variance of what the anchor frame has drifted since then */
	int64_t t_drift_ns;
};

static int check(const struct lp_pipeline_options *o)
{
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

static struct preset effective_preset(const struct lp_pipeline_options *o, enum lp_preset preset)
{
	struct preset p = presets[preset];

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
};

static void destroy_stages(const struct stages *stages)
{
	free(stages->scratch);
	lp_sh_projector_destroy(stages->projector);
	lp_detection_destroy(stages->detection);
	lp_imager_destroy(stages->imager);
}

/* One sheet in front of each lens; an equirectangular camera has one across its forward axis. */
static struct lp_film film_of(const struct lp_pipeline *p)
{
	struct lp_film film =
		lp_film_of_one_sheet(p->options.film_transmission, p->options.film_extinction);

	if (p->camera->projection == LP_EQUIRECT)
		return film;
	for (int k = 0; k < p->camera->lens_count && k < LP_MAX_SHEETS; k++) {
		film.sheet_count = k + 1;
		for (int i = 0; i < 9; i++)
			film.lens[k].m[i / 3][i % 3] = p->camera->lens[k].rotation[i / 3][i % 3];
	}
	return film;
}

static int create_stages(const struct lp_pipeline *p, const struct preset *preset,
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
						 .heed_orientation = p->options.orientation >
								     LP_ORIENTATION_VISUAL};
	int ret;

	*stages = (struct stages){0};
	ret = lp_imager_create(p->camera, &imager, &stages->imager);
	if (ret == 0)
		ret = lp_detection_create(lp_imager_grid(stages->imager), &p->options.detector,
					  &stages->detection);
	if (ret == 0)
		ret = lp_sh_projector_create(width, height, LP_SH_MAX_ORDER, &stages->projector);
	if (ret == 0) {
		stages->scratch = calloc((size_t)width * height, sizeof(*stages->scratch));
		ret = stages->scratch ? 0 : -ENOMEM;
	}
	if (ret < 0)
		destroy_stages(stages);
	return ret;
}

/* The anchor frame is another: `turn` is the rotation from the old one to the new one. */
static void turn_anchor(struct lp_pipeline *p, const struct lp_rotation *turn)
{
	const struct lp_rotation back = lp_rotation_inverse(turn);

	lp_lamp_memory_turn(&p->lamps.memory, turn);
	lp_tracker_turn(&p->tracker, turn);
	p->origin = lp_rotation_product(&p->origin, &back);
}

int lp_pipeline_set_preset(struct lp_pipeline *pipeline, enum lp_preset preset)
{
	const struct preset effective = effective_preset(&pipeline->options, preset);
	const struct stages old = {pipeline->imager, pipeline->detection, pipeline->projector,
				   pipeline->scratch};
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

		turn_anchor(pipeline, &turn);
		lp_lamp_memory_lose_cells(&pipeline->lamps.memory);
	}
	destroy_stages(&old);
	pipeline->imager = stages.imager;
	pipeline->detection = stages.detection;
	pipeline->projector = stages.projector;
	pipeline->scratch = stages.scratch;
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
	p->options.camera = NULL; /* was borrowed */
	p->tracker.time_constant_ms = options->smoothing_ms;
	lp_ring_stage_init(&p->ring, &options->scale);
	ret = lp_camera_create(options->camera, &p->camera);
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
					pipeline->scratch});
	lp_ring_stage_finish(&pipeline->ring);
	lp_camera_destroy(pipeline->camera);
	free(pipeline);
}

/* What no camera pixel sees is given the mean of what is seen, lamps apart. */
static void fill_unseen(struct lp_panorama *panorama, const struct lp_grid *grid,
			const struct lp_lamp_finder *finder)
{
	double sum[4] = {0.0}, seen = 4.0 * M_PI * panorama->seen_fraction;
	float fill[4];

	if (panorama->seen_fraction >= 1.0F || seen <= 0.0)
		return;
	for (int i = 0; i < panorama->width * panorama->height; i++)
		for (int c = 0; c < 4; c++)
			sum[c] += (double)panorama->cells[i][c] * lp_grid_solid_angle_sr(grid, i);
	for (int k = 0; k < finder->count; k++)
		for (int c = 0; c < 4; c++)
			sum[c] -= finder->lamps[k].irradiance[c];
	for (int c = 0; c < 4; c++)
		fill[c] = (float)fmax(sum[c] / seen, 0.0);
	for (int i = 0; i < panorama->width * panorama->height; i++)
		if (panorama->flags[i] & LP_CELL_UNSEEN)
			memcpy(panorama->cells[i], fill, sizeof(fill));
}

/* The panorama's light, with each lamp's share moved from where the grid saw it to where it is:
 * shape from the grid, place and strength from the pixels. */
static void project(struct lp_pipeline *p, const struct lp_panorama *panorama, double (*total)[3])
{
	lp_sh_project(p->projector, panorama, LP_SH_MAX_ORDER, total);
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &p->lamps.memory.list[k];

		if (!m->id || !m->seen)
			continue;
		lp_sh_add_lamp(LP_SH_MAX_ORDER, m->on_grid.centroid, m->on_grid.irradiance, 0.0,
			       -1.0, total);
		lp_sh_add_lamp(LP_SH_MAX_ORDER, m->lamp.centroid, m->lamp.irradiance, 0.0, 1.0,
			       total);
		lp_sh_add_lamp(LP_SH_MAX_ORDER, m->lamp.centroid, m->recovered, 0.0, 1.0, total);
	}
	lp_ring_stage_project(&p->ring, total);
}

static uint32_t flags_of(const struct lp_pipeline *p, const struct lp_panorama *panorama,
			 const struct lp_imager_status *status, float mean, int lamps)
{
	uint32_t flags = 0;

	if (status->exposure_unknown)
		flags |= LP_ESTIMATE_EXPOSURE_UNKNOWN;
	if (panorama->clipped_fraction > LEAST_CLIPPED_FRACTION ||
	    lp_lamp_memory_flicker_clips(&p->lamps.memory))
		flags |= LP_ESTIMATE_CLIPPED;
	if (status->mean_code < DARK_CODE) /* false for NAN: float frames have no codes */
		flags |= LP_ESTIMATE_UNDEREXPOSED;
	if (panorama->seen_fraction < 1.0F)
		flags |= LP_ESTIMATE_PARTIAL_VIEW;
	if (status->invalid_samples)
		flags |= LP_ESTIMATE_INVALID_INPUT;
	if (lamps > p->wanted_lights)
		flags |= LP_ESTIMATE_MORE_LIGHTS;
	if (status->rotation_is_unknown)
		flags |= LP_ESTIMATE_MOTION;
	if (lp_lamp_memory_flicker(&p->lamps.memory) > 0.0F)
		flags |= LP_ESTIMATE_FLICKER;
	if (status->covered)
		flags |= LP_ESTIMATE_COVERED;
	if (status->angles_missing)
		flags |= LP_ESTIMATE_POLARIZATION_UNKNOWN;
	if (p->lamps.film_is_turned)
		flags |= LP_ESTIMATE_FILM_TURNED;
	if (!(mean > 0.0F))
		flags |= LP_ESTIMATE_NO_LIGHT;
	if (p->in_force < p->options.preset)
		flags |= LP_ESTIMATE_DEGRADED;
	if (p->bracketing && p->bracket.state == LP_BRACKET_IGNORED)
		flags |= LP_ESTIMATE_EXPOSURE_IGNORED;
	else if (p->bracketing && status->current_count < p->bracket.planned)
		flags |= LP_ESTIMATE_BRACKET_INCOMPLETE;
	return flags;
}

/* Variance of the irradiance, mean over all normals, that a lamp's own uncertainty brings: of its
 * strength (the mean of max(0, cos)^2 is 1/6), and of its direction (likewise of max(0, sin)^2,
 * over the lit half: 1/6). */
static double lamp_variance(const struct lp_light *light)
{
	const double own = lp_luminance(light->irradiance);
	const bool by_ring = light->flags & LP_LIGHT_RING; /* lp_ring_stage_knows() */
	const double strength =
		isnan(light->irradiance_sigma) || by_ring ? 0.0 : light->irradiance_sigma;
	const double direction = light->direction_sigma_deg / DEG;

	return own * own * (strength * strength + direction * direction) / 6.0;
}

static float relighting_sigma(const struct lp_pipeline *p, const struct lp_imager_status *status,
			      const struct lp_light_estimate *e, const double (*total)[3])
{
	const float light[3] = {(float)total[0][0], (float)total[0][1], (float)total[0][2]};
	/* mean irradiance = integral of radiance / 4 */
	const double mean = lp_luminance(light) * sqrt(4.0 * M_PI) / 4.0;
	/* clipped light may well be twice as much; flux over mean irradiance is 4 */
	double clipped = 4.0 * status->clipped_share / sqrt(6.0);
	/* what a hand hides may have changed meanwhile, all of it alike */
	const double hidden = 4.0 * status->covered_share * COVERED_WALK *
			      sqrt(1.0 + status->covered_s) / sqrt(6.0);
	double lamps = 0.0;
	float variance;

	if (!(mean > 0.0))
		return 0.0F;
	if (lp_ring_stage_knows(&p->ring, &variance))
		clipped = sqrt(variance) / mean;
	for (int k = 0; k < e->light_count; k++)
		lamps += lamp_variance(&e->lights[k]) / (mean * mean);
	return (float)sqrt(LEAST_RELIGHTING_SIGMA * LEAST_RELIGHTING_SIGMA + lamps +
			   clipped * clipped + hidden * hidden +
			   (double)status->irradiance_sigma * status->irradiance_sigma +
			   (double)status->changed * status->changed);
}

/* Light of unknown exposure has no scale. */
static struct lp_ring_scale scale_of(const struct lp_pipeline *p,
				     const struct lp_imager_status *status)
{
	return status->exposure_unknown ? (struct lp_ring_scale){NAN, NAN}
					: lp_ring_stage_scale(&p->ring);
}

/* e: zeroed. */
static void fill_estimate(struct lp_pipeline *p, const struct lp_panorama *panorama, float mean,
			  const double (*total)[3], struct lp_light_estimate *e)
{
	/* more than are wanted: each list chooses for itself, with memory */
	const int most = p->wanted_lights ? p->options.max_lights : 0;
	const int lamps =
		lp_lamp_stage_list(&p->lamps, lp_imager_grid(p->imager), panorama, most, e);
	struct lp_imager_status status;

	lp_imager_status(p->imager, &status);
	const struct lp_ring_scale scale = scale_of(p, &status);

	e->t_capture_ns = panorama->t_capture_ns;
	e->suspended_ns = lp_clock_suspended_ns();
	e->sequence = ++p->sequence;
	e->flags = flags_of(p, panorama, &status, mean, lamps);
	e->exposure_us = status.longest_exposure_us;
	e->exposure_count = status.exposure_count;
	e->cd_m2_per_unit = scale.lux_per_unit;
	e->cd_m2_per_unit_sigma = scale.sigma;
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e->sh_total[i][c] = (float)total[i][c];
	e->relighting_sigma = relighting_sigma(p, &status, e, total);
	lp_model_predict(total, e);
}

/* From the anchor frame to the camera's, at the estimate's capture time. */
static void turn_to_camera(const struct lp_imager *imager, struct lp_light_estimate *e)
{
	const struct lp_rotation back = lp_rotation_inverse(lp_imager_rotation(imager));
	struct lp_imager_status status;

	if (lp_rotation_is_identity(&back))
		return;
	lp_imager_status(imager, &status);
	const float late_deg = TIMING_SIGMA_S * status.rate_deg_per_s;

	lp_model_turn(e, &back, hypotf(status.rotation_sigma_deg, late_deg));
}

/* While the camera turns, the anchor frame drifts by more than the sigma of each frame says. */
static void note_drift(struct lp_pipeline *p, const struct lp_imager_status *status, int64_t t_ns)
{
	const double sigma_deg = DRIFT_SIGMAS * (double)status->rotation_sigma_deg;

	if (p->t_drift_ns && t_ns > p->t_drift_ns)
		p->drift_deg2 += sigma_deg * sigma_deg * (double)(t_ns - p->t_drift_ns) / 1e9;
	p->t_drift_ns = t_ns;
}

/* How the camera was turned: as it was told, where that agrees with the pictures; else, where
 * nothing tells it, as they show it since the first one. A gyroscope tells turns, but no world. */
static struct lp_estimate_orientation orientation_of(struct lp_pipeline *p, const float told[4],
						     float told_sigma_deg, int64_t t_ns)
{
	struct lp_estimate_orientation o = {0};
	struct lp_imager_status status;
	double quaternion[4];

	lp_imager_status(p->imager, &status);
	note_drift(p, &status, t_ns);
	o.left_out = status.orientation_left_out;
	if (p->options.orientation == LP_ORIENTATION_SIM ||
	    p->options.orientation == LP_ORIENTATION_CLIENT) {
		o.known = o.world = status.orientation_told && !o.left_out;
		memcpy(o.xyzw, told, sizeof(o.xyzw));
		o.sigma_deg = told_sigma_deg;
	} else if (p->options.orientation != LP_ORIENTATION_NONE) {
		const struct lp_rotation turned =
			lp_rotation_product(&p->origin, lp_imager_rotation(p->imager));

		lp_rotation_quaternion(&turned, quaternion);
		for (int i = 0; i < 4; i++)
			o.xyzw[i] = (float)quaternion[i];
		o.known = true;
		o.sigma_deg = hypotf(status.rotation_sigma_deg, sqrtf((float)p->drift_deg2));
	}
	return o;
}

bool lp_pipeline_control(struct lp_pipeline *pipeline, const struct lp_camera_control *control,
			 float *command_us)
{
	pipeline->bracketing = control->settable && pipeline->options.brackets > 0;
	pipeline->reports_exposure = control->reports_exposure;
	if (!pipeline->bracketing)
		return false;
	lp_imager_forget(pipeline->imager);
	lp_bracket_init(&pipeline->bracket, pipeline->options.brackets, &control->limits);
	*command_us = lp_bracket_first_us(&pipeline->bracket);
	return true;
}

/* Whether the light has changed in most of the last frames: lamps that flicker, maybe in step with
 * the exposures, so that no single lamp shows it. */
static bool is_restless(struct lp_pipeline *p)
{
	struct lp_imager_status status;

	lp_imager_status(p->imager, &status);
	p->restless +=
		RESTLESS_GAIN * ((status.changed > RESTLESS_CHANGE ? 1.0F : 0.0F) - p->restless);
	return p->restless > RESTLESS || lp_lamp_memory_flicker(&p->lamps.memory) > 0.0F;
}

/* Median of a sample of cells, and the peak. */
static struct lp_bracket_scene look_at_scene(struct lp_pipeline *p,
					     const struct lp_panorama *panorama)
{
	struct lp_bracket_scene scene = {.clipped = panorama->clipped_fraction >
							    LEAST_CLIPPED_FRACTION ||
						    lp_lamp_memory_flicker_clips(&p->lamps.memory),
					 .restless = is_restless(p)};
	int count = 0;

	for (int r = 0; r < panorama->height; r += 2) {
		/* rows count by their length, so that poles do not */
		const int step = (int)fminf(4.0F / lp_imager_grid(p->imager)->row_sin[r],
					    (float)panorama->width);

		for (int c = r % 4; c < panorama->width; c += step) {
			const int cell = r * panorama->width + c;

			if (!(panorama->flags[cell] & LP_CELL_UNSEEN))
				p->scratch[count++] = panorama->cells[cell][LP_LUMINANCE];
		}
	}
	if (count)
		scene.median = lp_select(p->scratch, count, count / 2);
	for (int i = 0; i < panorama->width * panorama->height; i++)
		scene.peak = fmaxf(scene.peak, panorama->cells[i][LP_LUMINANCE]);
	return scene;
}

static struct lp_bracket_decision judge(struct lp_pipeline *p, float reported_us)
{
	struct lp_bracket *b = &p->bracket;

	if (p->reports_exposure)
		return lp_bracket_reported(b, reported_us);
	const struct lp_exposure_match settled = lp_imager_match(p->imager, b->settled_us);
	const struct lp_exposure_match commanded = lp_imager_match(p->imager, b->commanded_us);

	return lp_bracket_judge(b, &settled, &commanded);
}

static struct lp_lamp_stage_work lamp_work(const struct lp_pipeline *p)
{
	return (struct lp_lamp_stage_work){.wanted_lights = p->wanted_lights,
					   .refine_cells = p->preset.refine_cells,
					   .has_film = p->options.film_transmission > 0.0F};
}

/* The frame loaded last corrects what is known. */
static int accept(struct lp_pipeline *p, float exposure_us)
{
	const struct lp_lamp_stage_work work = lamp_work(p);

	lp_imager_settle(p->imager, exposure_us);
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
static int add_to_bracket(struct lp_pipeline *p, struct lp_frame *frame, float *command_us)
{
	const float reported_us = lp_frame_exposure_us(frame);
	int ret = lp_imager_load(p->imager, frame,
				 p->reports_exposure ? reported_us : p->bracket.commanded_us);

	if (ret < 0)
		return ret;
	const struct lp_bracket_decision decision = judge(p, reported_us);

	if (decision.command)
		*command_us = decision.command_us;
	if (decision.forget)
		lp_imager_forget(p->imager);
	if (!decision.accept)
		return -EAGAIN;
	ret = accept(p, decision.exposure_us);
	if (ret < 0)
		return ret;
	const struct lp_bracket_scene scene = look_at_scene(p, lp_imager_panorama(p->imager));
	float next_us;

	if (lp_bracket_next(&p->bracket, &scene, &next_us))
		*command_us = next_us;
	return 0;
}

/* Once the camera holds still again, its own frame is the anchor frame. */
static void rest(struct lp_pipeline *p)
{
	struct lp_rotation turn;

	if (!lp_imager_rest(p->imager, &turn))
		return;
	turn_anchor(p, &turn);
}

void lp_pipeline_ring(struct lp_pipeline *pipeline, const struct lp_ring_sample *sample)
{
	lp_ring_stage_sample(&pipeline->ring, sample);
}

int lp_pipeline_process(struct lp_pipeline *pipeline, struct lp_frame *frame,
			const struct lp_demand *demand, struct lp_estimates *estimates,
			float *command_us)
{
	const int64_t t_arrival_ns = frame->t_arrival_ns;
	const float wheel_deg = frame->wheel_deg;
	const float wheel_sigma_deg = frame->wheel_sigma_deg;
	const float told_sigma_deg = frame->orientation_sigma_deg;
	const float told[4] = {frame->orientation[0], frame->orientation[1], frame->orientation[2],
			       frame->orientation[3]};
	double total[LP_SH_MAX_COUNT][3];
	struct lp_imager_status status;
	int ret;

	pipeline->wanted_lights = demand->max_lights < pipeline->options.max_lights
					  ? demand->max_lights
					  : pipeline->options.max_lights;
	*command_us = NAN;
	ret = pipeline->bracketing ? add_to_bracket(pipeline, frame, command_us)
				   : add(pipeline, frame);
	if (ret < 0)
		return ret;
	struct lp_panorama *panorama = lp_imager_panorama(pipeline->imager);
	const struct lp_grid *grid = lp_imager_grid(pipeline->imager);
	const float mean = lp_grid_mean_luminance(grid, panorama);

	if (pipeline->wanted_lights) { /* else all light is in the SH anyway */
		lp_detect(pipeline->detection, panorama, mean);
		lp_lamp_stage_hold(&pipeline->lamps, pipeline->detection, panorama, mean);
	} else {
		pipeline->detection->finder->count = 0;
	}
	fill_unseen(panorama, grid, pipeline->detection->finder);
	const struct lp_lamp_stage_work work = lamp_work(pipeline);

	lp_lamp_stage_update(&pipeline->lamps, pipeline->imager, pipeline->detection, &work,
			     panorama->t_capture_ns);
	lp_imager_expect_flicker(pipeline->imager, lp_lamp_memory_flicker(&pipeline->lamps.memory));
	lp_imager_status(pipeline->imager, &status);
	lp_ring_stage_update(&pipeline->ring, pipeline->imager, panorama,
			     pipeline->detection->finder->cells, &pipeline->lamps.memory,
			     !status.exposure_unknown);
	estimates->ring = lp_ring_stage_status(&pipeline->ring);
	project(pipeline, panorama, total);
	memset(&estimates->raw, 0, sizeof(estimates->raw));
	fill_estimate(pipeline, panorama, mean, total, &estimates->raw);
	estimates->raw.t_arrival_ns = t_arrival_ns;
	estimates->raw.wheel_deg = wheel_deg;
	estimates->raw.wheel_sigma_deg = wheel_sigma_deg;
	estimates->raw.orientation =
		orientation_of(pipeline, told, told_sigma_deg, panorama->t_capture_ns);
	lp_tracker_update(&pipeline->tracker, &estimates->raw, &estimates->smoothed);
	/* Smoothed light lags behind a change, and says by how much. */
	estimates->smoothed.relighting_sigma =
		hypotf(estimates->raw.relighting_sigma,
		       lp_model_distance(&estimates->raw, &estimates->smoothed));
	turn_to_camera(pipeline->imager, &estimates->raw);
	turn_to_camera(pipeline->imager, &estimates->smoothed);
	rest(pipeline);
	return 0;
}
