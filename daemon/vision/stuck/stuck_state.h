/* SPDX-License-Identifier: Apache-2.0 */
/* What the files of vision/stuck/ share. */
#ifndef LP_VISION_STUCK_STUCK_STATE_H
#define LP_VISION_STUCK_STUCK_STATE_H

#include <math.h>

#include "vision/picture/cells.h"
#include "vision/stuck/stuck.h"

/* Logarithms of odds: of a cell of which nothing is known; and the most, so that what is cured is
 * forgotten after a few looks. */
#define LP_STUCK_UNKNOWN (-INFINITY)
#define LP_STUCK_CERTAIN 9.0F

/* Nothing is known of a cell. */
void lp_stuck_forget_cell(struct lp_stuck *stuck, int cell);

/* The list of cells that are left out, by their odds. */
void lp_stuck_make_list(struct lp_stuck *stuck);

/* The cell so far beside another one; -1: there is none, or nothing is seen there. */
int lp_stuck_beside(const struct lp_stuck *stuck, int cell, int across, int down);

/* Light of a cell, of full scale: the mean of the three colours, so that one that shines in a
 * single colour counts as much whichever that is. */
static inline float lp_stuck_light(const struct lp_cells *cells, int cell)
{
	const float *rgb = cells->radiance[cell];

	return (rgb[0] + rgb[1] + rgb[2]) * (1.0F / 3.0F) / cells->scale;
}

#endif
