/* SPDX-License-Identifier: Apache-2.0 */
/* What imager.c and refine.c share. */
#ifndef LP_VISION_IMAGER_INTERNAL_H
#define LP_VISION_IMAGER_INTERNAL_H

#include "include/panorama.h"
#include "vision/camera.h"
#include "vision/imager.h"
#include "vision/response.h"

struct lp_remap;

#define LP_REFINE_MAX_CELLS 1024 /* camera cells of one lamp */
#define LP_CELL_MAX_PX 64	 /* pixels of one camera cell */

struct lp_imager {
	const struct lp_camera *camera; /* borrowed */
	struct lp_imager_options options;
	struct lp_response response;
	struct lp_grid *grid;
	struct lp_remap *remap;	   /* of the current picture size */
	float *row_weight;	   /* of the current picture size: solid angle up to a factor */
	float *row_solid_angle_sr; /* of one pixel, equirectangular; same block as row_weight */
	struct lp_exposure exposure[LP_MAX_BRACKET]; /* serial 0: empty */
	struct lp_exposure incoming;		     /* loaded, not accepted yet */
	int64_t incoming_t_capture_ns;
	bool loaded;
	const struct lp_cells *shown; /* that the panorama was made from; NULL: none yet */
	uint64_t serial;
	uint64_t changed_serial; /* of the last exposure that showed other light than before it */
	struct lp_cells merged;
	/* its cells and flags are those below, or the camera's where the two grids are the same */
	struct lp_panorama panorama;
	float (*mapped)[4];
	uint8_t *flags;

	/* refine.c */
	int *place;	    /* per camera cell: index into the patch that saw it last */
	float (*pixels)[3]; /* of LP_REFINE_MAX_CELLS camera cells */
};

#endif
