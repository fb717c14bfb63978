/* SPDX-License-Identifier: Apache-2.0 */
/* The newest readings of the ring, to find the one that belongs to a frame. Plain data; zeroed is
 * empty. */
#ifndef LP_LIGHT_RING_RING_HISTORY_H
#define LP_LIGHT_RING_RING_HISTORY_H

#include <stdbool.h>
#include <stdint.h>

#include "include/ring_sample.h"

#define LP_RING_HISTORY 64 /* more than half a second of most rings */

struct lp_ring_history {
	int count, newest;
	struct lp_ring_sample list[LP_RING_HISTORY];
};

/* Readings come in the order of their times. */
void lp_ring_history_add(struct lp_ring_history *history, const struct lp_ring_sample *sample);

/* False: there is none. */
bool lp_ring_history_newest(const struct lp_ring_history *history, struct lp_ring_sample *sample);

/*
 * What the ring read of the light at t_ns: the reading nearest to it. False: none lies within
 * most_ns of that. A reading without a time (t_ns 0) belongs to any.
 */
bool lp_ring_history_at(const struct lp_ring_history *history, int64_t t_ns, int64_t most_ns,
			struct lp_ring_sample *sample);

#endif
