/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What is known of one row of blocks (8 x 8 px), or of their quarters, without looking at their
 * pixels: mean luma and chroma, and the energy of the luma's detail. Every 8-bit frame can be read
 * as rows of these.
 */
#ifndef LP_VISION_PICTURE_BLOCK_ROW_HPP
#define LP_VISION_PICTURE_BLOCK_ROW_HPP

#include <cstdint>

#include "vision/jpeg/blocks.h"
#include "vision/picture/cells.h"

namespace lp
{

/* Arrays of cells across the picture; vector loads and stores reach up to three beyond the last.
 */
struct block_row {
	static constexpr int kMax = LP_JPEG_MAX_SIDE_PX / 4 + LP_JPEG_BLOCK_MARGIN;

	int32_t luma[kMax];	    /* mean code * LP_CODE_STEPS */
	int32_t cb[kMax], cr[kMax]; /* (mean code - 128) * LP_CODE_STEPS */
	float variance[kMax];	    /* of the luma, squared codes */
	/* the same, as the mean over the block's quarters: which block is looked at closer */
	float doubt[kMax];
};

/* A picture as rows of cells, and its pixels, block by block, where they are asked for. */
struct block_picture {
	int width, height; /* in cells */
	int cell_px = 8;   /* 8: a cell is a block; 4: a quarter of one */
	bool grey;

	virtual void read(int row, block_row &out) const = 0;
	virtual void pixels(int column, int row, uint8_t rgb[64][3]) const = 0;

      protected:
	~block_picture() = default;
};

/* Cells of linear radiance from means and detail; the `exact_blocks` whose mean tells least are
 * looked at pixel by pixel. row_weight, of all rows of whole blocks, and seen: as in
 * vision/picture/cells.h. */
int cells_from_blocks(struct lp_cells *cells, const block_picture &picture, const float *row_weight,
		      const uint8_t *seen, const struct lp_response *response, float scale,
		      int exact_blocks);

} /* namespace lp */

#endif
