/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From one frame to one estimate, synchronously: vision, light and tracking in order. Owned and
 * called by the worker thread alone; knows nothing of loops, devices or clients.
 */
#ifndef LP_ESTIMATE_PIPELINE_H
#define LP_ESTIMATE_PIPELINE_H

#include <stdbool.h>

#include "estimate/estimates.h"
#include "estimate/exposures/bracket.h"
#include "estimate/ring/ring_stage.h"
#include "include/frame.h"
#include "include/light_estimate.h"
#include "light/find/detection.h"

struct lp_camera_file;
struct lp_pipeline;
struct lp_polarization_grid;

#define LP_DECODE_BY_BLOCKS (-1)
#define LP_NONE (-1)
#define LP_MOST_EXACT_BLOCKS 65536

/* From the fastest to the most accurate. */
enum lp_preset { LP_PRESET_FAST, LP_PRESET_BALANCED, LP_PRESET_ACCURATE, LP_PRESET_REFERENCE };

/* How it is known where the camera looks. */
enum lp_orientation_kind {
	LP_ORIENTATION_NONE,   /* it never turns */
	LP_ORIENTATION_VISUAL, /* from its own frames */
	LP_ORIENTATION_FRAMES, /* besides, frames carry it: the simulator's, and recorded ones */
	LP_ORIENTATION_CLIENT, /* besides, a client's poses tell it: frames are stamped */
	LP_ORIENTATION_SENSOR, /* besides, a gyroscope tells turns: frames are stamped */
};

/* A polarizing film, as calibrated (light/film/polarization.h). */
struct lp_film_numbers {
	float transmission; /* along its axis plus across it; 0: there is no film */
	float extinction;
	float index;	  /* refractive, of its surfaces */
	bool is_stack;	  /* three at angles that are not the wheel's */
	float offset_deg; /* of its axis on the wheel */
	float rest_s;	  /* between sweeps */
};

struct lp_pipeline_options {
	/* NULL: equirectangular; borrowed during create. lp_frame.camera is the index. */
	const struct lp_camera_file *cameras[LP_MAX_CAMERAS];
	int camera_count; /* 0: one */
	enum lp_preset preset;
	int panorama_width; /* 0: as the preset says */
	/* JPEG: 1, 2, 4, 8 by libjpeg-turbo; 0: as the preset says; LP_DECODE_BY_BLOCKS */
	int decode_divisor;
	/* 0: as the preset says; LP_NONE: none */
	int exact_blocks; /* most blocks decoded after all, where blocks are read */
	int refine_cells; /* largest lamp refined, in camera cells */
	struct lp_detector_options detector;
	int max_lights; /* 0..8: most lights looked for */
	int sh_order;	/* 0..4: highest order estimated */
	int brackets; /* most exposures of a bracket of our own making; 0: exposure is left alone */
	enum lp_orientation_kind orientation;
	float rig_sigma_deg; /* of the cameras' rotations against each other */
	/* In front of the lens, with a wheel whose angle frames carry; transmission 0: none. */
	struct lp_film_numbers film;
	struct lp_ring_scale scale; /* cd/m^2 per unit of radiance; NAN: not known */
	float smoothing_ms;	    /* time constant of the smoothed estimate; 0: none */
	float ttl_ms;
	int reflection_size; /* the largest that may be wanted: 0, 16, 32, 64 */
};

/* What can be done about the camera's exposure (include/source.h), once it is known. */
struct lp_camera_control {
	int camera; /* which of several */
	bool lost;  /* it is away, until the next control: the rest does not count */
	bool settable;
	bool reports_exposure; /* each frame carries the exposure that it had */
	struct lp_bracket_limits limits;
};

/* -EINVAL: an option is out of range; -ENOENT, -EBADMSG: the camera file (logged by name and line).
 */
int lp_pipeline_create(const struct lp_pipeline_options *options, struct lp_pipeline **pipeline);

/*
 * Work by another preset from the next frame on; what single options say stays in force. Lower than
 * the one chosen at create(): estimates are flagged DEGRADED. The panorama begins anew, so that
 * estimates are flagged until every exposure of a bracket has come again. -ENOMEM, logged: all is
 * as before.
 */
int lp_pipeline_set_preset(struct lp_pipeline *pipeline, enum lp_preset preset);

/* The preset in force. */
enum lp_preset lp_pipeline_preset(const struct lp_pipeline *pipeline);

/* A camera has begun to stream, or has gone: begin a bracket with it, if options and camera allow.
 * Returns whether there is a first command to give to it. */
bool lp_pipeline_control(struct lp_pipeline *pipeline, const struct lp_camera_control *control,
			 float *command_us);

/* What the ring of light sensors read of the next frame's light, and what it reads now; NULL:
 * nothing. */
void lp_pipeline_ring(struct lp_pipeline *pipeline, const struct lp_ring_sample *then,
		      const struct lp_ring_sample *now);

/* How fast the camera turns, in radians per second, as the newest frame shows it. */
float lp_pipeline_turn_rad_s(const struct lp_pipeline *pipeline);

/*
 * The ring has read light that jumped, between frames. 0: `estimates` is filled: the newest frame's
 * with what the ring says of it now. -EAGAIN: no lamp was switched, or not one worth telling.
 * commands_us: as below, one for each camera.
 */
int lp_pipeline_step(struct lp_pipeline *pipeline, const struct lp_ring_sample *now,
		     struct lp_estimates *estimates, float commands_us[LP_MAX_CAMERAS]);

/*
 * Takes over the reference to `frame`. 0: `estimates` is filled. -EAGAIN: no estimate from this
 * frame (its exposure could not be told, and a wrong one is worse than none). -EBADMSG: frame
 * refused (broken, wrong size), logged; the state is as before the call. *command_us: exposure
 * times gain to command its camera now; NAN: leave it as it is.
 */
int lp_pipeline_process(struct lp_pipeline *pipeline, struct lp_frame *frame,
			const struct lp_demand *demand, struct lp_estimates *estimates,
			float *command_us);

/* How light is polarized, as of the frame processed last, as far as the angles of the film tell.
 * False: there is no film. */
bool lp_pipeline_polarization(const struct lp_pipeline *pipeline,
			      struct lp_polarization_grid *grid);

void lp_pipeline_destroy(struct lp_pipeline *pipeline); /* accepts NULL */

#endif
