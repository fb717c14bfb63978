/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One exposure as linear radiance on the camera's own coarse grid: a cell is a block of cell_px x
 * cell_px pixels. What every kind of frame becomes before the panorama is
 * filled.
 */
#ifndef LP_VISION_PICTURE_CELLS_H
#define LP_VISION_PICTURE_CELLS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_frame;
struct lp_jpeg_reader;
struct lp_response;

/* Codes from here on count as saturated: the last few are bent by many cameras' highlight knee. */
#define LP_TOP_CODE 250
/* Infinity in a float frame is light beyond what was written, in most cases as half floats, whose
 * largest number this is: at least so much, and at least as much as the brightest other sample. */
#define LP_INFINITY_IS_AT_LEAST 65504.0F

/* Storage grows to the largest frame seen and stays. */
struct lp_cells {
	int width, height; /* in cells */
	int cell_px;
	float (*radiance)[4]; /* R, G, B, luminance; of full scale at one second, or the file's unit
			       */
	float scale;	      /* that the frame was scaled by: full scale to radiance */
	uint8_t *clipped;     /* 1: some pixel of the cell is at the top of the scale */
	size_t capacity;
	int clipped_count;
	int invalid_count; /* samples left out: NaN, negative */
	double mean_code;  /* mean luma code 0..255 of 8-bit frames; NAN for float frames */
};

int lp_cells_reserve(struct lp_cells *cells, int width, int height, int cell_px);
void lp_cells_release(struct lp_cells *cells);

/* `scale` turns full scale into radiance: 1 / (exposure in s * gain), or 1 when that is unknown.
 * row_weight: per pixel row, its solid angle up to a factor; NULL: all alike. seen: which cells a
 * lens sees, four to a byte (bit k: cell 4 i + k of the row), rows of LP_QUADS(width) bytes; NULL:
 * all. The others become 0 and count nowhere. */
#define LP_QUADS(cells) (((cells) + 3) / 4)

/*
 * From block means and detail of a JPEG (vision/jpeg/blocks.h), without its pixels; cells of
 * cell_px 8, or 4 once lp_jpeg_read_quarters() has been called.
 * At most `exact_blocks` of the blocks whose mean tells least are decoded, and those with detail
 * where row_weight is uneven across a cell. row_weight holds whole blocks.
 */
int lp_cells_from_jpeg(struct lp_cells *cells, const struct lp_jpeg_reader *reader, int cell_px,
		       const float *row_weight, const uint8_t *seen,
		       const struct lp_response *response, float scale, int exact_blocks);

/* From decoded pixels: RGB, 8 bit, each linearised on its own. */
int lp_cells_from_rgb8(struct lp_cells *cells, const uint8_t *rgb, int width_px, int height_px,
		       size_t stride_bytes, int cell_px, const float *row_weight,
		       const struct lp_response *response, float scale);

/* From block means and detail of a raw 8-bit frame, cell_px 8 or 4; otherwise as from a JPEG. */
int lp_cells_from_raw_blocks(struct lp_cells *cells, const struct lp_frame *frame, int cell_px,
			     const float *row_weight, const uint8_t *seen,
			     const struct lp_response *response, float scale, int exact_blocks);

/* From a raw frame pixel by pixel: YUYV, NV12, GREY, RGB_F32. */
int lp_cells_from_raw(struct lp_cells *cells, const struct lp_frame *frame, int cell_px,
		      const float *row_weight, const struct lp_response *response, float scale);

/* Linear radiance of the side * side pixels from (x, y) on of a raw frame, row-major; beyond the
 * picture its edge, 0 for a broken sample. side and the alignment of x, y: of cells, up to 8. */
void lp_frame_linear_pixels(const struct lp_frame *frame, int x, int y, int side,
			    const struct lp_response *response, float scale, float (*rgb)[3]);

/* What infinity stands for in a float frame, as it is in the file. */
float lp_frame_saturation(const struct lp_frame *frame);

#ifdef __cplusplus
}
#endif

#endif
