/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lights over time: stable ids, and a smoothed estimate. Smoothing is one linear low-pass of
 * declared time constant for every irradiance and coefficient, so lights and SH stay consistent
 * while they settle: a lamp that appears rises from nothing, one that vanishes fades, and AMBIENT +
 * lights = TOTAL throughout.
 */
#ifndef LP_LIGHT_TRACKER_H
#define LP_LIGHT_TRACKER_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"

#define LP_MAX_TRACKS (2 * LP_MAX_LIGHTS)

struct lp_track {
	struct lp_light light; /* smoothed; id 0: free */
	float full;	       /* luminance of its irradiance when last seen */
	int64_t t_seen_ns;
	bool seen; /* in the newest estimate */
};

/* Plain data, no storage behind it; zeroed is a new one. One thread. */
struct lp_tracker {
	float time_constant_ms; /* 0: smoothed = raw */
	uint32_t last_id;
	bool started;
	int64_t t_last_ns;
	float sh_total[LP_MAX_SH_COUNT][3];
	struct lp_track track[LP_MAX_TRACKS];
};

/* Give the raw estimate's lights their ids and follow it with `smoothed`. A capture time before the
 * last one counts as no time passed. */
void lp_tracker_update(struct lp_tracker *tracker, struct lp_light_estimate *raw,
		       struct lp_light_estimate *smoothed);

#endif
