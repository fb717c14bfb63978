/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What reflections are made of: the radiance map on a cube (light/send/cube.h), without the lamps,
 * which are added for each subscription as it lists them (serve/reflection_maps.h).
 */
#ifndef LP_ESTIMATE_SURROUNDINGS_H
#define LP_ESTIMATE_SURROUNDINGS_H

#include "estimate/estimates.h"

struct lp_grid;
struct lp_lamp_finder;
struct lp_lamp_memory;
struct lp_panorama;
struct lp_rotation;

/* What the panorama shows. All borrowed. */
struct lp_view_of_lamps {
	const struct lp_grid *grid;
	const struct lp_panorama *panorama;
	const struct lp_lamp_memory *memory;
	const struct lp_lamp_finder *finder;
	const struct lp_rotation *rotation; /* probe frame to the panorama's */
};

/* Fill `surroundings` but for its size, which says what is wanted. `cells`: workspace of the
 * panorama's size. */
void lp_surroundings_look(struct lp_surroundings *surroundings, const struct lp_view_of_lamps *view,
			  const struct lp_light_estimate *estimate, float (*cells)[4]);

#endif
