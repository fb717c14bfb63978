/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A hand before the lens: which part of the camera's view has become dark and shows no detail any
 * more, while the rest of it shows what is known. Lights that go off are something else: they
 * change the rest, too, or leave the detail of what they lit. Pure computation on the panorama's
 * grid, in blocks of several cells; one thread; plain data, zeroed is a lens that is not covered.
 */
#ifndef LP_VISION_DOUBT_COVER_H
#define LP_VISION_DOUBT_COVER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_grid;
struct lp_residual;

/* A hand takes no longer than this to come, and to be found. */
#define LP_COVER_COMES_S 0.7
#define LP_COVER_COLUMNS 30
#define LP_COVER_ROWS 15
#define LP_COVER_BLOCKS (LP_COVER_COLUMNS * LP_COVER_ROWS)

/* Of the camera's view. */
struct lp_cover {
	bool found;
	int dimmed_frames;		  /* in a row, that look as if light had gone instead */
	uint8_t covered[LP_COVER_BLOCKS]; /* 1 where it is */
	uint8_t near[LP_COVER_BLOCKS];	  /* 1 there and beside: rims are soft */
};

/* What is covered in this frame, after `before` in the one before it, if the frame's full scale is
 * so much radiance. Blocks that a frame does not tell of (too dark in any case) stay as they were.
 * LP_CELL_COVERED is not looked at. */
struct lp_cover lp_cover_look(const struct lp_cover *before, const struct lp_residual *residual,
			      float scale);

/* Block of a cell of the grid. */
static inline int lp_cover_block(int grid_width, int cell)
{
	const int row = cell / grid_width, column = cell % grid_width;

	return row * 2 * LP_COVER_ROWS / grid_width * LP_COVER_COLUMNS +
	       column * LP_COVER_COLUMNS / grid_width;
}

/* Set or clear LP_CELL_COVERED in a panorama's flags. */
void lp_cover_mark(const struct lp_cover *cover, const struct lp_grid *grid, uint8_t *flags);

#ifdef __cplusplus
}
#endif

#endif
