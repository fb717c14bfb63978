/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What cameras do to their pictures, beside exposing them, that changes the light in them. The one
 * list of it: sources switch it off, Hello and camera files name it (docs/users/cameras.md).
 */
#ifndef LP_PROCESSING_H
#define LP_PROCESSING_H

#include <stdint.h>

enum lp_processing {
	LP_PROCESSING_SHARPNESS,       /* light and dark rims along edges; lamps grow brighter */
	LP_PROCESSING_NOISE_REDUCTION, /* in space or time */
	LP_PROCESSING_DYNAMIC_RANGE,   /* HDR, tone mapping: codes depend on the surroundings */
	LP_PROCESSING_BACKLIGHT,       /* its compensation */
	LP_PROCESSING_GAMMA, /* another curve than the camera's usual one; so the next two */
	LP_PROCESSING_BRIGHTNESS,
	LP_PROCESSING_CONTRAST,
	LP_PROCESSING_SATURATION, /* of colours; so the next two */
	LP_PROCESSING_HUE,
	LP_PROCESSING_EFFECT,
	LP_PROCESSING_WHITE_BALANCE, /* that adapts */
	LP_PROCESSING_STABILIZATION, /* pixels look elsewhere than the lens says */
	LP_PROCESSING_SCENE,	     /* a mode that chooses several of these */
	LP_PROCESSING_KINDS
};

/* One of them in a set. */
#define LP_PROCESSING_BIT(kind) (UINT32_C(1) << (kind))

/* Its name, on the wire and in camera files. NULL from LP_PROCESSING_KINDS on. */
static inline const char *lp_processing_name(int kind)
{
	static const char *const names[LP_PROCESSING_KINDS] = {
		"sharpness",	 "noise-reduction", "dynamic-range", "backlight", "gamma",
		"brightness",	 "contrast",	    "saturation",    "hue",	  "effect",
		"white-balance", "stabilization",   "scene"}; /* in their order above */

	return kind >= 0 && kind < LP_PROCESSING_KINDS ? names[kind] : (const char *)0;
}

#endif
