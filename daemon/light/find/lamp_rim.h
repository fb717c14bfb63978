/* SPDX-License-Identifier: Apache-2.0 */
/* The colour of what a clipped lamp hides, by what its pixels tell (vision/lamp/rim.h). Pure. */
#ifndef LP_LIGHT_FIND_LAMP_RIM_H
#define LP_LIGHT_FIND_LAMP_RIM_H

/* Zeroed: nothing is known. */
struct lp_lamp_rim {
	float tint[3];	/* R, G, B of its rim above the background, for luminance 1 */
	float trust;	/* 0..1 */
	float clips[3]; /* 0..1: whether the channel clips; one that does not hides nothing */
};

/* `tint`, R, G, B for luminance 1, is what was seen of what clips; it becomes that of what is
 * hidden: between it and the rim's, in logarithms, without the channels that do not clip. */
void lp_lamp_rim_apply(const struct lp_lamp_rim *rim, float tint[3]);

#endif
