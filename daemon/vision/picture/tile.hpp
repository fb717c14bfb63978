/* SPDX-License-Identifier: Apache-2.0 */
/*
 * 8 x 8 pixels as luma and subsampled chroma, and how they become colours.
 *
 * Cameras send one chroma sample for two or four pixels: at the rim of a lamp it is the mean of
 * lamp and surround, and whoever repeats it takes colour from the lamp and gives it to the dark,
 * where it is cut off at black. A blue lamp of a few pixels so gets a fifth less blue and a fifth
 * more red. But where two colours meet, chroma is linear in luma, also in its means: the line
 * fitted through a tile's samples tells each pixel's chroma by its own luma.
 */
#ifndef LP_VISION_PICTURE_TILE_HPP
#define LP_VISION_PICTURE_TILE_HPP

#include <cstddef>
#include <cstdint>

struct lp_jpeg_reader;

namespace lp
{

struct tile {
	float luma[64];	       /* codes, row by row */
	float cb[64], cr[64];  /* codes less 128; samples of one row are 8 apart */
	int h, v;	       /* luma samples per chroma sample, across and down: 1 or 2 */
	int first;	       /* index of this tile's first chroma sample */
	float cb_slope = 0.0F; /* chroma of a pixel = its sample + slope * luma: follow_luma() */
	float cr_slope = 0.0F;
};

/* Let chroma follow luma within its samples; their means stay. 4:2:0 and 4:2:2; others are left
 * alone. Once per tile. */
void follow_luma(tile &tile);

/* The pixels of luma block (bx, by) of the frame that the reader holds. */
void jpeg_tile(const struct lp_jpeg_reader *reader, int bx, int by, tile &tile);

/* Codes R, G, B (JFIF and UVC cameras: BT.601, full range) of the tile's 8 rows. */
void tile_rgb(const tile &tile, uint8_t rgb[64][3]);

} /* namespace lp */

#endif
