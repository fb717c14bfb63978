/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/grid.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "include/panorama.h"

static void fill(struct lp_grid *grid)
{
	const double step_rad = M_PI / grid->height;

	for (int r = 0; r < grid->height; r++) {
		const double theta = step_rad * (r + 0.5);

		grid->row_sin[r] = (float)sin(theta);
		grid->row_cos[r] = (float)cos(theta);
		/* integral of sin over the row, times the width of a column */
		grid->row_solid_angle_sr[r] =
			(float)(2.0 * sin(theta) * sin(step_rad / 2.0) * 2.0 * M_PI / grid->width);
	}
	for (int c = 0; c < grid->width; c++) {
		const double lambda = 2.0 * M_PI * ((c + 0.5) / grid->width - 0.5);

		grid->column_sin[c] = (float)sin(lambda);
		grid->column_cos[c] = (float)cos(lambda);
	}
}

int lp_grid_create(int width, int height, struct lp_grid **grid)
{
	if (width != 2 * height || width % 4 || width < 16 || width > LP_PANORAMA_MAX_WIDTH)
		return -EINVAL;

	struct lp_grid *g = calloc(1, sizeof(*g));
	float *storage = calloc(3 * (size_t)height + 2 * (size_t)width, sizeof(*storage));

	if (!g || !storage) {
		free(storage);
		free(g);
		return -ENOMEM;
	}
	g->width = width;
	g->height = height;
	g->row_factor = UINT32_MAX / (uint32_t)width + 1;
	g->row_solid_angle_sr = storage; /* one block; freed through this pointer */
	g->row_sin = storage + height;
	g->row_cos = g->row_sin + height;
	g->column_sin = g->row_cos + height;
	g->column_cos = g->column_sin + width;
	fill(g);
	*grid = g;
	return 0;
}

void lp_grid_destroy(struct lp_grid *grid)
{
	if (!grid)
		return;
	free(grid->row_solid_angle_sr);
	free(grid);
}

void lp_grid_direction(const struct lp_grid *grid, int index, float direction[3])
{
	const int row = lp_grid_row(grid, index), column = index - row * grid->width;

	direction[0] = grid->row_sin[row] * grid->column_sin[column];
	direction[1] = grid->row_cos[row];
	direction[2] = -grid->row_sin[row] * grid->column_cos[column];
}

/* Beyond a pole the grid goes on in the same row, half a turn away. */
static int cell_at(const struct lp_grid *grid, int row, int column)
{
	if (row < 0 || row >= grid->height) {
		row = row < 0 ? 0 : grid->height - 1;
		column += grid->width / 2;
	}
	column %= grid->width;
	if (column < 0)
		column += grid->width;
	return row * grid->width + column;
}

void lp_grid_neighbours_at_edge(const struct lp_grid *grid, int index,
				int neighbours[LP_NEIGHBOURS])
{
	const int row = lp_grid_row(grid, index), column = index - row * grid->width;
	int count = 0;

	for (int r = row - 1; r <= row + 1; r++)
		for (int c = column - 1; c <= column + 1; c++)
			if (r != row || c != column)
				neighbours[count++] = cell_at(grid, r, c);
}

int lp_grid_cell(const struct lp_grid *grid, const float direction[3])
{
	const double length =
		sqrt((double)direction[0] * direction[0] + (double)direction[1] * direction[1] +
		     (double)direction[2] * direction[2]);
	const double theta = acos(fmax(-1.0, fmin(1.0, direction[1] / length)));
	const double lambda = atan2(direction[0], -direction[2]);
	int row = (int)(theta / M_PI * grid->height);
	int column = (int)((lambda / (2.0 * M_PI) + 0.5) * grid->width);

	row = row < grid->height ? row : grid->height - 1;
	return row * grid->width + column % grid->width;
}

/* In four chains: an addition waits for the one before. */
static float row_luminance(const float (*cells)[4], int width)
{
	float a = 0.0F, b = 0.0F, c = 0.0F, d = 0.0F;

	for (const float(*end)[4] = cells + width; cells < end; cells += 4) {
		a += cells[0][LP_LUMINANCE];
		b += cells[1][LP_LUMINANCE];
		c += cells[2][LP_LUMINANCE];
		d += cells[3][LP_LUMINANCE];
	}
	return a + b + c + d;
}

/* Rows in float, their sum in double. */
float lp_grid_mean_luminance(const struct lp_grid *grid, const struct lp_panorama *panorama)
{
	const float(*cells)[4] = (const float(*)[4])panorama->cells;
	double sum = 0.0;

	for (int r = 0; r < panorama->height; r++, cells += panorama->width)
		sum += (double)row_luminance(cells, panorama->width) * grid->row_solid_angle_sr[r];
	return panorama->seen_fraction > 0.0F
		       ? (float)(sum / (4.0 * M_PI * panorama->seen_fraction))
		       : 0.0F;
}
