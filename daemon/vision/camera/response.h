/* SPDX-License-Identifier: Apache-2.0 */
/* From a camera's 8-bit codes to linear light, for single pixels and for means of blocks. */
#ifndef LP_VISION_CAMERA_RESPONSE_H
#define LP_VISION_CAMERA_RESPONSE_H

#include <math.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_camera;

#define LP_CODE_STEPS 8 /* steps of a block's mean per code */
#define LP_CODE_INDEX_MAX (255 * LP_CODE_STEPS)

/*
 * The mean of a curve is not the curve of the mean: for a block of codes with mean m and variance
 * v, mean linear light = linear(m) + linear''(m) / 2 * v, to second order.
 */
struct lp_block_response {
	float linear;	      /* of the mean */
	float half_curvature; /* linear'' / 2, per squared code */
};

/* Linear value 0..1, 1 = full scale. Immutable: any thread. */
struct lp_response {
	float pixel[3][256];
	struct lp_block_response block[3][LP_CODE_INDEX_MAX + 1]; /* index = mean * LP_CODE_STEPS */
	float weight[256]; /* lp_response_weight(), by the root of the linear value */
};

/*
 * Inverse variance of a linear value, up to a common factor: noise of about one code everywhere, so
 * 1 / slope^2; fading out over the last codes before saturation, where single pixels may be clipped
 * unseen.
 */
static inline float lp_response_weight(const struct lp_response *response, float linear)
{
	const float root = sqrtf(linear < 0.0F ? 0.0F : linear > 1.0F ? 1.0F : linear);

	return response->weight[(int)(root * 255.0F)];
}

/* Multiply all light of R, G and B by a factor each. */
void lp_response_scale(struct lp_response *response, const float factor[3]);

/* Raise all light to a power, as a fraction of full scale. 1: nothing happens. */
void lp_response_bend(struct lp_response *response, float power);

/* The camera's table, or sRGB (IEC 61966-2-1) when it has none. */
void lp_response_init(struct lp_response *response, const struct lp_camera *camera);

#ifdef __cplusplus
}
#endif

#endif
