/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/coarse.h"

#include <math.h>
#include <string.h>

#include "base/select.h"
#include "light/math/grid.h"
#include "light/math/sh.h"

#define COLUMNS LP_COARSE_COLUMNS
#define ROWS LP_COARSE_ROWS
#define ORDER 4
#define COUNT ((ORDER + 1) * (ORDER + 1))

/* Mean of five cells in a row, binomial weights, of those that are known. */
static float smoothed(const float *from, const int at[5])
{
	static const float weights[5] = {1.0F, 4.0F, 6.0F, 4.0F, 1.0F};
	float sum = 0.0F, weight = 0.0F;

	for (int k = 0; k < 5; k++) {
		if (isnan(from[at[k]]))
			continue;
		sum += weights[k] * from[at[k]];
		weight += weights[k];
	}
	return weight > 0.0F ? sum / weight : NAN;
}

/* Columns go round; rows end at the poles. */
static int cell_of(int row, int column)
{
	const int r = row < 0 ? 0 : row < ROWS ? row : ROWS - 1;

	return r * COLUMNS + (column + COLUMNS) % COLUMNS;
}

void lp_coarse_blur(float *cells)
{
	float across[LP_COARSE_CELLS];

	for (int i = 0; i < LP_COARSE_CELLS; i++) {
		const int row = i / COLUMNS, column = i % COLUMNS;
		const int at[5] = {cell_of(row, column - 2), cell_of(row, column - 1), i,
				   cell_of(row, column + 1), cell_of(row, column + 2)};

		across[i] = smoothed(cells, at);
	}
	for (int i = 0; i < LP_COARSE_CELLS; i++) {
		const int row = i / COLUMNS, column = i % COLUMNS;
		const int at[5] = {cell_of(row - 2, column), cell_of(row - 1, column), i,
				   cell_of(row + 1, column), cell_of(row + 2, column)};

		cells[i] = smoothed(across, at);
	}
}

float lp_coarse_median(const float *cells)
{
	float known[LP_COARSE_CELLS];
	int count = 0;

	for (int i = 0; i < LP_COARSE_CELLS; i++)
		if (!isnan(cells[i]))
			known[count++] = cells[i];
	return count ? lp_select(known, count, count / 2) : 0.0F;
}

void lp_coarse_compress(float *cells, float level)
{
	for (int i = 0; i < LP_COARSE_CELLS; i++) {
		const float light = cells[i];

		if (!isnan(light))
			cells[i] = light > 0.0F ? 1.0F / (1.0F + level / light) : 0.0F;
	}
}

bool lp_coarse_look(const float *cells, const double towards[3], double *value, double slope[3])
{
	const double x = towards[0], y = towards[1], z = towards[2];
	const double level2 = fmax(x * x + z * z, 1e-12), level = sqrt(level2);
	const double length2 = level2 + y * y;
	const double column = COLUMNS * (atan2(x, -z) / (2.0 * M_PI) + 0.5) - 0.5;
	const double row = fmin(fmax(ROWS * atan2(level, y) / M_PI - 0.5, 0.0), ROWS - 1.0);
	const int top = row < ROWS - 1 ? (int)row : ROWS - 2, left = (int)floor(column);
	const double down = row - top, right = column - left;
	const double a = cells[cell_of(top, left)], b = cells[cell_of(top, left + 1)];
	const double c = cells[cell_of(top + 1, left)], d = cells[cell_of(top + 1, left + 1)];
	const double upper = a + right * (b - a), lower = c + right * (d - c);

	*value = upper + down * (lower - upper);
	if (isnan(*value))
		return false;
	const double by_turn = (b - a + down * (d - c - b + a)) * COLUMNS / (2.0 * M_PI) / level2;
	const double by_tilt = (lower - upper) * ROWS / M_PI / length2;

	slope[0] = -by_turn * z + by_tilt * y * x / level;
	slope[1] = -by_tilt * level;
	slope[2] = by_turn * x + by_tilt * y * z / level;
	return true;
}

double lp_coarse_project(const struct lp_grid *grid, const float *cells, double *sh)
{
	double sum = 0.0, known_sr = 0.0, basis[COUNT];

	for (int i = 0; i < LP_COARSE_CELLS; i++) {
		if (isnan(cells[i]))
			continue;
		known_sr += lp_grid_solid_angle_sr(grid, i);
		sum += cells[i] * lp_grid_solid_angle_sr(grid, i);
	}
	const double mean = known_sr > 0.0 ? sum / known_sr : 0.0;

	memset(sh, 0, COUNT * sizeof(*sh));
	for (int i = 0; i < LP_COARSE_CELLS; i++) {
		const double light =
			(isnan(cells[i]) ? mean : cells[i]) * lp_grid_solid_angle_sr(grid, i);
		float towards[3];

		lp_grid_direction(grid, i, towards);
		lp_sh_basis(ORDER, (const double[3]){towards[0], towards[1], towards[2]}, basis);
		for (int k = 0; k < COUNT; k++)
			sh[k] += light * basis[k];
	}
	return mean;
}
