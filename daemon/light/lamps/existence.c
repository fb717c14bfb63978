/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/existence.h"

#include <math.h>

/* Log odds of what is beyond doubt, either way. */
#define CERTAIN 7.0F
/* A lamp that is there, but was not told apart before (a door opens, dusk falls), appears so often.
 */
#define LAMPS_PER_S 0.01F
/* So long it takes until the lamps of a scene are found that is seen for the first time. */
#define FIRST_S 1.0F
/* Log odds that each second takes from what is missed: a lamp is seldom missed for long. */
#define MISSED_PER_S 3.0F
/* Clutter of a scene that is not known yet: so many come and go in a second and stay for so long;
 * this counts as PRIOR_S of watching. Chosen by hand. */
#define PRIOR_PER_S 0.1F
#define PRIOR_STAY_S 1.0F
#define PRIOR_S 10.0F
/* Clutter changes with the light: it is forgotten with this time constant. */
#define CLUTTER_S 30.0F

void lp_clutter_age(struct lp_clutter *clutter, float elapsed_s)
{
	const float keep = expf(-elapsed_s / CLUTTER_S);

	clutter->age_s += elapsed_s;
	clutter->watched_s = keep * (clutter->watched_s + elapsed_s);
	clutter->lost *= keep;
	clutter->doubted_s *= keep;
}

struct lp_existence lp_existence_found(const struct lp_clutter *clutter)
{
	const float clutter_per_s =
		(PRIOR_PER_S * PRIOR_S + clutter->lost) / (PRIOR_S + clutter->watched_s);
	const float lamps_per_s = LAMPS_PER_S + expf(-clutter->age_s / FIRST_S) / FIRST_S;

	return (struct lp_existence){.log_odds = logf(lamps_per_s / clutter_per_s)};
}

void lp_existence_prove(struct lp_existence *existence)
{
	*existence = (struct lp_existence){.log_odds = CERTAIN, .was_certain = true};
}

/* Clutter goes at a rate, lamps hardly do: the odds of what stays grow with that rate. */
static float log_odds_per_s(const struct lp_clutter *clutter)
{
	const float prior = PRIOR_PER_S * PRIOR_S;

	return (prior + clutter->lost) / (prior * PRIOR_STAY_S + clutter->doubted_s);
}

void lp_existence_update(struct lp_existence *existence, struct lp_clutter *clutter, bool is_seen,
			 float elapsed_s)
{
	if (!is_seen) {
		existence->log_odds -= MISSED_PER_S * elapsed_s;
		return;
	}
	clutter->doubted_s += elapsed_s / (1.0F + expf(existence->log_odds));
	existence->log_odds += log_odds_per_s(clutter) * elapsed_s;
	if (existence->log_odds >= CERTAIN)
		lp_existence_prove(existence);
}

bool lp_exists(const struct lp_existence *existence)
{
	return existence->log_odds > 0.0F;
}

float lp_existence_missed_s(void)
{
	return CERTAIN / MISSED_PER_S;
}

bool lp_existence_is_over(const struct lp_existence *existence)
{
	return existence->log_odds < -CERTAIN;
}

void lp_existence_end(const struct lp_existence *existence, struct lp_clutter *clutter)
{
	clutter->lost += existence->was_certain ? 0.0F : 1.0F;
}
