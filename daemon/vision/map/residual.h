/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A frame beside what is known: where in the frame each cell of the map lies, and how well the
 * frame tells the light there. All that asks how a frame differs from the map asks it here. Pure
 * computation; one thread; plain data.
 */
#ifndef LP_VISION_MAP_RESIDUAL_H
#define LP_VISION_MAP_RESIDUAL_H

#include "vision/map/radiance_map.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_lookup;

/* Of a cell's light, relative: what the response and the camera's grid do to it. */
#define LP_CELL_SIGMA 0.03F

struct lp_residual {
	const struct lp_radiance_map *map; /* borrowed, as all it holds */
	const struct lp_lookup *lookup;	   /* map to camera; NULL: the same frame of reference */
	struct lp_observation seen;	   /* camera frame */
};

/* Cell of the frame that looks where a cell of the map lies. */
int lp_residual_seen(const struct lp_residual *residual, int cell);

/* Logarithm of light. */
struct lp_log_light {
	float log, variance;
	float code2; /* square of its change per code */
};

/* What a frame tells of a channel of one of its cells, with what the response and the grid do to
 * it. Its logarithm is NAN where that is nothing: too dark, too bright, or marked. */
struct lp_log_light lp_log_light(const struct lp_observation *seen, int cell, int channel);

/* The same, where another light is expected: it decides whether the cell tells, and how well.
 * Judged by what they show, of cells near the darkest that tell those count that noise has raised,
 * and their mean is too high. */
struct lp_log_light lp_log_light_expected(const struct lp_observation *seen, int cell, int channel,
					  float expected);

#ifdef __cplusplus
}
#endif

#endif
