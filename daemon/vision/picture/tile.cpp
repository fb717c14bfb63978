/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/picture/tile.hpp"

#include "vision/picture/simd.hpp"

using cv::v_float32x4;
using cv::v_int32x4;
using cv::v_uint8x16;

namespace
{

/* Squared codes: below this luma's variance among a tile's samples is noise and rounding. Chosen by
 * hand (docs/maintainers/constants.md). */
constexpr float kLeastVariance = 8.0F;

inline v_int32x4 codes(const v_float32x4 &value)
{
	return cv::v_trunc(value + cv::v_setall_f32(0.5F));
}

/* Sixteen samples to bytes, saturated. */
inline v_uint8x16 pack(const v_int32x4 c[4])
{
	return cv::v_pack(cv::v_pack_u(c[0], c[1]), cv::v_pack_u(c[2], c[3]));
}

/* Four chroma samples of the pixels from `x` on of a row; h luma samples share one. */
inline v_float32x4 chroma_at(const float *row, int x, int h)
{
	v_float32x4 low, high;

	if (h == 1)
		return cv::v_load(row + x);
	const v_float32x4 c = cv::v_load(row);

	cv::v_zip(c, c, low, high);
	return x ? high : low;
}

/* Mean luma behind the four chroma samples of a row. */
inline v_float32x4 mean_luma(const lp::tile &tile, int row)
{
	v_float32x4 even, odd, sum;

	cv::v_load_deinterleave(tile.luma + 8 * tile.v * row, even, odd);
	sum = even + odd;
	if (tile.v == 1)
		return sum * cv::v_setall_f32(0.5F);
	cv::v_load_deinterleave(tile.luma + 16 * row + 8, even, odd);
	return (sum + even + odd) * cv::v_setall_f32(0.25F);
}

} /* namespace */

void lp::follow_luma(tile &tile)
{
	const int rows = 8 / tile.v;
	const float share = 0.25F / static_cast<float>(rows);
	const v_float32x4 zero = cv::v_setzero_f32();
	v_float32x4 luma[8], y = zero, b = zero, r = zero, yy = zero, yb = zero, yr = zero;

	if (tile.h != 2)
		return;
	for (int i = 0; i < rows; i++) {
		const v_float32x4 cb = cv::v_load(tile.cb + tile.first + 8 * i);
		const v_float32x4 cr = cv::v_load(tile.cr + tile.first + 8 * i);
		const v_float32x4 l = luma[i] = mean_luma(tile, i);

		y = y + l;
		b = b + cb;
		r = r + cr;
		yy = cv::v_fma(l, l, yy);
		yb = cv::v_fma(l, cb, yb);
		yr = cv::v_fma(l, cr, yr);
	}
	/* y, b, r, yy at once; yb and yr */
	v_float32x4 sums[4], pairs[4];

	cv::v_transpose4x4(y, b, r, yy, sums[0], sums[1], sums[2], sums[3]);
	cv::v_transpose4x4(yb, yr, zero, zero, pairs[0], pairs[1], pairs[2], pairs[3]);
	float mean[4], product[4];
	const v_float32x4 part = cv::v_setall_f32(share);

	cv::v_store(mean, (sums[0] + sums[1] + sums[2] + sums[3]) * part);
	cv::v_store(product, (pairs[0] + pairs[1] + pairs[2] + pairs[3]) * part);
	const float variance = mean[3] - mean[0] * mean[0];

	if (!(variance > kLeastVariance))
		return;
	tile.cb_slope = (product[0] - mean[0] * mean[1]) / variance;
	tile.cr_slope = (product[1] - mean[0] * mean[2]) / variance;
	for (int i = 0; i < rows; i++) {
		float *cb = tile.cb + tile.first + 8 * i, *cr = tile.cr + tile.first + 8 * i;

		cv::v_store(cb, cv::v_load(cb) - luma[i] * cv::v_setall_f32(tile.cb_slope));
		cv::v_store(cr, cv::v_load(cr) - luma[i] * cv::v_setall_f32(tile.cr_slope));
	}
}

void lp::tile_rgb(const tile &tile, uint8_t rgb[64][3])
{
	const v_float32x4 of_red = cv::v_setall_f32(1.0F + 1.402F * tile.cr_slope);
	const v_float32x4 of_green =
		cv::v_setall_f32(1.0F - 0.344136F * tile.cb_slope - 0.714136F * tile.cr_slope);
	const v_float32x4 of_blue = cv::v_setall_f32(1.0F + 1.772F * tile.cb_slope);

	for (int p = 0; p < 64; p += 16) {
		v_int32x4 red[4], green[4], blue[4];

		for (int k = 0; k < 4; k++) { /* two rows, half a row at a time */
			const int y = p / 8 + k / 2, x = k % 2 * 4;
			const int from = tile.first + y / tile.v * 8;
			const v_float32x4 l = cv::v_load(tile.luma + 8 * y + x);
			const v_float32x4 b = chroma_at(tile.cb + from, x, tile.h);
			const v_float32x4 r = chroma_at(tile.cr + from, x, tile.h);

			red[k] = codes(cv::v_fma(l, of_red, r * cv::v_setall_f32(1.402F)));
			green[k] = codes(l * of_green - b * cv::v_setall_f32(0.344136F) -
					 r * cv::v_setall_f32(0.714136F));
			blue[k] = codes(cv::v_fma(l, of_blue, b * cv::v_setall_f32(1.772F)));
		}
		cv::v_store_interleave(rgb[p], pack(red), pack(green), pack(blue));
	}
}
