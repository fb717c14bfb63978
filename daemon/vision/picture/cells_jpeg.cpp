/* SPDX-License-Identifier: Apache-2.0 */
/* Blocks of a JPEG, as vision/jpeg/blocks.h reads them. */
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

struct jpeg_picture final : lp::block_picture {
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

	void pixels(int column, int row, uint8_t rgb[64][3]) const override
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
		cv::v_store(out.variance + bx,
			    cv::v_cvt_f32(cv::v_load(reader->energy + first + bx)) * samples);
	}
	if (grey)
		return;
	read_chroma(reader->component[1], row >> shift_y, shift_x, width, out.cb);
	read_chroma(reader->component[2], row >> shift_y, shift_x, width, out.cr);
}

} /* namespace */

extern "C" int lp_cells_from_jpeg(struct lp_cells *cells, const struct lp_jpeg_reader *reader,
				  const float *row_weight, const uint8_t *seen,
				  const struct lp_response *response, float scale, int exact_blocks)
{
	return lp::cells_from_blocks(cells, jpeg_picture(reader), row_weight, seen, response, scale,
				     exact_blocks);
}
