/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The light by the ring of light sensors alone: one lamp and an even surround,
 *
 *     lux_k = pi ambient + lamp max(0, n_k . direction),
 *
 * by least squares, for every direction of a grid and then by Gauss and Newton. White, in cd/m^2.
 * Pure.
 */
#ifndef LP_LIGHT_RING_RING_ALONE_H
#define LP_LIGHT_RING_RING_ALONE_H

#include <stdbool.h>

#include "include/ring_sample.h"

struct lp_ring_alone {
	float ambient;			 /* radiance all around, cd/m^2 */
	float lamp;			 /* irradiance at normal incidence, lux */
	float direction[3];		 /* towards the lamp, probe frame */
	float ambient_sigma, lamp_sigma; /* 1 sigma, in the same units */
	float direction_sigma_deg;	 /* of the angle, root mean square */
	float misfit; /* mean squared residual, in sigmas squared: what one lamp does not explain */
};

/* False: fewer than five sensors can be used, or it is dark. */
bool lp_ring_alone(const struct lp_ring_sample *sample, struct lp_ring_alone *light);

#endif
