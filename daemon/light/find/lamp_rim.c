/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/lamp_rim.h"

#include <math.h>

#include "include/luminance.h"

/* Of the luminance: a colour that is not there has no logarithm. */
#define LEAST_TINT 0.01F

void lp_lamp_rim_apply(const struct lp_lamp_rim *rim, float tint[3])
{
	float hidden[3];

	for (int c = 0; c < 3; c++)
		hidden[c] = rim->clips[c] * powf(fmaxf(tint[c], LEAST_TINT), 1.0F - rim->trust) *
			    powf(fmaxf(rim->tint[c], LEAST_TINT), rim->trust);
	const float luminance = lp_luminance(hidden);

	for (int c = 0; luminance > 0.0F && c < 3; c++)
		tint[c] = hidden[c] / luminance;
}
