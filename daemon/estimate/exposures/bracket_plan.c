/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/exposures/bracket_plan.h"

#include <math.h>
#include <string.h>

#include "include/source.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* The longest exposure puts the median here, of full scale, as in the brackets of
 * docs/users/accuracy.md; the shortest the brightest cell's mean between these (pixels within it
 * are brighter). */
#define MEDIAN_AT 0.25F
#define PEAK_HIGH 0.25F
/* Range in stops that one exposure holds, and that lies between neighbours of a bracket, at most:
 * the brackets that docs/users/accuracy.md measures are four stops apart. */
#define STOPS_ALONE 4.0F
#define STOPS_APART 5.0F
/* Of a camera that does not say: up to what keeps 30 frames a second. */
#define LEAST_US 1.0F
#define MOST_US 33000.0F

static float or_else(float value, float otherwise)
{
	return isnan(value) ? otherwise : value;
}

struct lp_bracket_limits lp_bracket_limits_of(const struct lp_source_caps *caps)
{
	struct lp_bracket_limits limits = {.min_us = or_else(caps->exposure_min_us, LEAST_US),
					   .max_us = or_else(caps->exposure_max_us, MOST_US),
					   .step_us = or_else(caps->exposure_step_us, 0.0F),
					   .exposure_count = caps->exposure_count,
					   .delay_frames = caps->exposure_delay_frames,
					   .in_force_us = caps->in_force_us};

	memcpy(limits.exposures_us, caps->exposures_us, sizeof(limits.exposures_us));
	return limits;
}

static float nearest_of(const struct lp_bracket_limits *limits, float exposure_us)
{
	float nearest_us = limits->exposures_us[0];

	for (int k = 1; k < limits->exposure_count; k++) {
		if (lp_stops(limits->exposures_us[k], exposure_us) <
		    lp_stops(nearest_us, exposure_us))
			nearest_us = limits->exposures_us[k];
	}
	return nearest_us;
}

float lp_bracket_allowed(const struct lp_bracket_limits *limits, float exposure_us)
{
	const float step_us = limits->step_us;

	if (limits->exposure_count > 0)
		return nearest_of(limits, exposure_us);
	if (step_us > 0.0F)
		exposure_us = fmaxf(roundf(exposure_us / step_us), 1.0F) * step_us;
	return fminf(fmaxf(exposure_us, limits->min_us), limits->max_us);
}

/* The shortest exposure follows the peak. A lamp smaller than a cell clips while the cell's mean is
 * still low: what clipped is not tried again as long as the peak is what it was then. */
static void adapt_shortest(struct lp_bracket *b, const struct lp_bracket_scene *scene)
{
	if (scene->clipped) {
		b->plan.clips_us = b->plan.shortest_us;
		b->plan.clips_peak = 0.0F;
		b->plan.shortest_us /= 4.0F;
		return;
	}
	b->plan.clips_peak = fmaxf(b->plan.clips_peak, scene->peak);
	if (scene->peak < 0.5F * b->plan.clips_peak)
		b->plan.clips_us = b->plan.clips_peak = 0.0F;
	if (scene->peak > 0.0F && scene->peak * b->plan.shortest_us * 1e-6F < LP_BRACKET_PEAK_LOW) {
		const float longer_us =
			fminf(b->plan.shortest_us * 2.0F, PEAK_HIGH * 1e6F / scene->peak);

		if (b->plan.clips_us <= 0.0F || longer_us < 0.99F * b->plan.clips_us)
			b->plan.shortest_us = longer_us;
	}
}

int lp_bracket_plan(struct lp_bracket *b, const struct lp_bracket_scene *scene,
		    float plan_us[LP_MAX_PLANNED])
{
	const float longest =
		lp_bracket_allowed(&b->limits, scene->median > 0.0F
						       ? MEDIAN_AT * 1e6F / scene->median
						       : b->limits.max_us);
	int count;

	adapt_shortest(b, scene);
	if (scene->looks_around) /* what comes into view may be a lamp, and gone again before it
				  * has told how short an exposure it needs */
		b->plan.shortest_us = fminf(b->plan.shortest_us,
					    longest * exp2f(-STOPS_APART * (float)(b->most - 1)));
	b->plan.shortest_us = fminf(lp_bracket_allowed(&b->limits, b->plan.shortest_us), longest);

	const float range = log2f(longest / b->plan.shortest_us);

	count = range <= STOPS_ALONE ? 1 : 1 + (int)ceilf(range / STOPS_APART - 0.25F);
	count = count < 1 ? 1 : count > b->most ? b->most : count;
	if (count == 1) {
		plan_us[0] = b->plan.shortest_us;
		return 1;
	}
	for (int k = 0; k < count; k++)
		plan_us[k] = lp_bracket_allowed(&b->limits, longest * exp2f(-range * (float)k /
									    (float)(count - 1)));
	return count;
}
