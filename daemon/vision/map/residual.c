/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/residual.h"

#include <math.h>

#include "light/math/grid.h"
#include "vision/camera/response.h"
#include "vision/map/lookup.h"

/* Noisier cells tell nothing (relative); nor do those that are brighter, of full scale, where
 * pixels within them may be saturated unseen. */
#define MOST_NOISE 0.1F
#define BRIGHTEST 0.8F

int lp_residual_seen(const struct lp_residual *residual, int cell)
{
	const struct lp_lookup *l = residual->lookup;

	if (!l)
		return cell;
	return (l->across[cell] < 0.5F ? l->left[cell] : l->right[cell]) +
	       (l->down[cell] < 0.5F ? 0 : l->grid->width);
}

struct lp_log_light lp_log_light_expected(const struct lp_observation *seen, int cell, int channel,
					  float expected)
{
	const float light = seen->radiance[cell][channel], linear = expected / seen->scale;

	if (seen->flags[cell] || !(light > 0.0F) || !(linear > 0.0F) || linear > BRIGHTEST)
		return (struct lp_log_light){.log = NAN};
	/* rounding is that of what the picture showed */
	const float shown = seen->veil ? linear + seen->veil[cell] / seen->scale : linear;
	const float code2 = 1.0F / lp_response_weight(seen->response, shown) / (linear * linear);
	const float noise2 = seen->code_variance * code2;

	if (noise2 > MOST_NOISE * MOST_NOISE)
		return (struct lp_log_light){.log = NAN};
	return (struct lp_log_light){.log = logf(light),
				     .variance = noise2 + LP_CELL_SIGMA * LP_CELL_SIGMA,
				     .code2 = code2};
}

struct lp_log_light lp_log_light(const struct lp_observation *seen, int cell, int channel)
{
	return lp_log_light_expected(seen, cell, channel, seen->radiance[cell][channel]);
}
