/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_VISION_CHANGE_H
#define LP_VISION_CHANGE_H

#ifdef __cplusplus
extern "C" {
#endif

struct lp_cells;

/*
 * How much of the light `now` shows elsewhere, or brighter or darker, than `then` did: a share of
 * all light in `known`; 0 where only noise differs, and for float frames. All three of one
 * geometry, in radiance. row_weight: per pixel row, its solid angle up to a factor.
 */
float lp_cells_change(const struct lp_cells *now, const struct lp_cells *then,
		      const struct lp_cells *known, const float *row_weight);

#ifdef __cplusplus
}
#endif

#endif
