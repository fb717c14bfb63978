/* SPDX-License-Identifier: Apache-2.0 */
/* Geometry of the small panorama's grid (include/panorama.h): directions, solid angles, neighbours.
 */
#ifndef LP_LIGHT_MATH_GRID_H
#define LP_LIGHT_MATH_GRID_H

#include <stdbool.h>
#include <stdint.h>

struct lp_panorama;

#define LP_NEIGHBOURS 8

/* Immutable after creation; may be read from any thread. */
struct lp_grid {
	int width, height;
	uint32_t row_factor;		/* lp_grid_row() */
	float *row_solid_angle_sr;	/* height: solid angle of one cell, exact; sums to 4 pi */
	float *row_sin, *row_cos;	/* height: of the polar angle at the cell's centre */
	float *column_sin, *column_cos; /* width: of the longitude at the cell's centre */
};

/* -EINVAL unless width = 2 * height, width a multiple of 4, 16..LP_PANORAMA_MAX_WIDTH. */
int lp_grid_create(int width, int height, struct lp_grid **grid);
void lp_grid_destroy(struct lp_grid *grid); /* accepts NULL */

/* Unit vector from the probe through the centre of cell `index` = row * width + column. */
void lp_grid_direction(const struct lp_grid *grid, int index, float direction[3]);

/* The eight cells around `index`; the grid wraps at the seam and closes over the poles. */
static inline void lp_grid_neighbours(const struct lp_grid *grid, int index,
				      int neighbours[LP_NEIGHBOURS]);
void lp_grid_neighbours_at_edge(const struct lp_grid *grid, int index,
				int neighbours[LP_NEIGHBOURS]);

/* Mean radiance (luminance) of what the panorama has seen of the sphere; 0 when it has seen
 * nothing. */
float lp_grid_mean_luminance(const struct lp_grid *grid, const struct lp_panorama *panorama);

/* Cell that contains `direction` (any length > 0). */
int lp_grid_cell(const struct lp_grid *grid, const float direction[3]);

/* index / width: by a reciprocal in 32-bit fixed point, exact for every index of a grid. */
static inline int lp_grid_row(const struct lp_grid *grid, int index)
{
	return (int)((uint64_t)(uint32_t)index * grid->row_factor >> 32);
}

static inline bool lp_grid_inside(const struct lp_grid *grid, int index)
{
	const int row = lp_grid_row(grid, index), column = index - row * grid->width;

	return row > 0 && row < grid->height - 1 && column > 0 && column < grid->width - 1;
}

static inline void lp_grid_neighbours(const struct lp_grid *grid, int index,
				      int neighbours[LP_NEIGHBOURS])
{
	const int above = index - grid->width, below = index + grid->width;

	if (!lp_grid_inside(grid, index)) {
		lp_grid_neighbours_at_edge(grid, index, neighbours);
		return;
	}
	for (int c = -1; c <= 1; c++) {
		neighbours[1 + c] = above + c;
		neighbours[6 + c] = below + c;
	}
	neighbours[3] = index - 1;
	neighbours[4] = index + 1;
}

static inline float lp_grid_solid_angle_sr(const struct lp_grid *grid, int index)
{
	return grid->row_solid_angle_sr[lp_grid_row(grid, index)];
}

#endif
