/* SPDX-License-Identifier: Apache-2.0 */
/* Which exposures a scene needs, of those that a camera can do; part of
 * estimate/exposures/bracket.h. */
#ifndef LP_ESTIMATE_EXPOSURES_BRACKET_PLAN_H
#define LP_ESTIMATE_EXPOSURES_BRACKET_PLAN_H

#include <math.h>

#include "estimate/exposures/bracket.h"

/* The shortest exposure puts the brightest cell above this, of full scale: chosen by hand
 * (docs/maintainers/constants.md). */
#define LP_BRACKET_PEAK_LOW 0.06F

/* Distance of two exposures. */
static inline float lp_stops(float a, float b)
{
	return fabsf(log2f(a / b));
}

/* Exposures for the scene, longest first; their number. Adapts bracket->shortest_us. */
int lp_bracket_plan(struct lp_bracket *bracket, const struct lp_bracket_scene *scene,
		    float plan_us[LP_MAX_PLANNED]);

#endif
