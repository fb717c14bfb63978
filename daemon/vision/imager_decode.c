/* SPDX-License-Identifier: Apache-2.0 */
/* How closely a frame is read. */
#include <math.h>

#include "vision/camera/camera.h"
#include "vision/imager_internal.h"

/* Pixels across a cell, a power of two up to a JPEG's block: so many that it is at most so many
 * times coarser than the panorama's cells. */
static int cell_px_for(int circle_px, int panorama_width, double coarser)
{
	int cell_px = 8;

	while (cell_px > 1 && circle_px * coarser < panorama_width * cell_px)
		cell_px /= 2;
	return cell_px;
}

/*
 * Cells coarser than the panorama's let a lamp's light wander between these while the camera turns.
 * So quarters of blocks are read where their size is nearer to the panorama's than that of blocks.
 * Blocks up to twice as coarse as the panorama's cells are read
 *  - of a lens's picture, whose cells lie across the panorama's anyway;
 *  - behind a polarizing film: with quarters the polarizer's wheel did not come to rest;
 *  - where no block is looked at closer (preset fast): a quarter would often seem clipped.
 * Of smaller pictures every pixel is decoded.
 */
struct lp_decode_options lp_imager_decode_options(const struct lp_imager *imager,
						  const struct lp_frame *frame)
{
	const struct lp_imager_options *o = &imager->options;
	const int circle_px = lp_camera_circle_px(imager->eye->camera, (int)frame->width_px);
	const bool is_ball = imager->eye->camera->projection == LP_BALL;
	const bool blocks = frame->format != LP_FORMAT_RGB_F32 && o->decode == LP_DECODE_BLOCKS;
	const bool quarters = o->exact_blocks > 0 && lp_camera_is_whole(imager->eye->camera) &&
			      !imager->film.stokes;
	struct lp_decode_options d = {.decode = o->decode,
				      .divisor = o->divisor,
				      .cell_px = cell_px_for(circle_px, o->panorama_width,
							     quarters ? M_SQRT2 : 2.0),
				      .exact_blocks = o->exact_blocks};

	if (blocks && !is_ball && d.cell_px >= (quarters ? 4 : 8))
		return d;
	d.decode = LP_DECODE_PIXELS;
	/* A cell across the outline of a ball would take in what stands behind it. */
	d.cell_px = is_ball ? 1 : cell_px_for(circle_px, o->panorama_width, 1.0);
	if (blocks || is_ball || d.divisor < 1)
		d.divisor = 1;
	if (frame->format == LP_FORMAT_MJPEG && d.cell_px < d.divisor)
		d.cell_px = d.divisor;
	return d;
}
