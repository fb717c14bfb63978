/* SPDX-License-Identifier: Apache-2.0 */
/* Blocks of raw 8-bit frames: their means and the variance of their luma, directly. */
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>

#include "include/frame.h"
#include "vision/camera/response.h"
#include "vision/picture/block_row.hpp"
#include "vision/picture/cells.h"
#include "vision/picture/planes.hpp"
#include "vision/picture/simd.hpp"

using cv::v_int32x4;
using cv::v_uint16x8;
using cv::v_uint8x16;

namespace
{

/* Sums over one block, or a quarter of one. */
struct block_sums {
	int count, luma, squares, cb, cr, chroma_count;
};

/* Running sums over two blocks side by side, row by row. */
struct pair_sums {
	v_uint16x8 luma[2];
	v_int32x4 squares[2];

	pair_sums()
	{
		luma[0] = luma[1] = cv::v_setzero_u16();
		squares[0] = squares[1] = cv::v_setzero_s32();
	}

	void add(const v_uint8x16 &row)
	{
		v_uint16x8 half[2];

		cv::v_expand(row, half[0], half[1]);
		for (int k = 0; k < 2; k++) {
			const cv::v_int16x8 v = cv::v_reinterpret_as_s16(half[k]);

			luma[k] = luma[k] + half[k]; /* 8 rows of 255 fit */
			squares[k] = cv::v_dotprod(v, v, squares[k]);
		}
	}
};

/* Interleaved chroma (Cb Cr Cb Cr ...) of two blocks, eight bytes each. */
struct pair_chroma {
	v_uint16x8 sum[2];

	pair_chroma()
	{
		sum[0] = sum[1] = cv::v_setzero_u16();
	}

	void add(const v_uint8x16 &row)
	{
		v_uint16x8 half[2];

		cv::v_expand(row, half[0], half[1]);
		sum[0] = sum[0] + half[0];
		sum[1] = sum[1] + half[1];
	}
};

void finish(const pair_sums &luma, const pair_chroma &chroma, int chroma_rows, block_sums out[2])
{
	for (int k = 0; k < 2; k++) {
		uint16_t c[8];

		cv::v_store(c, chroma.sum[k]);
		out[k] = {64,
			  static_cast<int>(cv::v_reduce_sum(luma.luma[k])),
			  cv::v_reduce_sum(luma.squares[k]),
			  c[0] + c[2] + c[4] + c[6],
			  c[1] + c[3] + c[5] + c[7],
			  4 * chroma_rows};
	}
}

struct raw_picture final : lp::block_picture {
	const struct lp_frame *frame;
	lp::planes planes;

	raw_picture(const struct lp_frame *f, int side) : frame(f), planes(lp::planes_of(f))
	{
		cell_px = side;
		width = (static_cast<int>(f->width_px) + side - 1) / side;
		height = (static_cast<int>(f->height_px) + side - 1) / side;
		grey = f->format == LP_FORMAT_GREY;
	}

	void read(int row, lp::block_row &out) const override;

	void pixels(int column, int row, uint8_t rgb[64][3]) const override
	{
		lp::tile tile;

		lp::plane_tile(planes, column, row, tile);
		lp::follow_luma(tile);
		lp::tile_rgb(tile, rgb);
	}

	void pair(int bx, int by, block_sums out[2]) const;
	block_sums single(int column, int row) const;
};

/* Two whole blocks. */
void raw_picture::pair(int bx, int by, block_sums out[2]) const
{
	const size_t stride = frame->stride_bytes;
	const uint8_t *data = frame->data + static_cast<size_t>(by) * 8 * stride;
	pair_sums luma;
	pair_chroma chroma;

	if (frame->format == LP_FORMAT_YUYV) {
		for (int y = 0; y < 8; y++) {
			v_uint8x16 l, c;

			cv::v_load_deinterleave(data + y * stride + bx * 16, l, c);
			luma.add(l);
			chroma.add(c);
		}
		finish(luma, chroma, 8, out);
		return;
	}
	for (int y = 0; y < 8; y++)
		luma.add(cv::v_load(data + y * stride + bx * 8));
	if (frame->format == LP_FORMAT_NV12) {
		const uint8_t *plane =
			frame->data + stride * (frame->height_px + static_cast<size_t>(by) * 4);

		for (int y = 0; y < 4; y++)
			chroma.add(cv::v_load(plane + y * stride + bx * 8));
	}
	finish(luma, chroma, 4, out);
}

/* Any cell, the picture's edge repeated. */
block_sums raw_picture::single(int column, int row) const
{
	block_sums s = {};

	s.count = s.chroma_count = cell_px * cell_px;
	for (int p = 0; p < s.count; p++) {
		const int x = std::min<int>(cell_px * column + p % cell_px, frame->width_px - 1);
		const int y = std::min<int>(cell_px * row + p / cell_px, frame->height_px - 1);
		const lp::ycbcr code = planes.at(x, y);

		s.luma += code.y;
		s.squares += code.y * code.y;
		s.cb += code.cb;
		s.cr += code.cr;
	}
	return s;
}

void store(const block_sums &s, int bx, lp::block_row &out)
{
	const auto count = static_cast<float>(s.count);
	const float mean = static_cast<float>(s.luma) / count;

	out.luma[bx] = s.luma * LP_CODE_STEPS / s.count;
	out.cb[bx] = s.cb * LP_CODE_STEPS / s.chroma_count - 128 * LP_CODE_STEPS;
	out.cr[bx] = s.cr * LP_CODE_STEPS / s.chroma_count - 128 * LP_CODE_STEPS;
	out.variance[bx] = out.doubt[bx] =
		std::max(static_cast<float>(s.squares) / count - mean * mean, 0.0F);
}

void raw_picture::read(int row, lp::block_row &out) const
{
	const int whole_rows = cell_px == 8 ? static_cast<int>(frame->height_px) / 8 : 0;
	const int whole_columns = static_cast<int>(frame->width_px) / 8;
	int bx = 0;

	for (; row < whole_rows && bx + 2 <= whole_columns; bx += 2) {
		block_sums s[2];

		pair(bx, row, s);
		store(s[0], bx, out);
		store(s[1], bx + 1, out);
	}
	for (; bx < width; bx++)
		store(single(bx, row), bx, out);
}

} /* namespace */

extern "C" int lp_cells_from_raw_blocks(struct lp_cells *cells, const struct lp_frame *frame,
					int cell_px, const float *row_weight, const uint8_t *seen,
					const struct lp_response *response, float scale,
					int exact_blocks)
{
	return lp::cells_from_blocks(cells, raw_picture(frame, cell_px), row_weight, seen, response,
				     scale, exact_blocks);
}
