/* SPDX-License-Identifier: Apache-2.0 */
#include "app/options/fixed_exposure.h"

#include <math.h>

#include "base/log.h"
#include "include/source.h"

/* Controls are whole numbers, and their limits converted ones. */
#define TOLERANCE 0.001F

/* Limits that are not known do not exclude anything. */
static bool is_within(float value, float least, float most)
{
	return !(value < least * (1 - TOLERANCE)) && !(value > most * (1 + TOLERANCE));
}

bool lp_gain_is_offered(const struct lp_source_caps *caps, float gain, const char *object)
{
	if (gain <= 0 || is_within(gain, caps->gain_min, caps->gain_max))
		return true;
	if (caps->gain_min == caps->gain_max)
		lp_error(object, "gain",
			 "%g: this camera's gain is not set — leave --gain out; of v4l2: with "
			 "gain_unity (docs/users/cameras.md) it can be",
			 (double)gain);
	else
		lp_error(object, "gain", "%g is not offered — --gain is within %g..%g",
			 (double)gain, (double)caps->gain_min, (double)caps->gain_max);
	return false;
}

void lp_fixed_exposure_command(struct lp_source *source, const struct lp_source_caps *caps,
			       float exposure_us, float gain, const char *object)
{
	if (!source->ops->set_exposure || !caps->exposure_settable) {
		lp_warning(object, "exposure",
			   "this source's exposure cannot be set: --exposure-us has no effect");
		return;
	}
	if (!is_within(exposure_us, caps->exposure_min_us, caps->exposure_max_us))
		lp_warning(object, "exposure",
			   "%g us is not offered: the nearest is taken — --exposure-us is within "
			   "%g..%g",
			   (double)exposure_us, (double)caps->exposure_min_us,
			   (double)caps->exposure_max_us);
	if (!lp_gain_is_offered(caps, gain, object))
		gain = caps->gain_min == caps->gain_max ? 1 : gain;
	(void)source->ops->set_exposure(source, exposure_us, gain > 0 ? gain : 1);
}
