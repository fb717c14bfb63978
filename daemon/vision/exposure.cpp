/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/exposure.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include <turbojpeg.h>

#include "include/frame.h"
#include "vision/camera/response.h"
#include "vision/jpeg/blocks.h"
#include "vision/picture/cells.h"
#include "vision/picture/planes.hpp"
#include "vision/picture/simd.hpp"
#include "vision/picture/tile.hpp"

extern "C" {
#include "base/jpeg_start.h"
#include "base/log.h"
}

extern "C" void lp_exposure_release(struct lp_exposure *exposure)
{
	lp_cells_release(&exposure->cells);
	lp_frame_release(exposure->frame);
	lp_jpeg_reader_destroy(exposure->jpeg);
	std::free(exposure->rgb);
	std::free(exposure->yuv);
	if (exposure->turbo)
		tjDestroy(exposure->turbo);
	*exposure = {};
}

namespace
{

int refuse(const char *stage, const char *reason)
{
	lp_warning("frame", stage, "%s; frame left out", reason);
	return -EBADMSG;
}

/* A decompressor that failed on a header misreads the next one (libjpeg-turbo 2.1): begin anew. */
int refuse_turbo(struct lp_exposure *exposure, const char *stage)
{
	const int ret = refuse(stage, tjGetErrorStr2(exposure->turbo));

	tjDestroy(exposure->turbo);
	exposure->turbo = nullptr;
	return ret;
}

/* At least `bytes` of storage, contents lost. */
int reserve(uint8_t **buffer, size_t *capacity, size_t bytes)
{
	if (bytes <= *capacity)
		return 0;
	std::free(*buffer);
	*buffer = static_cast<uint8_t *>(std::malloc(bytes));
	*capacity = *buffer ? bytes : 0;
	return *buffer ? 0 : -ENOMEM;
}

/* What tjDecompressHeader3() tells. */
struct turbo_header {
	int width, height, subsampling, colourspace;
};

/* Subsampled chroma is made finer here: libjpeg would smooth it. */
bool follows_luma(const turbo_header &header, int divisor)
{
	return divisor == 1 && header.colourspace == TJCS_YCbCr &&
	       (header.subsampling == TJSAMP_420 || header.subsampling == TJSAMP_422);
}

/* A JPEG in a frame, and whether its blocks have been found whole already (vision/jpeg/blocks.h).
 */
struct jpeg {
	const uint8_t *data;
	size_t size;
	bool is_whole;
};

/*
 * libjpeg warns of data that it did not need, of a missing end, and of broken data, in whose place
 * it puts something; light is no filling. The blocks of most JPEGs are known to be whole by then;
 * of others any warning counts.
 */
int judge(struct lp_exposure *exposure, const jpeg &jpeg, int result)
{
	if (result == 0 || (jpeg.is_whole && tjGetErrorCode(exposure->turbo) == TJERR_WARNING))
		return 0;
	return refuse_turbo(exposure, "JPEG data");
}

int decode_planes(struct lp_exposure *exposure, const jpeg &jpeg, const turbo_header &header)
{
	unsigned char *plane[3];
	size_t size[3];

	for (int c = 0; c < 3; c++)
		size[c] = tjPlaneSizeYUV(c, header.width, 0, header.height, header.subsampling);
	if (reserve(&exposure->yuv, &exposure->yuv_capacity, size[0] + size[1] + size[2]) < 0)
		return -ENOMEM;
	plane[0] = exposure->yuv;
	plane[1] = plane[0] + size[0];
	plane[2] = plane[1] + size[1];
	const int ret = judge(exposure, jpeg,
			      tjDecompressToYUVPlanes(exposure->turbo, jpeg.data, jpeg.size, plane,
						      header.width, nullptr, header.height, 0));

	if (ret < 0)
		return ret;

	lp::planes planes;

	planes.luma = plane[0];
	planes.cb = plane[1];
	planes.cr = plane[2];
	planes.luma_stride = tjPlaneWidth(0, header.width, header.subsampling);
	planes.chroma_stride = tjPlaneWidth(1, header.width, header.subsampling);
	planes.luma_step = planes.chroma_step = 1;
	planes.width = header.width;
	planes.height = header.height;
	planes.h = 2;
	planes.v = header.subsampling == TJSAMP_420 ? 2 : 1;
	lp::planes_to_rgb(planes, exposure->rgb);
	return 0;
}

/* Whole picture by libjpeg-turbo at 1/divisor. */
int decode_picture(struct lp_exposure *exposure, const struct lp_frame *frame, const jpeg &jpeg,
		   int divisor)
{
	turbo_header header;

	if (!exposure->turbo)
		exposure->turbo = tjInitDecompress();
	if (!exposure->turbo)
		return -ENOMEM;
	if (tjDecompressHeader3(exposure->turbo, jpeg.data, jpeg.size, &header.width,
				&header.height, &header.subsampling, &header.colourspace) < 0)
		return refuse_turbo(exposure, "JPEG header");
	if (header.width != static_cast<int>(frame->width_px) ||
	    header.height != static_cast<int>(frame->height_px))
		return refuse("JPEG header", "the picture has another size than the stream");
	const tjscalingfactor factor = {1, divisor};
	const int w = TJSCALED(header.width, factor), h = TJSCALED(header.height, factor);

	if (reserve(&exposure->rgb, &exposure->rgb_capacity, static_cast<size_t>(w) * h * 3) < 0)
		return -ENOMEM;
	exposure->rgb_width_px = w;
	exposure->rgb_height_px = h;
	exposure->rgb_divisor = divisor;
	if (follows_luma(header, divisor))
		return decode_planes(exposure, jpeg, header);
	return judge(exposure, jpeg,
		     tjDecompress2(exposure->turbo, jpeg.data, jpeg.size, exposure->rgb, w, 0, h,
				   TJPF_RGB, 0));
}

int load_picture(struct lp_exposure *exposure, const struct lp_frame *frame, const jpeg &jpeg,
		 int divisor, int cell_px, const float *row_weight,
		 const struct lp_response *response)
{
	int ret = decode_picture(exposure, frame, jpeg, divisor);

	if (ret == 0)
		ret = lp_cells_from_rgb8(&exposure->cells, exposure->rgb, exposure->rgb_width_px,
					 exposure->rgb_height_px,
					 static_cast<size_t>(exposure->rgb_width_px) * 3,
					 cell_px / divisor, divisor == 1 ? row_weight : nullptr,
					 response, exposure->scale);
	exposure->cells.cell_px = cell_px;
	return ret;
}

/* Whatever is decoded of it: the blocks say whether it is whole. */
int load_jpeg(struct lp_exposure *exposure, const struct lp_frame *frame,
	      const struct lp_decode_options *options, const float *row_weight, const uint8_t *seen,
	      const struct lp_response *response)
{
	const bool blocks = options->decode == LP_DECODE_BLOCKS;
	const size_t start = lp_jpeg_start(frame->data, frame->size_bytes, 0);
	jpeg jpeg = {frame->data + start, frame->size_bytes - start, false};
	int ret = exposure->jpeg ? 0 : lp_jpeg_reader_create(&exposure->jpeg);

	if (ret == 0)
		ret = lp_jpeg_read(exposure->jpeg, jpeg.data, jpeg.size);
	if (ret == -EBADMSG)
		return refuse("JPEG", "the data is damaged or ends too early");
	if (ret < 0 && ret != -ENOTSUP)
		return ret;
	jpeg.is_whole = ret == 0;
	if (!blocks)
		return load_picture(exposure, frame, jpeg, options->divisor, options->cell_px,
				    row_weight, response);
	if (!jpeg.is_whole) /* progressive and the like: still cells of blocks */
		return load_picture(exposure, frame, jpeg, 1, options->cell_px, nullptr, response);
	if (exposure->jpeg->width_px != static_cast<int>(frame->width_px) ||
	    exposure->jpeg->height_px != static_cast<int>(frame->height_px))
		return refuse("JPEG header", "the picture has another size than the stream");
	ret = options->cell_px == 8 ? 0 : lp_jpeg_read_quarters(exposure->jpeg);
	if (ret < 0)
		return ret;
	exposure->jpeg_holds_frame = true;
	return lp_cells_from_jpeg(&exposure->cells, exposure->jpeg, options->cell_px, row_weight,
				  seen, response, exposure->scale, options->exact_blocks);
}

size_t raw_size(const struct lp_frame *frame)
{
	const size_t plane = static_cast<size_t>(frame->stride_bytes) * frame->height_px;

	return frame->format == LP_FORMAT_NV12
		       ? plane + frame->stride_bytes * ((frame->height_px + 1) / 2)
		       : plane;
}

size_t least_stride(const struct lp_frame *frame)
{
	switch (frame->format) {
	case LP_FORMAT_YUYV:
		return static_cast<size_t>((frame->width_px + 1) / 2) * 4;
	case LP_FORMAT_NV12:
		return static_cast<size_t>((frame->width_px + 1) / 2) * 2;
	case LP_FORMAT_RGB_F32:
		return static_cast<size_t>(frame->width_px) * 3 * sizeof(float);
	default:
		return frame->width_px;
	}
}

int load_raw(struct lp_exposure *exposure, struct lp_frame *frame,
	     const struct lp_decode_options *options, const float *row_weight, const uint8_t *seen,
	     const struct lp_response *response)
{
	int ret;

	if (frame->stride_bytes < least_stride(frame) || frame->size_bytes < raw_size(frame))
		return refuse("raw frame", "fewer bytes than its size needs");
	ret = options->decode == LP_DECODE_BLOCKS
		      ? lp_cells_from_raw_blocks(&exposure->cells, frame, options->cell_px,
						 row_weight, seen, response, exposure->scale,
						 options->exact_blocks)
		      : lp_cells_from_raw(&exposure->cells, frame, options->cell_px, row_weight,
					  response, exposure->scale);
	if (ret == 0)
		exposure->frame = frame;
	return ret;
}

} /* namespace */

extern "C" int lp_exposure_load(struct lp_exposure *exposure, struct lp_frame *frame,
				const struct lp_decode_options *options, const float *row_weight,
				const uint8_t *seen, const struct lp_response *response)
{
	int ret;

	lp_frame_release(exposure->frame);
	exposure->frame = nullptr;
	exposure->jpeg_holds_frame = false;
	exposure->noise = lp_code_noise_of(frame, options->decode == LP_DECODE_PIXELS);
	ret = frame->format == LP_FORMAT_MJPEG
		      ? load_jpeg(exposure, frame, options, row_weight, seen, response)
		      : load_raw(exposure, frame, options, row_weight, seen, response);
	if (!exposure->frame)
		lp_frame_release(frame);
	return ret;
}

extern "C" void lp_exposure_rescale(struct lp_exposure *exposure, float scale)
{
	struct lp_cells *cells = &exposure->cells;
	const cv::v_float32x4 ratio = cv::v_setall_f32(scale / exposure->scale);

	if (scale == exposure->scale)
		return;
	for (size_t i = 0; i < static_cast<size_t>(cells->width) * cells->height; i++)
		cv::v_store(cells->radiance[i], cv::v_load(cells->radiance[i]) * ratio);
	exposure->scale = cells->scale = scale;
}

namespace
{

/* Of a block, or of a quarter of one. */
void block_pixels(const struct lp_exposure *exposure, int column, int row,
		  const struct lp_response *response, float (*rgb)[3])
{
	const int side = exposure->cells.cell_px, x = column * side, y = row * side;
	lp::tile tile;
	uint8_t code[64][3];

	lp::jpeg_tile(exposure->jpeg, x / 8, y / 8, tile);
	lp::follow_luma(tile);
	lp::tile_rgb(tile, code);
	for (int p = 0; p < side * side; p++) {
		const int in_block = (y % 8 + p / side) * 8 + x % 8 + p % side;

		for (int c = 0; c < 3; c++)
			rgb[p][c] = exposure->scale * response->pixel[c][code[in_block][c]];
	}
}

void picture_pixel(const struct lp_exposure *exposure, int x, int y,
		   const struct lp_response *response, float rgb[3])
{
	const int px = std::min(x / exposure->rgb_divisor, exposure->rgb_width_px - 1);
	const int py = std::min(y / exposure->rgb_divisor, exposure->rgb_height_px - 1);
	const uint8_t *code =
		exposure->rgb + (static_cast<size_t>(py) * exposure->rgb_width_px + px) * 3;

	for (int c = 0; c < 3; c++)
		rgb[c] = exposure->scale * response->pixel[c][code[c]];
}

} /* namespace */

extern "C" void lp_exposure_cell_pixels(const struct lp_exposure *exposure, int column, int row,
					const struct lp_response *response, float (*rgb)[3])
{
	const int side = exposure->cells.cell_px;

	if (exposure->jpeg_holds_frame) {
		block_pixels(exposure, column, row, response, rgb);
		return;
	}
	if (exposure->frame) {
		lp_frame_linear_pixels(exposure->frame, column * side, row * side, side, response,
				       exposure->scale, rgb);
		return;
	}
	for (int y = 0; y < side; y++)
		for (int x = 0; x < side; x++)
			picture_pixel(exposure, column * side + x, row * side + y, response,
				      rgb[y * side + x]);
}
