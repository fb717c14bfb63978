/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lights over time: a smoothed estimate, in a frame that does not turn. Smoothing is one linear
 * low-pass of declared time constant for every irradiance and coefficient, so lights and SH stay
 * consistent while they settle: a lamp that appears rises from nothing, one that vanishes fades,
 * and AMBIENT + lights = TOTAL throughout.
 */
#ifndef LP_LIGHT_SEND_TRACKER_H
#define LP_LIGHT_SEND_TRACKER_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"

struct lp_rotation;

#define LP_MAX_TRACKS (2 * LP_MAX_LIGHTS)

struct lp_track {
	struct lp_light light; /* smoothed; id 0: free */
	float full;	       /* luminance of its irradiance when last seen */
	bool seen;	       /* in the newest estimate */
};

/* Plain data, no storage behind it; zeroed is a new one. One thread. */
struct lp_tracker {
	float time_constant_ms; /* 0: smoothed = raw */
	bool started;
	int64_t t_last_ns;
	float sh_total[LP_MAX_SH_COUNT][3];
	struct lp_track track[LP_MAX_TRACKS];
};

/* Follow the raw estimate, whose lights have their ids (light/lamps/lamp_memory.h), with
 * `smoothed`. A capture time before the last one counts as no time passed. */
void lp_tracker_update(struct lp_tracker *tracker, const struct lp_light_estimate *raw,
		       struct lp_light_estimate *smoothed);

/* The light has changed from `before` to `after` at once: the smoothed estimate changes by as much,
 * without delay. */
void lp_tracker_jump(struct lp_tracker *tracker, const struct lp_light_estimate *before,
		     const struct lp_light_estimate *after);

/* The probe has gone by so much, in the lights' frame: those whose distance is known are seen from
 * there, without delay, also in the SH. */
void lp_tracker_go(struct lp_tracker *tracker, const double way_m[3]);

/* The frame of reference has been turned. */
void lp_tracker_turn(struct lp_tracker *tracker, const struct lp_rotation *turn);

#endif
