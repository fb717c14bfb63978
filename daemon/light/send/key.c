/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/key.h"

#include <math.h>

#include "include/luminance.h"
#include "light/linear/vector.h"
#include "light/math/sh.h"

/* Y_1 of a direction is so many times its components. */
#define Y1 0.48860251
/* KEY's strength grows with the square of the first band below this share of the mean, linearly
 * above: where the light comes from nowhere, its direction does not matter. */
#define FAINT 0.1

/* The first band of one channel as a vector. */
static void first_band(const float (*sh)[3], int channel, double v[3])
{
	v[0] = sh[3][channel];
	v[1] = sh[1][channel];
	v[2] = sh[2][channel];
}

struct lp_light lp_key_light(const float (*sh)[3])
{
	const double mean = fmaxf(lp_luminance(sh[0]), 0.0F);
	/* squares of very dim or bright light are no floats */
	const double v[3] = {lp_luminance(sh[3]), lp_luminance(sh[1]), lp_luminance(sh[2])};
	const double length = sqrt(lp_dot(v, v));
	struct lp_light key = {
		.direction = {0.0F, 1.0F, 0.0F},
		.angular_radius_deg = LP_KEY_RADIUS_DEG,
		.direction_sigma_deg = NAN,
		.irradiance_sigma = NAN,
		.distance_m = NAN,
	};

	if (!(length > 0.0))
		return key;
	for (int c = 0; c < 3; c++) {
		double own[3];

		first_band(sh, c, own);
		key.direction[c] = (float)(v[c] / length);
		key.irradiance[c] = (float)(LP_KEY_SHARE / Y1 *
					    fmax(lp_dot(own, v) / (length + FAINT * mean), 0.0));
	}
	return key;
}

void lp_key_remove(int order, const struct lp_light *key, float (*sh)[3])
{
	double own[LP_MAX_SH_COUNT][3] = {{0.0}};

	lp_sh_add_lamp(order, key->direction, key->irradiance, 0.0, 1.0, own);
	for (int i = 0; i < LP_SH_COUNT(order); i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] -= (float)own[i][c];
}
