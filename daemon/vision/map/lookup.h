/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A panorama seen from a turned frame: for every cell of one grid, which four cells of another grid
 * of the same size surround the same direction, and how near it lies to each (bilinear). One
 * thread; storage is allocated once.
 */
#ifndef LP_VISION_MAP_LOOKUP_H
#define LP_VISION_MAP_LOOKUP_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_grid;
struct lp_rotation;
struct lp_shear;

struct lp_lookup {
	const struct lp_grid *grid; /* borrowed */
	/* Per cell: the upper left one of the four, and the right one in the same row (rows do not
	 * wrap: the last two are used beyond a pole). */
	int32_t *left, *right;
	float *across, *down; /* 0 (left, upper) .. 1 */
	float (*smooth)[4];   /* workspace: the rows near the poles, of one cell's width */
	uint8_t *wide;	      /* workspace: marks and their neighbours' */
};

int lp_lookup_create(const struct lp_grid *grid, struct lp_lookup **lookup); /* -ENOMEM */
void lp_lookup_destroy(struct lp_lookup *lookup);			     /* accepts NULL */

/* `rotation` turns a direction of the grid that is filled into one of the grid that is read. */
void lp_lookup_set(struct lp_lookup *lookup, const struct lp_rotation *rotation);

/* The same where the grid that is read is a picture whose rows were exposed one after the other
 * (lp_shear_from_middle()). */
void lp_lookup_set_sheared(struct lp_lookup *lookup, const struct lp_rotation *rotation,
			   const struct lp_shear *shear);

/*
 * Fill `to` from `from` (R, G, B, luminance). Where columns crowd towards a pole, `from` is first
 * averaged over as many of them as one cell is wide, so that no small lamp is missed between
 * samples. step2: per cell, the squared change of luminance from one cell to the next there.
 */
void lp_lookup_radiance(struct lp_lookup *lookup, const float (*from)[4], float (*to)[4],
			float *step2);

/* Variance of each cell's luminance, as what it shows lies elsewhere: step2 times the variance in
 * cells^2 of where its direction d lies, least + d' across d. */
void lp_lookup_place_variance(const struct lp_lookup *lookup, const float *step2, float least,
			      const double across[3][3], float *variance);

/* Marks (enum lp_cell_flag) of all four cells, so that none is lost; next to those LP_CELL_BESIDE
 * (_DARK).
 */
void lp_lookup_marks(struct lp_lookup *lookup, const uint8_t *from, uint8_t *to);

/* The largest of the four cells' values. */
void lp_lookup_largest(const struct lp_lookup *lookup, const float *from, float *to);

#ifdef __cplusplus
}
#endif

#endif
