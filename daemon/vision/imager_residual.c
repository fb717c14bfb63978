/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "light/math/rotation.h"
#include "vision/imager_internal.h"
#include "vision/map/residual.h"

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
