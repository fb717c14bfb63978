/* SPDX-License-Identifier: Apache-2.0 */
/* From block means and detail to linear light: the heart of light without pixels. */
#include <algorithm>
#include <cfloat>
#include <cstdint>
#include <cstring>

#include "vision/camera/response.h"
#include "vision/picture/block_row.hpp"
#include "vision/picture/cells_store.hpp"
#include "vision/picture/simd.hpp"

using cv::v_float32x4;
using cv::v_int32x4;

namespace
{

/* Blocks whose mean tells least about their light. */
struct suspects {
	static constexpr int kMax = 2048;
	struct suspect {
		int block;
		float energy;
	} list[kMax];
	int count = 0, insisted = 0;

	/* Its place in the list; -1: there is no room. */
	int add(int block, float energy)
	{
		if (count == kMax)
			return -1;
		list[count] = {block, energy};
		return count++;
	}

	/* One that must be among the strongest. */
	int insist(int block)
	{
		insisted += count < kMax;
		return add(block, FLT_MAX);
	}

	/* Those insisted on, and the `most` others with the most detail. */
	int strongest(int most)
	{
		most += insisted;
		if (count > most) {
			std::nth_element(list, list + most, list + count,
					 [](const suspect &a, const suspect &b) {
						 return a.energy > b.energy;
					 });
			return most;
		}
		return count;
	}
};

struct rgb_means {
	v_int32x4 red, green, blue; /* table indices: mean codes * LP_CODE_STEPS */
};

inline v_int32x4 clamp_index(const v_int32x4 &index)
{
	return cv::v_min(cv::v_max(index, cv::v_setzero_s32()),
			 cv::v_setall_s32(LP_CODE_INDEX_MAX));
}

/* YCbCr to RGB of JFIF on the means of four cells, in 16-bit fixed point. */
inline rgb_means means_at(const lp::block_row &row, int bx, bool grey)
{
	const v_int32x4 luma = cv::v_load(row.luma + bx), half = cv::v_setall_s32(32768);

	if (grey) {
		const v_int32x4 l = clamp_index(luma);

		return {l, l, l};
	}
	const v_int32x4 cb = cv::v_load(row.cb + bx), cr = cv::v_load(row.cr + bx);
	const v_int32x4 red = (cr * cv::v_setall_s32(91881) + half) >> 16;
	const v_int32x4 green =
		(cb * cv::v_setall_s32(22554) + cr * cv::v_setall_s32(46802) + half) >> 16;
	const v_int32x4 blue = (cb * cv::v_setall_s32(116130) + half) >> 16;

	return {clamp_index(luma + red), clamp_index(luma - green), clamp_index(luma + blue)};
}

/* Mean linear light of four cells in one channel, times scale. */
inline v_float32x4 linear_light(const struct lp_block_response *table, const v_int32x4 &index,
				const v_float32x4 &variance, const v_float32x4 &scale)
{
	v_float32x4 linear, half_curvature;

	cv::v_lut_deinterleave(&table->linear, index << 1, linear, half_curvature);
	return cv::v_fma(half_curvature, variance, linear) * scale;
}

/* One byte per bit. */
inline uint32_t spread_bits(int bits)
{
	return (bits * 0x00204081U) & 0x01010101U;
}

struct filler {
	struct lp_cells *cells;
	const struct lp_response *response;
	const float *row_weight; /* per pixel row, for every row of whole blocks; NULL: all alike */
	const uint8_t *seen;
	suspects found;
	int64_t luma;
	int count;     /* of the cells that are seen */
	int per_block; /* cells across a block */
	/* of the blocks of this row of them: their places in found.list, + 1; 0: in none */
	uint16_t listed[lp::block_row::kMax];

	bool uneven(int by) const;
	int seen_of(int bx, int by) const;
	void skip(size_t first);
	void count_in(const int *four, int inside);
	void row(const lp::block_row &row, int by, bool grey);
	void list(int bits, int bx, int by, bool insist, const float *doubt);
	void exact(const lp::block_picture &picture, int block);
	void exact_cell(const uint8_t rgb[64][3], int column, int row);
};

/* At a pole of an equirectangular picture the rows of one cell weigh so differently that its mean
 * says little of its light, wherever it has detail. */
bool filler::uneven(int by) const
{
	const int last = cells->cell_px - 1;
	const float *w =
		row_weight ? row_weight + cells->cell_px * static_cast<size_t>(by) : nullptr;

	return w && (w[last] > 4.0F * w[0] || w[0] > 4.0F * w[last]);
}

/* Those of the four cells from bx on that are in the picture and seen, as bits. */
int filler::seen_of(int bx, int by) const
{
	const int inside = bx + 4 <= cells->width ? 15 : (1 << (cells->width - bx)) - 1;

	return seen ? inside & seen[by * LP_QUADS(cells->width) + bx / 4] : inside;
}

/* Four cells that no lens sees. */
void filler::skip(size_t first)
{
	for (int k = 0; k < 4; k++)
		cv::v_store(cells->radiance[first + k], cv::v_setzero_f32());
	std::memset(cells->clipped + first, 0, 4);
}

/* The luma of four cells, of those that are `inside`. Mostly all of them are. */
void filler::count_in(const int *four, int inside)
{
	if (inside == 15) {
		luma += four[0] + four[1] + four[2] + four[3];
		count += 4;
		return;
	}
	for (int bits = inside; bits; bits &= bits - 1, count++)
		luma += four[__builtin_ctz(bits)];
}

/* Stores reach up to three cells past the row: into the next row, which comes later, or the margin.
 */
void filler::row(const lp::block_row &row, int by, bool grey)
{
	const size_t first = static_cast<size_t>(by) * cells->width;
	const v_float32x4 scale = cv::v_setall_f32(cells->scale);
	const v_float32x4 code = cv::v_setall_f32(1.0F / LP_CODE_STEPS);
	const v_float32x4 zero = cv::v_setzero_f32();
	const bool insist = uneven(by);

	for (int bx = 0; bx < cells->width; bx += 4) {
		const int inside = seen_of(bx, by);

		if (!inside) {
			skip(first + bx);
			continue;
		}
		const rgb_means m = means_at(row, bx, grey);
		const v_float32x4 variance = cv::v_load(row.variance + bx);
		const v_float32x4 red = linear_light(response->block[0], m.red, variance, scale);
		const v_float32x4 green =
			linear_light(response->block[1], m.green, variance, scale);
		const v_float32x4 blue = linear_light(response->block[2], m.blue, variance, scale);
		const v_float32x4 top =
			cv::v_cvt_f32(cv::v_max(cv::v_max(m.red, m.green), m.blue)) * code;
		const v_float32x4 mean = cv::v_cvt_f32(cv::v_load(row.luma + bx)) * code;
		/* texture reaches 3 sigma above its mean */
		const v_float32x4 head = cv::v_max(cv::v_setall_f32(lp::kTopCode) - top, zero);
		const v_float32x4 clipped =
			(head * head < cv::v_setall_f32(9.0F) * variance) | (head == zero);
		const v_float32x4 doubt = cv::v_load(row.doubt + bx);
		const v_float32x4 suspect = (doubt > cv::v_setall_f32(64.0F)) &
					    (cv::v_setall_f32(4.0F) * doubt > mean * mean);
		const int clipped_bits = cv::v_signmask(clipped) & inside;
		const uint32_t clipped_bytes = spread_bits(clipped_bits);

		cv::v_store_interleave(cells->radiance[first + bx], red, green, blue,
				       lp::luminance(red, green, blue));
		std::memcpy(cells->clipped + first + bx, &clipped_bytes, 4);
		cells->clipped_count += __builtin_popcount(clipped_bits);
		/* a quarter may seem clipped because another one has the detail */
		const v_float32x4 doubtful =
			per_block > 1 ? suspect | (clipped & (head > zero)) : suspect;

		if (const int bits = cv::v_signmask(doubtful) & inside)
			list(bits, bx, by, insist, row.doubt);
		count_in(row.luma + bx, inside);
	}
}

/* The blocks of four cells from bx on, of those in `bits`, each once, by the most that any of its
 * cells shows. */
void filler::list(int bits, int bx, int by, bool insist, const float *doubt)
{
	const int blocks = (cells->width + per_block - 1) / per_block;

	for (; bits; bits &= bits - 1) {
		const int k = bx + __builtin_ctz(bits), column = k / per_block;
		const int block = by / per_block * blocks + column;

		if (listed[column]) {
			float &energy = found.list[listed[column] - 1].energy;

			energy = std::max(energy, doubt[k]);
			continue;
		}
		listed[column] = static_cast<uint16_t>(
			1 + (insist ? found.insist(block) : found.add(block, doubt[k])));
	}
}

/* A cell from the pixels of its block. */
void filler::exact_cell(const uint8_t rgb[64][3], int column, int row)
{
	const int side = cells->cell_px;
	const int left = column % per_block * side, above = row % per_block * side;
	const size_t cell = static_cast<size_t>(row) * cells->width + column;
	float linear[3] = {}, weight[8], total = 0.0F;
	int top = 0;

	for (int y = 0; y < side; y++)
		total += weight[y] = row_weight ? row_weight[side * row + y] : 1.0F;
	for (int p = 0; p < side * side; p++) {
		const uint8_t *pixel = rgb[(above + p / side) * 8 + left + p % side];

		for (int c = 0; c < 3; c++) {
			linear[c] += response->pixel[c][pixel[c]] * weight[p / side];
			top = std::max(top, static_cast<int>(pixel[c]));
		}
	}
	for (float &l : linear)
		l /= static_cast<float>(side) * total;
	cells->clipped_count -= cells->clipped[cell];
	lp::store_cell(cells, cell, linear, top >= lp::kTopCode);
}

/* The block's pixels after all. */
void filler::exact(const lp::block_picture &picture, int block)
{
	const int blocks = (cells->width + per_block - 1) / per_block;
	const int column = block % blocks, row = block / blocks;
	uint8_t rgb[64][3];

	picture.pixels(column, row, rgb);
	for (int k = 0; k < per_block * per_block; k++) {
		const int x = column * per_block + k % per_block;
		const int y = row * per_block + k / per_block;

		if (x < cells->width && y < cells->height)
			exact_cell(rgb, x, y);
	}
}

} /* namespace */

int lp::cells_from_blocks(struct lp_cells *cells, const block_picture &picture,
			  const float *row_weight, const uint8_t *seen,
			  const struct lp_response *response, float scale, int exact_blocks)
{
	const int ret = lp_cells_reserve(cells, picture.width, picture.height, picture.cell_px);
	filler fill = {cells, response, row_weight, seen, {}, 0, 0, 8 / picture.cell_px, {}};
	block_row row;

	if (ret < 0)
		return ret;
	cells->scale = scale;
	for (int by = 0; by < picture.height; by++) {
		if (by % fill.per_block == 0)
			std::memset(fill.listed, 0, sizeof(fill.listed));
		picture.read(by, row);
		fill.row(row, by, picture.grey);
	}
	for (int i = 0, n = fill.found.strongest(exact_blocks); i < n; i++)
		fill.exact(picture, fill.found.list[i].block);
	cells->mean_code = static_cast<double>(fill.luma) / LP_CODE_STEPS / std::max(fill.count, 1);
	return 0;
}
