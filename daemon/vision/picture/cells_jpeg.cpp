/* SPDX-License-Identifier: Apache-2.0 */
/* Blocks of a JPEG, as vision/jpeg/blocks.h reads them, and their quarters. */
#include <algorithm>
#include <cstdint>

#include "vision/camera/response.h"
#include "vision/jpeg/blocks.h"
#include "vision/picture/block_row.hpp"
#include "vision/picture/cells.h"
#include "vision/picture/simd.hpp"
#include "vision/picture/tile.hpp"

static_assert(LP_CODE_STEPS == 8, "dc * step / 8 is a mean code: dc * step counts eighths");

namespace
{

struct jpeg_picture : lp::block_picture {
	const struct lp_jpeg_reader *reader;
	int shift_x, shift_y; /* luma blocks per chroma block, log2 */

	explicit jpeg_picture(const struct lp_jpeg_reader *r) : reader(r)
	{
		width = lp_jpeg_visible_blocks_x(r, 0);
		height = lp_jpeg_visible_blocks_y(r, 0);
		grey = r->component_count == 1;
		shift_x = !grey && r->component[0].h == 2;
		shift_y = !grey && r->component[0].v == 2;
	}

	void read(int row, lp::block_row &out) const override;

	void pixels(int column, int row, uint8_t rgb[64][3]) const final
	{
		lp::tile tile;

		lp::jpeg_tile(reader, column, row, tile);
		lp::follow_luma(tile);
		lp::tile_rgb(tile, rgb);
	}
};

/* Chroma of one row; each chroma block serves 1 << shift luma blocks. */
void read_chroma(const struct lp_jpeg_component &c, int row, int shift, int width, int32_t *out)
{
	const int16_t *dc = c.dc + static_cast<size_t>(row) * c.blocks_x;
	const cv::v_int32x4 step = cv::v_setall_s32(c.dc_step);

	if (!shift) {
		for (int bx = 0; bx < width; bx += 4)
			cv::v_store(out + bx, cv::v_load_expand(dc + bx) * step);
		return;
	}
	for (int bx = 0; bx < width; bx += 8) {
		const cv::v_int32x4 value = cv::v_load_expand(dc + bx / 2) * step;
		cv::v_int32x4 low, high;

		cv::v_zip(value, value, low, high);
		cv::v_store(out + bx, low);
		cv::v_store(out + bx + 4, high);
	}
}

void jpeg_picture::read(int row, lp::block_row &out) const
{
	const struct lp_jpeg_component &y = reader->component[0];
	const size_t first = static_cast<size_t>(row) * y.blocks_x;
	const cv::v_int32x4 step = cv::v_setall_s32(y.dc_step);
	const cv::v_int32x4 middle = cv::v_setall_s32(128 * LP_CODE_STEPS);
	const cv::v_float32x4 samples = cv::v_setall_f32(1.0F / 64.0F / LP_ENERGY_STEPS);

	for (int bx = 0; bx < width; bx += 4) {
		cv::v_store(out.luma + bx, cv::v_load_expand(y.dc + first + bx) * step + middle);
		const cv::v_float32x4 variance =
			cv::v_cvt_f32(cv::v_load(reader->energy + first + bx)) * samples;

		cv::v_store(out.variance + bx, variance);
		cv::v_store(out.doubt + bx, variance);
	}
	if (grey)
		return;
	read_chroma(reader->component[1], row >> shift_y, shift_x, width, out.cb);
	read_chroma(reader->component[2], row >> shift_y, shift_x, width, out.cr);
}

/* Four quarters to a block. */
struct jpeg_quarters final : jpeg_picture {
	explicit jpeg_quarters(const struct lp_jpeg_reader *r) : jpeg_picture(r)
	{
		cell_px = 4;
		width = (r->width_px + 3) / 4;
		height = (r->height_px + 3) / 4;
	}

	void read(int row, lp::block_row &out) const override;

      private:
	void detail(int row, lp::block_row &out) const;

	const int16_t *quarters(int component, int row) const
	{
		const struct lp_jpeg_component &c = reader->component[component];

		return c.quarters + static_cast<size_t>(row) * 2 * c.blocks_x;
	}
};

/* The largest variance of codes whose mean is so much (Bhatia & Davis 2000). */
float most_variance(float mean)
{
	return std::max(mean * (255.0F - mean), 1.0F);
}

/* What the block's detail holds beyond the differences of its quarters, shared among these by how
 * much of it each can have: in one that is black or white there is none. */
void jpeg_quarters::detail(int row, lp::block_row &out) const
{
	const int32_t *energy =
		reader->energy + static_cast<size_t>(row / 2) * reader->component[0].blocks_x;
	const int16_t *own = quarters(0, row), *other = quarters(0, row ^ 1);

	for (int left = 0; left < width; left += 2) {
		const int four[] = {own[left], own[left + 1], other[left], other[left + 1]};
		float most[4], sum = 0.0F, squares = 0.0F, all_most = 0.0F;

		for (int k = 0; k < 4; k++) {
			const float mean =
				static_cast<float>(four[k] + 128 * LP_CODE_STEPS) / LP_CODE_STEPS;

			sum += mean;
			squares += mean * mean;
			all_most += most[k] = most_variance(mean);
		}
		const float all =
			static_cast<float>(energy[left / 2]) * (1.0F / 64.0F / LP_ENERGY_STEPS);
		const float within = std::max(4.0F * all - (squares - sum * sum / 4.0F), 0.0F);

		for (int k = 0; k < 2; k++)
			out.variance[left + k] = within * most[k] / all_most;
		out.doubt[left] = out.doubt[left + 1] = within / 4.0F;
	}
}

void jpeg_quarters::read(int row, lp::block_row &out) const
{
	const int16_t *luma = quarters(0, row);

	for (int c = 0; c < width; c++)
		out.luma[c] = luma[c] + 128 * LP_CODE_STEPS;
	detail(row, out);
	for (int k = 1; !grey && k < 3; k++) {
		const int16_t *chroma = quarters(k, row >> shift_y);
		int32_t *to = k == 1 ? out.cb : out.cr;

		for (int c = 0; c < width; c++)
			to[c] = chroma[c >> shift_x];
	}
}

} /* namespace */

extern "C" int lp_cells_from_jpeg(struct lp_cells *cells, const struct lp_jpeg_reader *reader,
				  int cell_px, const float *row_weight, const uint8_t *seen,
				  const struct lp_response *response, float scale, int exact_blocks)
{
	if (cell_px == 4)
		return lp::cells_from_blocks(cells, jpeg_quarters(reader), row_weight, seen,
					     response, scale, exact_blocks);
	return lp::cells_from_blocks(cells, jpeg_picture(reader), row_weight, seen, response, scale,
				     exact_blocks);
}
