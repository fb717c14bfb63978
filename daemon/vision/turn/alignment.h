/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How a picture is turned against the radiance map, from what both show: Gauss-Newton on the
 * logarithm of luminance with robust weights, coarse to fine (inverse compositional: Baker &
 * Matthews 2004). The logarithm makes a wrong exposure an offset, which is solved for, too. The map
 * holds every brightness, so that it overlaps with any exposure. One thread; storage is allocated
 * once.
 */
#ifndef LP_VISION_TURN_ALIGNMENT_H
#define LP_VISION_TURN_ALIGNMENT_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_alignment;
struct lp_grid;
struct lp_observation;
struct lp_radiance_map;
struct lp_rotation;
struct lp_shear;

int lp_alignment_create(const struct lp_grid *grid, struct lp_alignment **alignment);
void lp_alignment_destroy(struct lp_alignment *alignment); /* accepts NULL */

/* Look at both; the picture in the camera's own frame, its rows exposed as `shear` says. */
void lp_alignment_load(struct lp_alignment *alignment, const struct lp_radiance_map *map,
		       const struct lp_observation *picture, const struct lp_shear *shear);

struct lp_alignment_result {
	double turn[3]; /* rotation vector, camera frame: rotation = guess * exp(turn) */
	/* Inverse covariance of `turn` from the pictures alone, per rad^2. */
	double information[3][3];
	double log_gain; /* of the picture over the map */
	float compared;	 /* share of the sphere that could be compared */
	float agreement; /* share of that which agrees after alignment; 0: nothing */
};

/*
 * guess: rotation camera -> map. prior: inverse covariance of the guess (camera frame, per rad^2).
 * prior_sigma_rad: how far off the guess may be; decides how coarse to begin.
 */
struct lp_alignment_result lp_alignment_solve(struct lp_alignment *alignment,
					      const struct lp_rotation *guess,
					      const double prior[3][3], double prior_sigma_rad);

#ifdef __cplusplus
}
#endif

#endif
