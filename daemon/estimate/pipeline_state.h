/* SPDX-License-Identifier: Apache-2.0 */
/* What a pipeline is made of: for the files pipeline*.c alone. */
#ifndef LP_ESTIMATE_PIPELINE_STATE_H
#define LP_ESTIMATE_PIPELINE_STATE_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/exposures/bracket.h"
#include "estimate/lamp_stage.h"
#include "estimate/pipeline.h"
#include "estimate/ring/ring_stage.h"
#include "estimate/ring/ring_steps.h"
#include "include/frame.h"
#include "include/panorama.h"
#include "light/send/tracker.h"
#include "light/math/rotation.h"
#include "light/place/room.h"
#include "vision/imager.h"
#include "vision/map/sh_project.h"

/* Chosen by hand (docs/maintainers/constants.md): less clipped light than this is not told. */
#define LP_LEAST_CLIPPED_FRACTION 1e-5F

/* What each preset means; `make bench` measures the trade. */
struct lp_preset_work {
	enum lp_decode decode;
	int divisor;
	int exact_blocks;
	int refine_cells; /* largest lamp refined, in cells that hold its light; 0: none */
	int panorama_width;
};

/* One of several cameras, and what is done about its exposure. */
struct lp_pipeline_camera {
	struct lp_camera *geometry;
	struct lp_bracket bracket;
	bool bracketing, reports_exposure;
};

struct lp_pipeline {
	struct lp_pipeline_options options;
	struct lp_preset_work preset; /* in force, with what single options say */
	enum lp_preset in_force;      /* may be lower than options.preset */
	int camera_count;
	struct lp_pipeline_camera cameras[LP_MAX_CAMERAS];
	struct lp_imager *imager;
	struct lp_detection *detection;
	struct lp_sh_projector *projector;
	struct lp_lamp_stage lamps;
	struct lp_room *room; /* NULL: nothing tells where the probe is */
	struct lp_ring_stage ring;
	struct lp_ring_sample ring_now; /* the newest; the frame's is the ring stage's */
	bool has_ring_now;
	struct lp_ring_steps steps;
	struct lp_tracker tracker;
	int places_left_out;  /* of the pictures, as of the newest frame */
	float restless;	      /* share of the last frames that showed changed light */
	float *scratch;	      /* cells of the panorama, for its median */
	uint8_t *view;	      /* cells that the newest frame's camera looks at, if it sees a part */
	float (*filled)[4];   /* of a panorama that is not seen whole, with what stands in */
	float (*surround)[4]; /* of the panorama, without lamps; NULL: no reflection maps */
	int wanted_lights;    /* by the options and the most demanding subscriber */
	uint32_t sequence;
	struct lp_rotation origin; /* anchor frame to that of the first frame */
	double drift_deg2;	   /* variance of what the anchor frame has drifted since then */
	int64_t t_drift_ns;
};

/* The anchor frame is another: `turn` is the rotation from the old one to the new one. */
void lp_pipeline_turn_anchor(struct lp_pipeline *pipeline, const struct lp_rotation *turn);

/*
 * Fills a zeroed estimate, in the anchor frame, from the panorama and the lamps as they are; `mean`
 * is the panorama's mean luminance. `total` becomes all orders of its light. Beside it stay the
 * times and the wheel, which are the frame's.
 */
void lp_pipeline_fill(struct lp_pipeline *pipeline, const struct lp_panorama *panorama, float mean,
		      double total[LP_SH_MAX_COUNT][3], struct lp_light_estimate *estimate);

/* The smoothed estimate follows the raw one, and both are turned from the anchor frame to the
 * camera's at the newest frame. */
void lp_pipeline_finish(struct lp_pipeline *pipeline, struct lp_estimates *estimates);

/* A frame's estimate, anchor frame, is corrected by steps of light that the ring has seen since
 * (estimate/ring/ring_steps.h); `total`: all orders of its light. */
void lp_pipeline_use_ring(struct lp_pipeline *pipeline, const double (*total)[3],
			  struct lp_light_estimate *estimate);

/*
 * How the camera was turned in the newest frame, of t_ns: as it is told where that agrees with the
 * pictures; else, where nothing tells it, as they show it since the first one.
 */
struct lp_estimate_orientation lp_pipeline_orientation(struct lp_pipeline *pipeline, int64_t t_ns);

#endif
