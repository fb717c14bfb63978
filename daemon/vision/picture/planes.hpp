/* SPDX-License-Identifier: Apache-2.0 */
/* 8-bit pictures as luma and chroma in memory, planar or packed: YUYV, NV12, GREY, decoded JPEG. */
#ifndef LP_VISION_PICTURE_PLANES_HPP
#define LP_VISION_PICTURE_PLANES_HPP

#include <cstddef>
#include <cstdint>

#include "include/frame.h"
#include "vision/picture/tile.hpp"

namespace lp
{

struct ycbcr {
	int y, cb, cr;
};

/* Sample (x, y) of a plane is at y * stride + x * step. */
struct planes {
	const uint8_t *luma, *cb, *cr; /* cb, cr: NULL in grey pictures */
	size_t luma_stride, chroma_stride;
	int luma_step, chroma_step;
	int width, height; /* in pixels */
	int h, v;	   /* luma samples per chroma sample, across and down: 1 or 2 */

	ycbcr at(int x, int y) const
	{
		const size_t chroma = y / v * chroma_stride + x / h * chroma_step;
		const int l = luma[y * luma_stride + x * luma_step];

		return cb ? ycbcr{l, cb[chroma], cr[chroma]} : ycbcr{l, 128, 128};
	}
};

/* Of a raw 8-bit frame; its data is borrowed. */
planes planes_of(const struct lp_frame *frame);

/* The 8 x 8 pixels from (8 bx, 8 by) on; beyond the picture its edge is repeated. */
void plane_tile(const planes &planes, int bx, int by, tile &tile);

/* The whole picture, chroma following luma; rgb: width * height triples. */
void planes_to_rgb(const planes &planes, uint8_t *rgb);

} /* namespace lp */

#endif
