/* SPDX-License-Identifier: Apache-2.0 */
/* Single pixels of raw 8-bit frames: YUYV, NV12, GREY. */
#ifndef LP_VISION_RAW_PIXELS_HPP
#define LP_VISION_RAW_PIXELS_HPP

#include <algorithm>
#include <cstdint>

#include "include/frame.h"

namespace lp
{

struct ycbcr {
	int y, cb, cr;
};

inline ycbcr raw_ycbcr(const struct lp_frame *frame, int x, int y)
{
	const size_t stride = frame->stride_bytes;
	const uint8_t *row = frame->data + y * stride;

	if (frame->format == LP_FORMAT_YUYV) {
		const uint8_t *pair = row + x / 2 * 4;

		return {pair[x % 2 * 2], pair[1], pair[3]};
	}
	if (frame->format == LP_FORMAT_NV12) {
		const uint8_t *chroma =
			frame->data + stride * (frame->height_px + y / 2) + x / 2 * 2;

		return {row[x], chroma[0], chroma[1]};
	}
	return {row[x], 128, 128};
}

inline uint8_t clamp_code(float value)
{
	return static_cast<uint8_t>(std::clamp(value + 0.5F, 0.0F, 255.0F));
}

/* BT.601, full range, as JFIF and as UVC cameras deliver. */
inline void raw_codes(const struct lp_frame *frame, int x, int y, uint8_t rgb[3])
{
	const ycbcr c = raw_ycbcr(frame, x, y);
	const float cb = static_cast<float>(c.cb - 128), cr = static_cast<float>(c.cr - 128);

	rgb[0] = clamp_code(static_cast<float>(c.y) + 1.402F * cr);
	rgb[1] = clamp_code(static_cast<float>(c.y) - 0.344136F * cb - 0.714136F * cr);
	rgb[2] = clamp_code(static_cast<float>(c.y) + 1.772F * cb);
}

} /* namespace lp */

#endif
