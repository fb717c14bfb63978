/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What reflections are made of: the radiance map on a cube (light/cube.h), without the lamps, which
 * are added for each subscription as it lists them (app/reflection_maps.h).
 */
#ifndef LP_APP_SURROUNDINGS_H
#define LP_APP_SURROUNDINGS_H

#include <stdint.h>

#include "include/light_estimate.h"
#include "light/cube.h"

struct lp_grid;
struct lp_lamp_finder;
struct lp_lamp_memory;
struct lp_panorama;
struct lp_rotation;

/* Probe frame, at the estimate's capture time. */
struct lp_surroundings {
	int size; /* texels along an edge; 0: none were wanted */
	/* Lights of the estimate whose light is in it: area lights, and lamps that the newest
	 * panorama does not show as such. All others are not in it. */
	int kept_count;
	uint32_t kept[LP_MAX_LIGHTS];
	_Alignas(16) float rgb[3][LP_CUBE_MOST_TEXELS]; /* LP_CUBE_TEXELS(size) of each */
};

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
