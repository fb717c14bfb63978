/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/drawn/pace.h"

#include <math.h>

#include "base/clock.h"
#include "include/luminance.h"

#define LONGEST_NS LP_NS_PER_S

bool lp_drawn_pace_is_due(const struct lp_drawn_pace *pace,
			  const struct lp_light_estimate *estimate,
			  const struct lp_drawn *tolerance, int64_t now_ns)
{
	float sum = 0.0F, least = 1.0F;

	if (!pace->t_ns || now_ns - pace->t_ns >= LONGEST_NS)
		return true;
	for (int t = LP_DRAWN_GLOSSY; t <= LP_DRAWN_MIRRORS; t++)
		if (tolerance->of[t] > 0.0F)
			least = fminf(least, tolerance->of[t]);
	/* radiance: root mean square over directions, relative to its mean */
	for (int i = 0; i < LP_MAX_SH_COUNT; i++) {
		const float off = lp_luminance(estimate->sh_total[i]) - pace->sh[i];

		sum += off * off;
	}
	return !(sqrtf(sum) <= least * pace->sh[0]);
}

void lp_drawn_pace_note(struct lp_drawn_pace *pace, const struct lp_light_estimate *estimate,
			int64_t now_ns)
{
	pace->t_ns = now_ns;
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		pace->sh[i] = lp_luminance(estimate->sh_total[i]);
}
