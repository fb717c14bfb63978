/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lamps of a frame: those remembered tell how a turning camera is turned; those that detection
 * found on the panorama are looked at in full resolution and correct what is remembered. Anchor
 * frame (vision/imager.h). Owned and called by the pipeline.
 */
#ifndef LP_ESTIMATE_LAMP_STAGE_H
#define LP_ESTIMATE_LAMP_STAGE_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"
#include "light/lamps/lamp_memory.h"

struct lp_detection;
struct lp_grid;
struct lp_imager;
struct lp_panorama;
struct lp_rotation;

/* Zeroed is a new one. */
struct lp_lamp_stage {
	struct lp_lamp_memory memory;
	int64_t t_ns; /* of the last update; 0: none yet */
	/* Luminance of each cell of the panorama, mean of the last second or so; the caller's
	 * storage. */
	float *before;
	bool has_before;
	/* Of the newest frame that told where the probe was; sigma_m 0: none has. */
	struct lp_probe_pose pose;
	bool is_placed;	     /* the newest one does */
	uint32_t told_by;    /* who told it */
	bool film_is_turned; /* a quarter turn off */
	/* So many bright regions, listed or not, have appeared whose polarization was not known. */
	uint32_t unmeasured;
};

struct lp_lamp_stage_work {
	int wanted_lights; /* so many, and a few that may take their places, are looked at closer */
	int refine_cells; /* largest lamp looked at closer, in cells that hold its light; 0: none */
	bool has_film;
};

/* The frame just loaded tells where the probe is now: lamps that are near are elsewhere. Before
 * lp_lamp_stage_steer(). True: it has gone by `way_m`, anchor frame, since such a frame before. */
bool lp_lamp_stage_go(struct lp_lamp_stage *stage, const struct lp_imager *imager, double way_m[3]);

/* The frame just loaded shows how the camera is turned by the lamps that are remembered: they tell
 * better than all else. Before it is accepted; its radiance must be scaled rightly. A camera that
 * holds still is left alone. */
void lp_lamp_stage_steer(struct lp_lamp_stage *stage, struct lp_imager *imager,
			 const struct lp_detection *detection,
			 const struct lp_lamp_stage_work *work);

/* After detection: remembered lamps keep their borders (light/lamps/holding.h). mean: mean
 * luminance. */
void lp_lamp_stage_hold(struct lp_lamp_stage *stage, struct lp_detection *detection,
			const struct lp_panorama *panorama, float mean);

/* The lamps in detection->finder, of the imager's newest frame, whose panorama this is. */
void lp_lamp_stage_update(struct lp_lamp_stage *stage, struct lp_imager *imager,
			  const struct lp_detection *detection,
			  const struct lp_lamp_stage_work *work,
			  const struct lp_panorama *panorama);

/* The anchor frame has been turned. */
void lp_lamp_stage_turn(struct lp_lamp_stage *stage, const struct lp_rotation *turn);

/* Fill the estimate's lights: lamps, then area lights, `most` in all; returns how many lamps there
 * are: those that exist more likely than not (light/lamps/existence.h). Of too many those stay
 * that have been listed before, unless others clearly outshine them. */
int lp_lamp_stage_list(struct lp_lamp_stage *stage, const struct lp_grid *grid,
		       const struct lp_panorama *panorama, int most,
		       struct lp_light_estimate *estimate);

#endif
