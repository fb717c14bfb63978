/* SPDX-License-Identifier: Apache-2.0 */
/* Whether an exposure shows other light than what was known before. */
#include <math.h>

#include "include/luminance.h"
#include "vision/imager_internal.h"

/* Differences up to so many codes are a camera's noise, and what is left of a JPEG's rounding in
 * the mean of a block. Chosen by hand. */
#define NOISE_CODES 3.0F
/* Slope of sRGB at 0, linear light per code: darker than that nothing is resolved. */
#define LEAST_STEP (1.0F / (12.92F * 255.0F))

/* What noise may make of `linear` (0..1 of full scale); of a square-root response. */
static float allowance(float linear)
{
	const float step = 2.0F * sqrtf(fmaxf(linear, 0.0F)) / 255.0F;

	return NOISE_CODES * fmaxf(step, LEAST_STEP);
}

/* A clipped cell is a lower bound: only what exceeds it is a difference. */
static float difference(const struct lp_cells *now, const struct lp_cells *then, int i)
{
	const float more = now->radiance[i][LP_LUMINANCE] - then->radiance[i][LP_LUMINANCE];

	if (now->clipped[i] && then->clipped[i])
		return 0.0F;
	if (now->clipped[i])
		return fmaxf(more, 0.0F);
	return then->clipped[i] ? fmaxf(-more, 0.0F) : fabsf(more);
}

float lp_imager_change(const struct lp_imager *imager, const struct lp_cells *then)
{
	const struct lp_cells *now = &imager->incoming.cells, *known = imager->shown;
	double changed = 0.0, all = 0.0;

	if (!known || isnan(now->mean_code) || isnan(then->mean_code))
		return 0.0F;
	for (int row = 0, i = 0; row < now->height; row++) {
		const float weight = imager->row_weight[row * now->cell_px + now->cell_px / 2];
		float row_changed = 0.0F, row_all = 0.0F;

		for (int column = 0; column < now->width; column++, i++) {
			const float most = fmaxf(now->radiance[i][LP_LUMINANCE],
						 then->radiance[i][LP_LUMINANCE]);
			const float noise = allowance(most / now->scale) * now->scale;

			row_changed += fmaxf(difference(now, then, i) - noise, 0.0F);
			row_all += known->radiance[i][LP_LUMINANCE];
		}
		changed += (double)(weight * row_changed);
		all += (double)(weight * row_all);
	}
	return all > 0.0 ? (float)(changed / all) : 0.0F;
}
