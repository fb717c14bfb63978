/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg_pixels.h"

#include <cmath>
#include <cstdint>
#include <cstring>

#include "vision/jpeg_blocks.h"
#include "vision/simd.hpp"

using cv::v_float32x4;
using cv::v_int32x4;
using cv::v_uint8x16;

namespace
{

/* cosine[u][x] = C(u) / 2 cos((2 x + 1) u pi / 16): orthonormal DCT-II (T.81, A.3.3). */
struct dct_table {
	float cosine[8][8];

	dct_table()
	{
		for (int u = 0; u < 8; u++)
			for (int x = 0; x < 8; x++)
				cosine[u][x] =
					static_cast<float>((u ? 0.5 : 0.5 * M_SQRT1_2) *
							   std::cos((2 * x + 1) * u * M_PI / 16.0));
	}
};

const dct_table table;

/* Samples of one block, 0..255 with 128 the middle: rows of coefficients first, then columns.
 * Clamped like any decoder's, since colour conversion would spread what overshoots. */
void inverse_dct(const int16_t coefficients[64], float samples[64])
{
	float rows[8][8];
	const float *cosine[8]; /* of the rows that are not zero: the few that matter */
	int count = 0;

	for (int v = 0; v < 8; v++) {
		uint64_t half[2];

		std::memcpy(half, coefficients + 8 * v, sizeof(half));
		if (!(half[0] | half[1]))
			continue;
		v_float32x4 low = cv::v_setzero_f32(), high = low;

		for (int u = 0; u < 8; u++) {
			if (!coefficients[8 * v + u])
				continue;
			const v_float32x4 c =
				cv::v_setall_f32(static_cast<float>(coefficients[8 * v + u]));

			low = cv::v_fma(c, cv::v_load(table.cosine[u]), low);
			high = cv::v_fma(c, cv::v_load(table.cosine[u] + 4), high);
		}
		cv::v_store(rows[count], low);
		cv::v_store(rows[count] + 4, high);
		cosine[count++] = table.cosine[v];
	}
	for (int y = 0; y < 8; y++) {
		v_float32x4 low = cv::v_setzero_f32(), high = low;

		for (int i = 0; i < count; i++) {
			const v_float32x4 c = cv::v_setall_f32(cosine[i][y]);

			low = cv::v_fma(c, cv::v_load(rows[i]), low);
			high = cv::v_fma(c, cv::v_load(rows[i] + 4), high);
		}
		const v_float32x4 middle = cv::v_setall_f32(128.0F);
		const v_float32x4 zero = cv::v_setzero_f32(), top = cv::v_setall_f32(255.0F);

		cv::v_store(samples + 8 * y, cv::v_min(cv::v_max(low + middle, zero), top));
		cv::v_store(samples + 8 * y + 4, cv::v_min(cv::v_max(high + middle, zero), top));
	}
}

inline uint8_t code(float value)
{
	const int rounded = static_cast<int>(value + 0.5F); /* negative values clamp anyway */

	return static_cast<uint8_t>(rounded < 0 ? 0 : rounded > 255 ? 255 : rounded);
}

inline v_int32x4 codes(const v_float32x4 &value)
{
	return cv::v_trunc(value + cv::v_setall_f32(0.5F));
}

/* Sixteen samples to bytes, saturated. */
inline v_uint8x16 pack(const v_int32x4 c[4])
{
	return cv::v_pack(cv::v_pack_u(c[0], c[1]), cv::v_pack_u(c[2], c[3]));
}

/* Four chroma samples, less 128, of the pixels from `x` on of a row; h luma samples share one. */
inline v_float32x4 chroma_at(const float *row, int x, int h)
{
	const v_float32x4 middle = cv::v_setall_f32(128.0F);
	v_float32x4 low, high;

	if (h == 1)
		return cv::v_load(row + x) - middle;
	const v_float32x4 c = cv::v_load(row);

	cv::v_zip(c, c, low, high);
	return (x ? high : low) - middle;
}

} /* namespace */

extern "C" void lp_jpeg_block_rgb(const struct lp_jpeg_reader *reader, int bx, int by,
				  uint8_t rgb[64][3])
{
	const int h = reader->component[0].h, v = reader->component[0].v;
	/* where this block's pixels begin in the MCU's chroma blocks */
	const int x0 = bx % h * (8 / h), y0 = by % v * (8 / v);
	struct lp_jpeg_mcu_block block;
	float luma[64], cb[64], cr[64];

	lp_jpeg_block_coefficients(reader, bx, by, &block);
	inverse_dct(block.luma, luma);
	if (reader->component_count == 1) {
		for (int p = 0; p < 64; p++)
			rgb[p][0] = rgb[p][1] = rgb[p][2] = code(luma[p]);
		return;
	}
	inverse_dct(block.cb, cb);
	inverse_dct(block.cr, cr);
	for (int p = 0; p < 64; p += 16) {
		v_int32x4 red[4], green[4], blue[4];

		for (int k = 0; k < 4; k++) { /* two rows, half a row at a time */
			const int y = p / 8 + k / 2, x = k % 2 * 4, from = (y0 + y / v) * 8 + x0;
			const v_float32x4 l = cv::v_load(luma + 8 * y + x);
			const v_float32x4 b = chroma_at(cb + from, x, h);
			const v_float32x4 r = chroma_at(cr + from, x, h);

			/* JFIF: BT.601, full range */
			red[k] = codes(l + r * cv::v_setall_f32(1.402F));
			green[k] = codes(l - b * cv::v_setall_f32(0.344136F) -
					 r * cv::v_setall_f32(0.714136F));
			blue[k] = codes(l + b * cv::v_setall_f32(1.772F));
		}
		cv::v_store_interleave(rgb[p], pack(red), pack(green), pack(blue));
	}
}
