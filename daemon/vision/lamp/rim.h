/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The colour of a lamp that clips, by its rim: pixels beside the clipped ones are bright, too, and
 * do not clip. And which of its channels clip at all. Pure sums over pixels.
 */
#ifndef LP_VISION_LAMP_RIM_H
#define LP_VISION_LAMP_RIM_H

#include "light/find/lamp_rim.h"

/* Zeroed: no pixel yet. */
struct lp_rim_sums {
	double light[3];    /* of the rim, above the background */
	float brightest[3]; /* share of full scale, of all pixels */
	int count;	    /* pixels of the rim */
};

/* rgb, background, full: radiance; full scale of each channel. */
void lp_rim_add(struct lp_rim_sums *sums, const float (*rgb)[3], int count,
		const float background[3], const float full[3]);

struct lp_lamp_rim lp_rim_of(const struct lp_rim_sums *sums);

#endif
