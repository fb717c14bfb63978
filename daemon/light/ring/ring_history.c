/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_history.h"

void lp_ring_history_add(struct lp_ring_history *history, const struct lp_ring_sample *sample)
{
	history->newest = (history->newest + 1) % LP_RING_HISTORY;
	history->list[history->newest] = *sample;
	history->count += history->count < LP_RING_HISTORY;
}

bool lp_ring_history_newest(const struct lp_ring_history *history, struct lp_ring_sample *sample)
{
	if (history->count > 0)
		*sample = history->list[history->newest];
	return history->count > 0;
}

static int64_t distance_ns(const struct lp_ring_sample *sample, int64_t t_ns)
{
	const int64_t apart = sample->t_ns - t_ns;

	if (sample->t_ns == 0)
		return 0;
	return apart < 0 ? -apart : apart;
}

bool lp_ring_history_at(const struct lp_ring_history *history, int64_t t_ns, int64_t most_ns,
			struct lp_ring_sample *sample)
{
	int64_t least_ns = most_ns;
	bool found = false;

	for (int i = 0; i < history->count; i++) {
		const int at = (history->newest - i + LP_RING_HISTORY) % LP_RING_HISTORY;
		const int64_t apart_ns = distance_ns(&history->list[at], t_ns);

		if (apart_ns > least_ns || (found && apart_ns == least_ns))
			continue;
		least_ns = apart_ns;
		*sample = history->list[at];
		found = true;
	}
	return found;
}
