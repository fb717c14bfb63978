/* SPDX-License-Identifier: Apache-2.0 */
/* How a cell's linear light becomes radiance and clipping mark: the same for every frame
 * kind. */
#ifndef LP_VISION_CELLS_STORE_HPP
#define LP_VISION_CELLS_STORE_HPP

#include "vision/cells.h"
#include "vision/simd.hpp"

namespace lp
{

/* Codes from here on count as saturated: the last few are bent by many cameras' highlight knee. */
constexpr int kTopCode = 250;

/* Rec. 709 luminance (docs/conventions.md). */
inline float luminance(const float rgb[3])
{
	return 0.2126F * rgb[0] + 0.7152F * rgb[1] + 0.0722F * rgb[2];
}

inline cv::v_float32x4 luminance(const cv::v_float32x4 &r, const cv::v_float32x4 &g,
				 const cv::v_float32x4 &b)
{
	return cv::v_fma(r, cv::v_setall_f32(0.2126F),
			 cv::v_fma(g, cv::v_setall_f32(0.7152F), b * cv::v_setall_f32(0.0722F)));
}

/* linear: mean of R, G, B, 1 = full scale. */
inline void store_cell(struct lp_cells *cells, size_t index, const float linear[3], bool clipped)
{
	float *out = cells->radiance[index];

	for (int c = 0; c < 3; c++)
		out[c] = linear[c] * cells->scale;
	out[3] = luminance(out);
	cells->clipped[index] = clipped;
	cells->clipped_count += clipped;
}

} /* namespace lp */

#endif
