/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Does a camera's response hold? Two exposures record the same light with different codes. The
 * response must make the same light of them again:
 *
 *  - if all cells agree that it makes another one, by so much a stop, the response is another:
 *    light is to be raised to a power, which leaves full scale as it is. The power is a slow state
 *    of the camera (a Kalman filter; Kalman 1960);
 *  - if regions that the same two exposures show ask for different powers, no power explains them:
 *    the camera brightens or darkens parts of its picture by what is around them (local tone
 *    mapping), or its response is of quite another form. How much regions differ, beyond what cells
 *    within each differ, is told by an analysis of variance (Fisher 1925).
 *
 * Light that changes contradicts, too, but as often one way as the other.
 * Pure computation; one thread; no allocation.
 */
#ifndef LP_VISION_RESPONSE_LINEARITY_H
#define LP_VISION_RESPONSE_LINEARITY_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LP_LINEARITY_CELLS 1024
#define LP_LINEARITY_REGIONS 64

/* A cell in a frame. */
struct lp_linearity_look {
	int region; /* that it lies in, always the same one: below LP_LINEARITY_REGIONS */
	/* logarithms of its radiance (NAN: the frame does not tell), and of the same of full scale
	 * (below 0); variance of either, and what of it cells alike have in common (rounding) */
	float log_light, log_linear, variance, rounding;
};

/* A cell that is watched. */
struct lp_linearity_cell {
	struct lp_linearity_look last; /* of the last frame that has shown it */
	uint64_t serial;	       /* of that frame; 0: none has */
	/* by which power more than its fellows the pairs of exposures ask its light to be raised:
	 * mean of so many; the information that a pair has, and its variance from rounding */
	float power, weight, rounding;
	int count;
	uint64_t told; /* frame of the newest pair */
};

/* By which power more than all a region asks its light to be raised: mean and mean square of so
 * many frames. */
struct lp_linearity_region {
	float power, square;
	int count;
};

/* Plain data; lp_linearity_init() starts it. */
struct lp_linearity {
	float log_power;    /* logarithm of the power by which light is to be raised */
	float variance;	    /* of it */
	float applied;	    /* what of log_power is in the response in use */
	float spread;	    /* 1 sigma of the powers that regions ask for, beyond noise */
	float rounding;	    /* the same of a cell's, by rounding */
	float log_exposure; /* of the newest frame; NAN: none */
	float log_range;    /* longest over shortest exposure lately */
	float depth;	    /* mean of -log_linear lately; 0: nothing has been seen */
	bool disagrees;	    /* no response explains what the exposures show */
	uint64_t serial;    /* of the newest frame */
	int count;	    /* of cells that are watched */
	struct lp_linearity_cell cells[LP_LINEARITY_CELLS];
	struct lp_linearity_region regions[LP_LINEARITY_REGIONS];
};

/* `sigma`: 1 sigma of the power beforehand. */
void lp_linearity_init(struct lp_linearity *linearity, float sigma);

/* Go on with what another one has learned, of the same camera with a response as in its file. */
void lp_linearity_inherit(struct lp_linearity *linearity, const struct lp_linearity *from);

/* Frames that follow cannot be compared with those before: what is before the lens has changed. */
void lp_linearity_forget_looks(struct lp_linearity *linearity);

/* The newest frame, elapsed_s after the one before: looks of at most LP_LINEARITY_CELLS cells,
 * always the same ones. log_exposure: logarithm of the exposure, in any unit. */
void lp_linearity_learn(struct lp_linearity *linearity, const struct lp_linearity_look *looks,
			int count, float log_exposure, float elapsed_s);

/* The power by which light of the response in use is to be raised now; the caller does it. 1: none
 * that would matter. */
float lp_linearity_apply(struct lp_linearity *linearity);

/* 1 sigma of light, relative, from the response; 0 until exposures have differed: nothing tells
 * then. */
float lp_linearity_sigma(const struct lp_linearity *linearity);

#ifdef __cplusplus
}
#endif

#endif
