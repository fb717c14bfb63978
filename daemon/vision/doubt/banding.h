/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bands: a rolling shutter exposes each row later than the row above, so that lamps on the mains
 * draw bright and dark bands across a short exposure. They show flicker that lamps themselves do
 * not: at 30 frames a second 120 Hz has the same phase in each frame. Bands are found where a short
 * exposure is compared with what longer ones, over which flicker averages out, know of the same
 * cells. Pure computation; one thread; plain data, zeroed has seen none.
 */
#ifndef LP_VISION_DOUBT_BANDING_H
#define LP_VISION_DOUBT_BANDING_H

#include <stdbool.h>

#define LP_BANDING_SAMPLES 4096
/* Longer exposures, in microseconds, average over too much of a period. */
#define LP_BANDING_MOST_US 5000.0F

/* Cells of a frame that are known. */
struct lp_banding_samples {
	int count;
	float t_s[LP_BANDING_SAMPLES];	     /* when their row was exposed, from any start */
	float log_ratio[LP_BANDING_SAMPLES]; /* of the frame over what is known */
	float weight[LP_BANDING_SAMPLES];    /* 1 / variance */
};

struct lp_banding {
	bool found;
	float amplitude; /* of the bands, relative */
	float evidence;	 /* share of the last frames that show them */
};

void lp_banding_look(struct lp_banding *banding, const struct lp_banding_samples *samples);

#endif
