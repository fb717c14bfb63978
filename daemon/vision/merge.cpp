/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/merge.h"

#include <cmath>

#include "vision/cells.h"
#include "vision/response.h"
#include "vision/simd.hpp"

using cv::v_float32x4;

namespace
{

/* Weights of four cells of one exposure: see lp_response_weight(); 0 where it is saturated. */
class weigher
{
	const struct lp_cells *cells;
	const float *table;
	bool coded; /* float frames have no codes: one exposure is as good as another */
	v_float32x4 full, share;

      public:
	void init(const struct lp_cells *its_cells, const struct lp_response *response)
	{
		cells = its_cells;
		table = response->weight;
		coded = !std::isnan(cells->mean_code);
		full = cv::v_setall_f32(1.0F / cells->scale);
		share = cv::v_setall_f32(1.0F / (cells->scale * cells->scale));
	}

	v_float32x4 at(size_t i, const v_float32x4 &luminance) const
	{
		const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
		const v_float32x4 clipped = cv::v_cvt_f32(
			cv::v_reinterpret_as_s32(cv::v_load_expand_q(cells->clipped + i)));
		v_float32x4 weight = one;

		if (coded) {
			const v_float32x4 linear =
				cv::v_min(cv::v_max(luminance * full, zero), one);

			weight = cv::v_lut(table, cv::v_trunc(cv::v_sqrt(linear) *
							      cv::v_setall_f32(255.0F))) *
				 share;
		}
		return cv::v_select(clipped == zero, weight, zero);
	}
};

/* Four cells, a vector per channel: R, G, B, luminance. */
struct four_cells {
	v_float32x4 channel[4];

	void load(const float (*radiance)[4])
	{
		cv::v_load_deinterleave(radiance[0], channel[0], channel[1], channel[2],
					channel[3]);
	}
};

} /* namespace */

extern "C" int lp_merge(const struct lp_cells *const *exposures, int count,
			const struct lp_response *response, struct lp_cells *merged)
{
	const struct lp_cells *first = exposures[0];
	const size_t cells = static_cast<size_t>(first->width) * first->height;
	const int ret = lp_cells_reserve(merged, first->width, first->height, first->cell_px);
	const v_float32x4 zero = cv::v_setzero_f32();
	weigher weights[LP_MERGE_MAX];

	if (ret < 0)
		return ret;
	for (int k = 0; k < count; k++)
		weights[k].init(exposures[k], response);
	for (size_t i = 0; i < cells; i += 4) { /* there is room beyond the last cell */
		four_cells sum = {{zero, zero, zero, zero}}, brightest, cell;
		v_float32x4 total = zero;

		for (int k = 0; k < count; k++) {
			cell.load(exposures[k]->radiance + i);
			const v_float32x4 weight = weights[k].at(i, cell.channel[3]);
			const v_float32x4 higher =
				k ? cell.channel[3] > brightest.channel[3] : zero == zero;

			for (int c = 3; c >= 0; c--) {
				sum.channel[c] = cv::v_fma(cell.channel[c], weight, sum.channel[c]);
				brightest.channel[c] = k ? cv::v_select(higher, cell.channel[c],
									brightest.channel[c])
							 : cell.channel[c];
			}
			total = total + weight;
		}
		const v_float32x4 known = total > zero;
		const int inside = cells - i < 4 ? (1 << (cells - i)) - 1 : 15;
		const int unknown = ~cv::v_signmask(known) & inside;

		for (auto &channel : sum.channel)
			channel = channel / total;
		for (int c = 0; c < 4; c++)
			sum.channel[c] = cv::v_select(known, sum.channel[c], brightest.channel[c]);
		cv::v_store_interleave(merged->radiance[i], sum.channel[0], sum.channel[1],
				       sum.channel[2], sum.channel[3]);
		for (int k = 0; k < 4; k++)
			merged->clipped[i + k] = unknown >> k & 1;
		merged->clipped_count += __builtin_popcount(unknown);
	}
	for (int k = 0; k < count; k++)
		merged->invalid_count += exposures[k]->invalid_count;
	return 0;
}
