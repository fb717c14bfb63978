/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/picture/cells.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "include/frame.h"
#include "vision/camera/response.h"
#include "vision/picture/cells_store.hpp"
#include "vision/picture/planes.hpp"

/* Cells of storage beyond the last: vector stores may touch them. */
static constexpr size_t kMargin = 4;

extern "C" int lp_cells_reserve(struct lp_cells *cells, int width, int height, int cell_px)
{
	const size_t count = static_cast<size_t>(width) * height;

	if (count > cells->capacity) {
		const size_t room = count + kMargin;

		lp_cells_release(cells);
		cells->radiance = static_cast<float(*)[4]>(std::malloc(room * sizeof(float[4])));
		cells->clipped = static_cast<uint8_t *>(std::malloc(room));
		if (!cells->radiance || !cells->clipped) {
			lp_cells_release(cells);
			return -ENOMEM;
		}
		cells->capacity = count;
	}
	cells->width = width;
	cells->height = height;
	cells->cell_px = cell_px;
	cells->clipped_count = 0;
	cells->invalid_count = 0;
	cells->mean_code = NAN;
	return 0;
}

extern "C" float lp_frame_saturation(const struct lp_frame *frame)
{
	return std::max(frame->brightest, LP_INFINITY_IS_AT_LEAST);
}

extern "C" void lp_cells_release(struct lp_cells *cells)
{
	std::free(cells->radiance);
	std::free(cells->clipped);
	*cells = {};
}

namespace
{

/* What is summed over the at most 64 pixels of one cell. */
struct cell_sum {
	float rgb[3];
	float weight;
	int luma; /* codes; green stands for it */
	int left_out;
	bool clipped;

	void add(const float linear[3], float w)
	{
		for (int c = 0; c < 3; c++)
			rgb[c] += w * linear[c];
		weight += w;
	}

	/* A run of pixels of one row, three codes each. */
	void add(const uint8_t *codes, int count, const struct lp_response *response, float w)
	{
		const float *red = response->pixel[0], *green = response->pixel[1];
		const float *blue = response->pixel[2];
		float r = 0.0F, g = 0.0F, b = 0.0F;
		unsigned int above = 0; /* bit 8: some code is at the top */

		for (const uint8_t *p = codes; p < codes + 3 * count; p += 3) {
			r += red[p[0]];
			g += green[p[1]];
			b += blue[p[2]];
			luma += p[1];
			above |= (p[0] + 256U - lp::kTopCode) | (p[1] + 256U - lp::kTopCode) |
				 (p[2] + 256U - lp::kTopCode);
		}
		rgb[0] += w * r;
		rgb[1] += w * g;
		rgb[2] += w * b;
		weight += w * static_cast<float>(count);
		clipped |= (above & 256U) != 0;
	}
};

/* The pixels of every cell, cell by cell: `gather(x0, x1, y, row_weight, sum)` adds a run. */
template <typename Gather>
int fill_from_pixels(struct lp_cells *cells, int width_px, int height_px, int cell_px,
		     const float *row_weight, float scale, Gather gather)
{
	const int width = (width_px + cell_px - 1) / cell_px;
	const int height = (height_px + cell_px - 1) / cell_px;
	double luma = 0.0;
	int ret = lp_cells_reserve(cells, width, height, cell_px);

	cells->scale = scale;
	for (int row = 0; ret == 0 && row < height; row++)
		for (int column = 0; column < width; column++) {
			const int x1 = std::min((column + 1) * cell_px, width_px);
			const int y1 = std::min((row + 1) * cell_px, height_px);
			cell_sum sum = {};
			float mean[3] = {};

			for (int y = row * cell_px; y < y1; y++) {
				const float w = row_weight ? row_weight[y] : 1.0F;

				gather(column * cell_px, x1, y, w, sum);
			}
			for (int c = 0; c < 3 && sum.weight > 0.0F; c++)
				mean[c] = sum.rgb[c] / sum.weight;
			cells->invalid_count += sum.left_out;
			luma += sum.luma;
			lp::store_cell(cells, static_cast<size_t>(row) * width + column, mean,
				       sum.clipped);
		}
	if (ret == 0)
		cells->mean_code = luma / (static_cast<double>(width_px) * height_px);
	return ret;
}

enum class pixel { broken, sound, saturated };

pixel float_pixel(const struct lp_frame *frame, int x, int y, float linear[3])
{
	auto kind = pixel::sound;

	std::memcpy(linear,
		    frame->data + static_cast<size_t>(y) * frame->stride_bytes +
			    static_cast<size_t>(x) * 3 * sizeof(float),
		    3 * sizeof(float));
	/* one broken channel spoils the sample; !(a >= 0) is also true of NaN */
	for (int c = 0; c < 3; c++) {
		if (!(linear[c] >= 0.0F))
			return pixel::broken;
		if (std::isinf(linear[c])) {
			linear[c] = lp_frame_saturation(frame);
			kind = pixel::saturated;
		}
	}
	return kind;
}

int fill_from_float(struct lp_cells *cells, const struct lp_frame *frame, int cell_px,
		    const float *row_weight, float scale)
{
	const auto gather = [frame](int x0, int x1, int y, float w, cell_sum &sum) {
		float linear[3];

		for (int x = x0; x < x1; x++) {
			const pixel kind = float_pixel(frame, x, y, linear);

			if (kind == pixel::broken)
				sum.left_out++;
			else
				sum.add(linear, w);
			sum.clipped |= kind == pixel::saturated;
		}
	};
	const int ret = fill_from_pixels(cells, frame->width_px, frame->height_px, cell_px,
					 row_weight, scale, gather);

	cells->mean_code = NAN;
	return ret;
}

/* Pixels of a raw 8-bit frame, tile by tile; a cell lies within one. */
class raw_tiles
{
	lp::planes planes;
	int column = -1, row = -1; /* of the tile at hand */
	uint8_t rgb[64][3];

      public:
	explicit raw_tiles(const struct lp_frame *frame) : planes(lp::planes_of(frame))
	{
	}

	/* From pixel (x, y) to the end of its tile's row. */
	const uint8_t *codes(int x, int y)
	{
		if (x / 8 != column || y / 8 != row) {
			lp::tile tile;

			column = x / 8;
			row = y / 8;
			lp::plane_tile(planes, column, row, tile);
			lp::follow_luma(tile);
			lp::tile_rgb(tile, rgb);
		}
		return rgb[y % 8 * 8 + x % 8];
	}
};

} /* namespace */

extern "C" int lp_cells_from_rgb8(struct lp_cells *cells, const uint8_t *rgb, int width_px,
				  int height_px, size_t stride_bytes, int cell_px,
				  const float *row_weight, const struct lp_response *response,
				  float scale)
{
	const auto gather = [=](int x0, int x1, int y, float w, cell_sum &sum) {
		sum.add(rgb + y * stride_bytes + x0 * 3, x1 - x0, response, w);
	};

	return fill_from_pixels(cells, width_px, height_px, cell_px, row_weight, scale, gather);
}

extern "C" int lp_cells_from_raw(struct lp_cells *cells, const struct lp_frame *frame, int cell_px,
				 const float *row_weight, const struct lp_response *response,
				 float scale)
{
	raw_tiles tiles(frame);
	const auto gather = [&tiles, response](int x0, int x1, int y, float w, cell_sum &sum) {
		sum.add(tiles.codes(x0, y), x1 - x0, response, w);
	};

	if (frame->format == LP_FORMAT_RGB_F32)
		return fill_from_float(cells, frame, cell_px, row_weight, scale);
	return fill_from_pixels(cells, frame->width_px, frame->height_px, cell_px, row_weight,
				scale, gather);
}

namespace
{

void float_pixels(const struct lp_frame *frame, int x0, int y0, int side, float scale,
		  float (*rgb)[3])
{
	for (int p = 0; p < side * side; p++) {
		const int x = std::min(x0 + p % side, static_cast<int>(frame->width_px) - 1);
		const int y = std::min(y0 + p / side, static_cast<int>(frame->height_px) - 1);
		const bool sound = float_pixel(frame, x, y, rgb[p]) != pixel::broken;

		for (int c = 0; c < 3; c++)
			rgb[p][c] = sound ? rgb[p][c] * scale : 0.0F;
	}
}

} /* namespace */

extern "C" void lp_frame_linear_pixels(const struct lp_frame *frame, int x, int y, int side,
				       const struct lp_response *response, float scale,
				       float (*rgb)[3])
{
	if (frame->format == LP_FORMAT_RGB_F32) {
		float_pixels(frame, x, y, side, scale, rgb);
		return;
	}
	raw_tiles tiles(frame);

	for (int row = 0; row < side; row++) {
		const uint8_t *code = tiles.codes(x, y + row);

		for (int i = 0; i < 3 * side; i++)
			rgb[row * side + i / 3][i % 3] = scale * response->pixel[i % 3][code[i]];
	}
}
