/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/residual.h"

#include <math.h>

#include "light/math/grid.h"
#include "vision/camera/response.h"
#include "vision/imager_internal.h"
#include "vision/map/lookup.h"

/* Noisier cells tell nothing (relative); nor do those that are brighter, of full scale, where
 * pixels within them may be saturated unseen. */
#define MOST_NOISE 0.1F
#define BRIGHTEST 0.8F

/* Lamps flicker at this, or at 120 Hz. */
#define MAINS_HZ 100.0F

/* Share of a flicker's depth that an exposure shows; the rest averages out over whole periods. */
static float flicker_share(float exposure_us)
{
	const float turns = (float)M_PI * MAINS_HZ * 1e-6F * exposure_us;

	return turns > 1.0F ? 1.0F / turns : 1.0F; /* also of an unknown one */
}

struct lp_residual lp_imager_residual(const struct lp_imager *imager)
{
	const struct lp_eye *eye = imager->eye;
	const bool turned = !lp_rotation_is_identity(&imager->turn.motion.rotation);

	return (struct lp_residual){
		.map = imager->map,
		.lookup = turned ? imager->lookup : NULL,
		.seen = lp_eye_observation(eye, imager->flicker *
							flicker_share(eye->incoming.exposure_us)),
	};
}

int lp_residual_seen(const struct lp_residual *residual, int cell)
{
	const struct lp_lookup *l = residual->lookup;

	if (!l)
		return cell;
	return (l->across[cell] < 0.5F ? l->left[cell] : l->right[cell]) +
	       (l->down[cell] < 0.5F ? 0 : l->grid->width);
}

struct lp_log_light lp_log_light(const struct lp_observation *seen, int cell, int channel)
{
	const float light = seen->radiance[cell][channel], linear = light / seen->scale;

	if (seen->flags[cell] || !(linear > 0.0F) || linear > BRIGHTEST)
		return (struct lp_log_light){.log = NAN};
	const float noise2 = seen->code_variance / lp_response_weight(seen->response, linear) /
			     (linear * linear);

	if (noise2 > MOST_NOISE * MOST_NOISE)
		return (struct lp_log_light){.log = NAN};
	return (struct lp_log_light){.log = logf(light),
				     .variance = noise2 + LP_CELL_SIGMA * LP_CELL_SIGMA};
}
