/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/picture/planes.hpp"

#include <algorithm>
#include <cstring>

#include "vision/picture/simd.hpp"

lp::planes lp::planes_of(const struct lp_frame *frame)
{
	const size_t stride = frame->stride_bytes;
	planes p = {};

	p.luma = frame->data;
	p.luma_stride = p.chroma_stride = stride;
	p.luma_step = 1;
	p.width = static_cast<int>(frame->width_px);
	p.height = static_cast<int>(frame->height_px);
	p.h = p.v = 1;
	if (frame->format == LP_FORMAT_YUYV) {
		p.luma_step = 2;
		p.chroma_step = 4;
		p.h = 2;
		p.cb = frame->data + 1;
		p.cr = frame->data + 3;
	} else if (frame->format == LP_FORMAT_NV12) {
		p.chroma_step = 2;
		p.h = p.v = 2;
		p.cb = frame->data + stride * frame->height_px;
		p.cr = p.cb + 1;
	}
	return p;
}

namespace
{

/* `columns` x `rows` samples from (x0, y0) on, less `middle`, of a plane of width x height. */
struct window {
	int x0, y0, columns, rows, width, height;
	float middle;
};

void load_clamped(const uint8_t *plane, size_t stride, int step, const window &w, float *out)
{
	for (int y = 0; y < w.rows; y++) {
		const uint8_t *row = plane + std::min(w.y0 + y, w.height - 1) * stride;

		for (int x = 0; x < w.columns; x++)
			out[8 * y + x] =
				static_cast<float>(row[std::min(w.x0 + x, w.width - 1) * step]) -
				w.middle;
	}
}

void load(const uint8_t *plane, size_t stride, int step, const window &w, float *out)
{
	const cv::v_float32x4 middle = cv::v_setall_f32(w.middle);

	if (step != 1 || w.x0 + w.columns > w.width || w.y0 + w.rows > w.height) {
		load_clamped(plane, stride, step, w, out);
		return;
	}
	for (int y = 0; y < w.rows; y++) {
		const uint8_t *row = plane + (w.y0 + y) * stride + w.x0;

		for (int x = 0; x < w.columns; x += 4) {
			alignas(4) uint8_t four[4];

			std::memcpy(four, row + x, sizeof(four));
			const cv::v_uint32x4 codes = cv::v_load_expand_q(four);

			cv::v_store(out + 8 * y + x,
				    cv::v_cvt_f32(cv::v_reinterpret_as_s32(codes)) - middle);
		}
	}
}

} /* namespace */

void lp::plane_tile(const planes &planes, int bx, int by, tile &tile)
{
	const int h = planes.h, v = planes.v;
	const window chroma = {8 / h * bx,
			       8 / v * by,
			       8 / h,
			       8 / v,
			       (planes.width + h - 1) / h,
			       (planes.height + v - 1) / v,
			       128.0F};

	tile.h = h;
	tile.v = v;
	tile.first = 0;
	tile.cb_slope = tile.cr_slope = 0.0F;
	load(planes.luma, planes.luma_stride, planes.luma_step,
	     {8 * bx, 8 * by, 8, 8, planes.width, planes.height, 0.0F}, tile.luma);
	if (!planes.cb) {
		std::memset(tile.cb, 0, sizeof(tile.cb));
		std::memset(tile.cr, 0, sizeof(tile.cr));
		return;
	}
	load(planes.cb, planes.chroma_stride, planes.chroma_step, chroma, tile.cb);
	load(planes.cr, planes.chroma_stride, planes.chroma_step, chroma, tile.cr);
}

void lp::planes_to_rgb(const planes &planes, uint8_t *rgb)
{
	const size_t stride = static_cast<size_t>(planes.width) * 3;

	for (int y0 = 0; y0 < planes.height; y0 += 8)
		for (int x0 = 0; x0 < planes.width; x0 += 8) {
			const int columns = std::min(8, planes.width - x0);
			const int rows = std::min(8, planes.height - y0);
			uint8_t pixels[64][3];
			tile tile;

			plane_tile(planes, x0 / 8, y0 / 8, tile);
			follow_luma(tile);
			tile_rgb(tile, pixels);
			for (int y = 0; y < rows; y++)
				std::memcpy(rgb + (y0 + y) * stride + 3 * static_cast<size_t>(x0),
					    pixels[8 * y], 3 * static_cast<size_t>(columns));
		}
}
