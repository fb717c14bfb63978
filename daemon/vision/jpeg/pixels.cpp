/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/jpeg/pixels.h"

#include <cmath>
#include <cstdint>
#include <cstring>

#include "vision/jpeg/blocks.h"
#include "vision/picture/simd.hpp"
#include "vision/picture/tile.hpp"

using cv::v_float32x4;

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

constexpr float kMiddle = 128.0F;

/* Samples of one block, 0..255 with 128 the middle, which becomes `zero_at`: rows of coefficients
 * first, then columns. Clamped like any decoder's, since colour conversion would spread what
 * overshoots. */
void inverse_dct(const int16_t coefficients[64], float zero_at, float samples[64])
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
		const v_float32x4 middle = cv::v_setall_f32(zero_at);
		const v_float32x4 zero = cv::v_setall_f32(zero_at - kMiddle);
		const v_float32x4 top = cv::v_setall_f32(zero_at - kMiddle + 255.0F);

		cv::v_store(samples + 8 * y, cv::v_min(cv::v_max(low + middle, zero), top));
		cv::v_store(samples + 8 * y + 4, cv::v_min(cv::v_max(high + middle, zero), top));
	}
}

} /* namespace */

void lp::jpeg_tile(const struct lp_jpeg_reader *reader, int bx, int by, tile &tile)
{
	struct lp_jpeg_mcu_block block;

	lp_jpeg_block_coefficients(reader, bx, by, &block);
	inverse_dct(block.luma, kMiddle, tile.luma);
	tile.h = tile.v = 1;
	tile.first = 0;
	if (reader->component_count == 1) {
		std::memset(tile.cb, 0, sizeof(tile.cb));
		std::memset(tile.cr, 0, sizeof(tile.cr));
		return;
	}
	tile.h = reader->component[0].h;
	tile.v = reader->component[0].v;
	/* where this block's pixels begin in the MCU's chroma blocks */
	tile.first = by % tile.v * (8 / tile.v) * 8 + bx % tile.h * (8 / tile.h);
	inverse_dct(block.cb, 0.0F, tile.cb);
	inverse_dct(block.cr, 0.0F, tile.cr);
}

extern "C" void lp_jpeg_block_rgb(const struct lp_jpeg_reader *reader, int bx, int by,
				  uint8_t rgb[64][3])
{
	lp::tile tile;

	lp::jpeg_tile(reader, bx, by, tile);
	lp::tile_rgb(tile, rgb);
}
