/* SPDX-License-Identifier: Apache-2.0 */
/* How much of each colour the eye counts as brightness: ITU-R BT.709, linear light
 * (docs/users/conventions.md). */
#ifndef LP_LUMINANCE_H
#define LP_LUMINANCE_H

/* Fourth channel, after R, G and B, of a panorama cell, a lamp's irradiance and the like. */
#define LP_LUMINANCE 3

#define LP_LUMINANCE_R 0.2126
#define LP_LUMINANCE_G 0.7152
#define LP_LUMINANCE_B 0.0722

static inline float lp_luminance(const float rgb[3])
{
	return (float)LP_LUMINANCE_R * rgb[0] + (float)LP_LUMINANCE_G * rgb[1] +
	       (float)LP_LUMINANCE_B * rgb[2];
}

#endif
