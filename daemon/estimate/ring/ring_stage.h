/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The ring of light sensors in one estimate: what clips in the panorama is found by the newest
 * reading (light/clipped/ring_fusion.h). Anchor frame (vision/imager.h). Owned and called by the
 * pipeline.
 */
#ifndef LP_ESTIMATE_RING_RING_STAGE_H
#define LP_ESTIMATE_RING_RING_STAGE_H

#include <stdbool.h>

#include "estimate/estimates.h"
#include "include/light_estimate.h"
#include "light/clipped/clipped_parts.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/sh.h"
#include "light/ring/ring_colour.h"
#include "light/ring/ring_poses.h"

struct lp_grid;
struct lp_imager;
struct lp_lamp_memory;

/* Zeroed has no reading yet; `parts` are created with the grid. */
struct lp_ring_stage {
	struct lp_clipped_parts *parts;
	struct lp_ring_scale given; /* by the camera file or the user; NAN: none */
	struct lp_ring_colour colour;
	struct lp_ring_scale learned; /* from readings while little clipped; NAN: not yet */
	bool is_relative;	      /* what was learned is of radiance with a scale of its own */
	float scale_variance;	      /* of that, when it was learned */
	struct lp_ring_sample sample; /* newest */
	bool has_sample;
	/* The camera sees nothing where the ring reads light: its lens is covered. */
	bool camera_is_blind;
	bool fused; /* the next two are of the newest panorama */
	struct lp_ring_view view;
	struct lp_ring_fusion fusion;
	struct lp_ring_poses poses;
	struct lp_ring_past past; /* of poses other than the newest panorama's */
};

void lp_ring_stage_init(struct lp_ring_stage *stage, const struct lp_ring_scale *given);

/* For another grid. -ENOMEM: all is as before. */
int lp_ring_stage_resize(struct lp_ring_stage *stage, const struct lp_grid *grid);
void lp_ring_stage_finish(struct lp_ring_stage *stage);

/* Of the next frame; NULL: none. */
void lp_ring_stage_sample(struct lp_ring_stage *stage, const struct lp_ring_sample *sample);

/*
 * After the lamps of the newest frame have been found. `finder_cells`: of the lamps' finder. What
 * clipped lamps have beyond their lower bounds goes into memory->list[].recovered. is_relative:
 * exposures are unknown, and the radiance has not the unit of the scale that was given.
 */
void lp_ring_stage_update(struct lp_ring_stage *stage, const struct lp_imager *imager,
			  const struct lp_panorama *panorama, const int32_t *finder_cells,
			  struct lp_lamp_memory *memory, bool is_relative);

/* Where the camera is blind: what the ring sees by itself takes the place of what the estimate
 * holds of light (estimate/ring/ring_only.h), in the anchor frame. False: it is not blind. */
bool lp_ring_stage_stand_in(const struct lp_ring_stage *stage, const struct lp_imager *imager,
			    double total[LP_SH_MAX_COUNT][3], struct lp_light_estimate *estimate);

/* Light of clipped regions that are no lamps, into coefficients up to LP_SH_MAX_ORDER. */
void lp_ring_stage_project(const struct lp_ring_stage *stage, double (*total)[3]);

/* Clipped regions that are no lamps, as lights without an id; returns how many. */
int lp_ring_stage_parts(const struct lp_ring_stage *stage,
			struct lp_light parts[LP_MAX_CLIPPED_PARTS]);

/* Whether the ring says how much light clips; then the variance of the irradiance, mean over all
 * normals (luminance), is what it leaves unknown. */
bool lp_ring_stage_knows(const struct lp_ring_stage *stage, float *variance);

/* cd/m^2 per unit as known now; NAN: not known within MOST_SCALE_SIGMA. is_relative: as above. */
struct lp_ring_scale lp_ring_stage_scale(const struct lp_ring_stage *stage, bool is_relative);

struct lp_ring_status lp_ring_stage_status(const struct lp_ring_stage *stage);

#endif
