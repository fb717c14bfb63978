/* SPDX-License-Identifier: Apache-2.0 */
/* What 8-bit codes and JPEG leave uncertain of the light that was there. */
#ifndef LP_VISION_CAMERA_CODE_NOISE_H
#define LP_VISION_CAMERA_CODE_NOISE_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_frame;
struct lp_response;

/* In codes, 1 sigma; all 0 for float frames. */
struct lp_code_noise {
	float common; /* the same for all pixels of one tone: rounding to whole codes, and in a JPEG
		       * the rounding of block means */
	float pixel;  /* every pixel its own: rounding of a JPEG's detail, where there is any */
	float even;   /* what a mean over many pixels of even light keeps: rounding of a JPEG's
		       * block means and of its decoded pixels; that by the camera itself goes, as
		       * noise spreads it */
};

/* `decoded`: a JPEG is read pixel by pixel. Rounding to steps of q errs by q / sqrt(12). Steps of a
 * JPEG are in its quantisation table 0, which is luma's; 64 coefficients of an orthonormal
 * transform spread their errors over 64 pixels.
 */
struct lp_code_noise lp_code_noise_of(const struct lp_frame *frame, bool decoded);

/* Change of light per code over the light, at `linear` (0..1 of full scale); by green, which stands
 * for luminance. */
float lp_relative_slope(const struct lp_response *response, float linear);

#ifdef __cplusplus
}
#endif

#endif
