/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/lamp/rim.h"

#include <math.h>
#include <stdbool.h>

#include "include/luminance.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors"
 * (docs/maintainers/constants.md). */

/* Pixels of the rim: the brightest channel above the background, and below saturation; shares of
 * full scale. */
#define RIM_FROM 0.3F
#define RIM_TO 0.97F
/* A JPEG keeps one colour for four pixels, and roughly: so few pixels say nothing, and so many all.
 */
#define FEW_PIXELS 30.0F
#define MANY_PIXELS 60.0F

/* A channel whose brightest pixel is this share of full scale has not clipped, or has: green is
 * nearly the luma, which a JPEG keeps in full resolution. */
static const float unclipped[3] = {0.8F, 0.95F, 0.75F}, clipped[3] = {0.95F, 0.985F, 0.9F};

static float ramp(float value, float from, float to)
{
	return fminf(fmaxf((value - from) / (to - from), 0.0F), 1.0F);
}

void lp_rim_add(struct lp_rim_sums *sums, const float (*rgb)[3], int count,
		const float background[3], const float full[3])
{
	for (int p = 0; p < count; p++) {
		float most = 0.0F, most_above = 0.0F;

		for (int c = 0; c < 3; c++) {
			const float share = rgb[p][c] / full[c];

			most = fmaxf(most, share);
			most_above = fmaxf(most_above, share - background[c] / full[c]);
			sums->brightest[c] = fmaxf(sums->brightest[c], share);
		}
		const bool counts = most < RIM_TO && most_above > RIM_FROM;

		for (int c = 0; counts && c < 3; c++)
			sums->light[c] += (double)(rgb[p][c] - background[c]);
		sums->count += counts;
	}
}

struct lp_lamp_rim lp_rim_of(const struct lp_rim_sums *sums)
{
	struct lp_lamp_rim rim = {0};
	float light[3];

	for (int c = 0; c < 3; c++) {
		light[c] = (float)fmax(sums->light[c], 0.0);
		rim.clips[c] = ramp(sums->brightest[c], unclipped[c], clipped[c]);
	}
	const float luminance = lp_luminance(light);

	for (int c = 0; luminance > 0.0F && c < 3; c++)
		rim.tint[c] = light[c] / luminance;
	rim.trust = luminance > 0.0F ? ramp((float)sums->count, FEW_PIXELS, MANY_PIXELS) : 0.0F;
	return rim;
}
