/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Does a lamp flicker, and what is its mean? By what was measured of its strength lately, in one
 * exposure setting: a lamp on the mains is brighter and darker than its mean by turns, frame after
 * frame; a lamp that is switched or dimmed is not. Plain data, zeroed is a new one; one thread.
 */
#ifndef LP_LIGHT_LAMPS_FLICKER_H
#define LP_LIGHT_LAMPS_FLICKER_H

#include <stdbool.h>

#define LP_FLICKER_HISTORY 48

/* One measurement. */
struct lp_lamp_strength {
	float strength; /* above 0 */
	float noise;	/* 1 sigma, relative */
	float scale;	/* full scale to radiance: of the exposure */
	bool is_bound;	/* it clipped: the lamp is at least so strong */
};

struct lp_flicker {
	bool flickers;
	float mean;  /* of the strengths since the last change */
	float sigma; /* 1 sigma of the mean, relative */
	float depth; /* root mean square of the strengths' distance from their mean, relative */

	float scale; /* of the exposures that count: the shortest that show the lamp well */
	int count;
	int since_bound, since_counted;	    /* measurements */
	float strength[LP_FLICKER_HISTORY]; /* newest first */
};

void lp_flicker_add(struct lp_flicker *flicker, const struct lp_lamp_strength *measured);

/* The lamp clips in some of its phases: the mean is a lower bound. */
bool lp_flicker_clips(const struct lp_flicker *flicker);

#endif
