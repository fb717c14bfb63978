/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The newest frame of one exposure setting: its cells of radiance, and what is needed to look at
 * single pixels again. A bracket is several of these.
 */
#ifndef LP_VISION_EXPOSURE_H
#define LP_VISION_EXPOSURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "vision/camera/code_noise.h"
#include "vision/picture/cells.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_frame;
struct lp_jpeg_reader;
struct lp_response;

enum lp_decode {
	LP_DECODE_BLOCKS, /* means and detail of blocks; pixels only where asked for */
	LP_DECODE_PIXELS, /* every pixel; JPEG by libjpeg-turbo at 1/divisor */
};

struct lp_decode_options {
	enum lp_decode decode;
	int divisor; /* PIXELS: 1, 2, 4, 8 */
	/* of the full-size picture; PIXELS: a multiple of divisor; BLOCKS: 8 or 4 */
	int cell_px;
	int exact_blocks; /* BLOCKS: most blocks decoded after all */
};

struct lp_exposure {
	struct lp_cells cells;
	float scale;	   /* full scale to radiance */
	float exposure_us; /* of the frame, times gain; NAN: unknown */
	struct lp_code_noise noise;
	uint64_t serial;	/* when it was last refreshed, in frames of the imager */
	struct lp_frame *frame; /* held while its pixels may be looked at; NULL: not needed */
	struct lp_jpeg_reader *jpeg;
	bool jpeg_holds_frame;
	uint8_t *rgb; /* PIXELS of a JPEG: decoded picture */
	size_t rgb_capacity;
	int rgb_width_px, rgb_height_px, rgb_divisor;
	uint8_t *yuv; /* PIXELS of a JPEG with subsampled chroma: its planes */
	size_t yuv_capacity;
	void *turbo; /* tjhandle */
};

/* Takes over the reference to `frame`. Fills cells; BLOCKS: those that are seen. On an error the
 * exposure holds no picture. -EBADMSG: the frame is broken (logged); -ENOMEM. */
int lp_exposure_load(struct lp_exposure *exposure, struct lp_frame *frame,
		     const struct lp_decode_options *options, const float *row_weight,
		     const uint8_t *seen, const struct lp_response *response);

/* Scale the cells anew, when the exposure turns out to be another one. */
void lp_exposure_rescale(struct lp_exposure *exposure, float scale);

/* Linear radiance of the pixels of camera cell (column, row), row-major, cell_px * cell_px RGB
 * triples; pixels beyond the picture repeat its edge. At 1/divisor each decoded pixel stands for
 * divisor^2. */
void lp_exposure_cell_pixels(const struct lp_exposure *exposure, int column, int row,
			     const struct lp_response *response, float (*rgb)[3]);

void lp_exposure_release(struct lp_exposure *exposure); /* everything it holds */

#ifdef __cplusplus
}
#endif

#endif
