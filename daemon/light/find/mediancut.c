/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/mediancut.h"

#include <math.h>
#include <stdbool.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"

/* Rectangle of the grid: rows [top, bottom), columns [left, right). */
struct part {
	int top, bottom, left, right;
	double flux;
};

static double flux_at(const struct lp_grid *grid, const struct lp_panorama *panorama, int row,
		      int column)
{
	return (double)panorama->cells[row * grid->width + column][LP_LUMINANCE] *
	       grid->row_solid_angle_sr[row];
}

static void measure(const struct lp_grid *grid, const struct lp_panorama *panorama,
		    struct part *part)
{
	part->flux = 0.0;
	for (int r = part->top; r < part->bottom; r++)
		for (int c = part->left; c < part->right; c++)
			part->flux += flux_at(grid, panorama, r, c);
}

/* Halve the light across the longer side; columns count by what they span in the middle row. */
static void cut(const struct lp_grid *grid, const struct lp_panorama *panorama, struct part *part,
		struct part *other)
{
	const float width =
		(float)(part->right - part->left) * grid->row_sin[(part->top + part->bottom) / 2];
	const bool across =
		width > (float)(part->bottom - part->top) && part->right - part->left > 1;
	const int from = across ? part->left : part->top;
	const int to = across ? part->right : part->bottom;
	double sum = 0.0;
	int at = from;

	while (at < to - 1 && (at == from || sum < part->flux / 2.0)) {
		if (across)
			for (int r = part->top; r < part->bottom; r++)
				sum += flux_at(grid, panorama, r, at);
		else
			for (int c = part->left; c < part->right; c++)
				sum += flux_at(grid, panorama, at, c);
		at++;
	}
	*other = *part;
	if (across)
		part->right = other->left = at;
	else
		part->bottom = other->top = at;
	measure(grid, panorama, part);
	measure(grid, panorama, other);
}

static struct lp_lamp lamp_of(const struct lp_grid *grid, const struct lp_panorama *panorama,
			      const struct part *part)
{
	struct lp_lamp lamp = {.direction_sigma_deg = NAN};
	double first[3] = {0.0}, length;

	for (int r = part->top; r < part->bottom; r++)
		for (int c = part->left; c < part->right; c++) {
			const int cell = r * grid->width + c;
			const double flux = flux_at(grid, panorama, r, c);
			float d[3];

			lp_grid_direction(grid, cell, d);
			for (int a = 0; a < 3; a++)
				first[a] += flux * d[a];
			for (int k = 0; k < 4; k++)
				lamp.irradiance[k] +=
					panorama->cells[cell][k] * grid->row_solid_angle_sr[r];
			lamp.solid_angle_sr += grid->row_solid_angle_sr[r];
			lamp.peak = fmaxf(lamp.peak, panorama->cells[cell][LP_LUMINANCE]);
			if (panorama->flags[cell] & LP_CELL_CLIPPED)
				lamp.flags |= LP_LIGHT_CLIPPED;
		}
	length = sqrt(first[0] * first[0] + first[1] * first[1] + first[2] * first[2]);
	for (int a = 0; a < 3; a++)
		lamp.direction[a] = (float)(length > 0.0 ? first[a] / length : a == 1);
	return lamp;
}

void lp_mediancut(struct lp_lamp_finder *finder, const struct lp_panorama *panorama, int count)
{
	const struct lp_grid *grid = finder->grid;
	struct part parts[LP_MAX_LAMPS] = {{0, grid->height, 0, grid->width, 0.0}};
	int have = 1;

	measure(grid, panorama, &parts[0]);
	while (have < count && have < LP_MAX_LAMPS) {
		int most = 0;

		for (int k = 1; k < have; k++)
			if (parts[k].flux > parts[most].flux)
				most = k;
		if ((parts[most].right - parts[most].left) *
			    (parts[most].bottom - parts[most].top) <
		    2)
			break;
		cut(grid, panorama, &parts[most], &parts[have++]);
	}
	finder->count = 0;
	for (int k = 0; k < have; k++) {
		const struct lp_lamp lamp = lamp_of(grid, panorama, &parts[k]);

		if (lamp.irradiance[LP_LUMINANCE] > 0.0F)
			lp_lamp_insert(finder, &lamp);
	}
}
