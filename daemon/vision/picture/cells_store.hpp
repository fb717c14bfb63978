/* SPDX-License-Identifier: Apache-2.0 */
/* How a cell's linear light becomes radiance and clipping mark: the same for every frame
 * kind. */
#ifndef LP_VISION_PICTURE_CELLS_STORE_HPP
#define LP_VISION_PICTURE_CELLS_STORE_HPP

#include "include/luminance.h"
#include "vision/picture/cells.h"
#include "vision/picture/simd.hpp"

namespace lp
{

constexpr int kTopCode = LP_TOP_CODE;

inline cv::v_float32x4 luminance(const cv::v_float32x4 &r, const cv::v_float32x4 &g,
				 const cv::v_float32x4 &b)
{
	return cv::v_fma(r, cv::v_setall_f32(LP_LUMINANCE_R),
			 cv::v_fma(g, cv::v_setall_f32(LP_LUMINANCE_G),
				   b * cv::v_setall_f32(LP_LUMINANCE_B)));
}

/* linear: mean of R, G, B, 1 = full scale. */
inline void store_cell(struct lp_cells *cells, size_t index, const float linear[3], bool clipped)
{
	float *out = cells->radiance[index];

	for (int c = 0; c < 3; c++)
		out[c] = linear[c] * cells->scale;
	out[3] = lp_luminance(out);
	cells->clipped[index] = clipped;
	cells->clipped_count += clipped;
}

} /* namespace lp */

#endif
