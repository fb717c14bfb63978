/* SPDX-License-Identifier: Apache-2.0 */
/* Which exposure a frame had, by what it shows: lp_imager_match(). */
#include <math.h>

#include "include/luminance.h"
#include "vision/imager_internal.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* Every so many cells is compared: enough for a mean. */
#define STEP 5
/* Linear values below this, of full scale, are within a camera's noise: they are all alike, and
 * tell nothing when longer exposures are predicted from them. */
#define LEAST_LINEAR 0.002F

/* Of a square-root response, 0..1, between noise and full scale. */
static float code_of(float linear)
{
	return sqrtf(fminf(fmaxf(linear, LEAST_LINEAR), 1.0F));
}

struct lp_exposure_match lp_imager_match(const struct lp_imager *imager, float exposure_us)
{
	const struct lp_cells *seen = &imager->incoming.cells, *known = imager->shown;
	struct lp_exposure_match match = {.difference_codes = NAN};
	float least_known = INFINITY;
	double sum = 0.0;
	int compared = 0, looked_at = 0;

	if (!imager->loaded || !known || isnan(seen->mean_code))
		return match;
	/* what the longest exposure so far could just make out */
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		if (imager->exposure[k].serial)
			least_known = fminf(least_known, LEAST_LINEAR * imager->exposure[k].scale);
	for (int i = 0; i < seen->width * seen->height; i += STEP, looked_at++) {
		const float observed = seen->radiance[i][LP_LUMINANCE] / seen->scale;
		const float predicted = known->radiance[i][LP_LUMINANCE] * exposure_us * 1e-6F;

		/* a clipped cell is known to be bright, not how bright */
		if ((known->clipped[i] && predicted < 1.0F) ||
		    (known->radiance[i][LP_LUMINANCE] < least_known && predicted > LEAST_LINEAR))
			continue;
		sum += fabsf(code_of(predicted) - code_of(observed));
		compared++;
	}
	if (compared)
		match.difference_codes = (float)(255.0 * sum / compared);
	match.compared = (float)compared / (float)looked_at;
	return match;
}
