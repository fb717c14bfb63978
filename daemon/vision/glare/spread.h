/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Light of a coarse grid of the sphere, spread around where it comes from by the kernel (1 + (angle
 * / width)^2)^-1.5. On a grid of equal steps of longitude the kernel of two rows depends on the
 * difference of their columns alone: so rows are transformed by Fourier's sums, multiplied, and
 * transformed back (Cooley's convolution theorem; 30 x 60 nodes need no fast transform).
 *
 * Node (column c, row r) looks along the centre of the cell of the same place of a panorama of this
 * size (include/panorama.h). Pure computation; one thread.
 */
#ifndef LP_VISION_GLARE_SPREAD_H
#define LP_VISION_GLARE_SPREAD_H

#ifdef __cplusplus
extern "C" {
#endif

#define LP_VEIL_WIDTH 60
#define LP_VEIL_HEIGHT 30
#define LP_VEIL_NODES (LP_VEIL_WIDTH * LP_VEIL_HEIGHT)

struct lp_spread;

int lp_spread_create(float width_deg, struct lp_spread **spread); /* -ENOMEM */
void lp_spread_destroy(struct lp_spread *spread);		  /* accepts NULL */

/* to[i] = sum over all nodes j of kernel(angle between i and j) from[j]. R, G, B, luminance. */
void lp_spread_apply(struct lp_spread *spread, const float (*from)[4], float (*to)[4]);

#ifdef __cplusplus
}
#endif

#endif
