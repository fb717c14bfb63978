/* SPDX-License-Identifier: Apache-2.0 */
/* Whether an exposure shows other light than what was known before. */
#include "vision/change.h"

#include <cmath>
#include <cstring>

#include "vision/cells.h"
#include "vision/simd.hpp"

using cv::v_float32x4;

namespace
{

/* Differences up to so many codes are a camera's noise, and what is left of a JPEG's rounding in
 * the mean of a block. Chosen by hand. */
constexpr float kNoiseCodes = 3.0F;
/* Slope of sRGB at 0, linear light per code: darker than that nothing is resolved. */
constexpr float kLeastStep = 1.0F / (12.92F * 255.0F);

v_float32x4 luminance_at(const struct lp_cells *cells, size_t i)
{
	v_float32x4 r, g, b, luminance;

	cv::v_load_deinterleave(cells->radiance[i], r, g, b, luminance);
	return luminance;
}

bool any_clipped(const struct lp_cells *cells, size_t i)
{
	uint32_t four;

	std::memcpy(&four, cells->clipped + i, sizeof(four));
	return four != 0;
}

/* A clipped cell is a lower bound: only what exceeds it is a difference. */
v_float32x4 without_bounds(const v_float32x4 &more, const struct lp_cells *now,
			   const struct lp_cells *then, size_t i)
{
	float difference[4];

	cv::v_store(difference, more);
	for (size_t k = 0; k < 4; k++) {
		const bool low = then->clipped[i + k] && difference[k] > 0.0F;
		const bool high = now->clipped[i + k] && difference[k] < 0.0F;

		if (low || high)
			difference[k] = 0.0F;
	}
	return cv::v_load(difference);
}

} /* namespace */

extern "C" float lp_cells_change(const struct lp_cells *now, const struct lp_cells *then,
				 const struct lp_cells *known, const float *row_weight)
{
	const v_float32x4 zero = cv::v_setzero_f32();
	/* of a square-root response, per code: 2 sqrt(linear) / 255 */
	const v_float32x4 slope =
		cv::v_setall_f32(kNoiseCodes * 2.0F / 255.0F * std::sqrt(now->scale));
	const v_float32x4 least = cv::v_setall_f32(kNoiseCodes * kLeastStep * now->scale);
	v_float32x4 changed = zero, all = zero;

	if (std::isnan(now->mean_code) || std::isnan(then->mean_code))
		return 0.0F;
	for (int row = 0; row < now->height; row++) {
		const v_float32x4 weight =
			cv::v_setall_f32(row_weight[row * now->cell_px + now->cell_px / 2]);
		const size_t first = static_cast<size_t>(row) * now->width;
		v_float32x4 row_changed = zero, row_all = zero;

		/* whole fours: what is left of a row is too little to matter */
		for (size_t i = first; i + 4 <= first + now->width; i += 4) {
			const v_float32x4 a = luminance_at(now, i), b = luminance_at(then, i);
			const v_float32x4 most = cv::v_max(cv::v_max(a, b), zero);
			const v_float32x4 noise = cv::v_max(cv::v_sqrt(most) * slope, least);
			v_float32x4 more = a - b;

			if (any_clipped(now, i) || any_clipped(then, i))
				more = without_bounds(more, now, then, i);
			row_changed = row_changed + cv::v_max(cv::v_abs(more) - noise, zero);
			row_all = row_all + luminance_at(known, i);
		}
		changed = cv::v_fma(weight, row_changed, changed);
		all = cv::v_fma(weight, row_all, all);
	}
	const float total = cv::v_reduce_sum(all);

	return total > 0.0F ? cv::v_reduce_sum(changed) / total : 0.0F;
}
