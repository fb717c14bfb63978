/* SPDX-License-Identifier: Apache-2.0 */
/* Floors and tables polarize what they mirror level. Where everything below the horizon is
 * polarized upright, it is the film that has been put in a quarter turn wrong. Then its surfaces,
 * too, make light seem polarized; that is taken out first. */
#include <math.h>

#include "light/math/grid.h"
#include "vision/film/stokes_map.h"

/* Chosen by hand (docs/maintainers/constants.md). */
/* What is looked at below the horizon, and above it: sines of 15 and 60 degrees. Floors polarize
 * most in between, and the film is not seen edge-on. */
#define LEAST_SINE 0.26F
#define MOST_SINE 0.87F
#define SECTORS 12
/* S1/S0 of a sector that tells: upright below the first, level above the second. */
#define UPRIGHT (-0.02F)
#define LEVEL 0.01F
/* Of what S1/S0 below is: more of S2/S0, or of polarization above the horizon, is no floor. */
#define MOST_OTHER 0.5F
#define LEAST_SECTORS 3
#define LEAST_SHARE 0.75F

struct half {
	float q, u; /* sums */
	int count;
};

struct sector {
	struct half below, above;
};

static void add(struct sector sectors[SECTORS], const struct lp_stokes_map *map, int row,
		int column)
{
	const struct lp_grid *grid = map->grid;
	const float sine = grid->row_cos[row];
	struct sector *sector = &sectors[column * SECTORS / grid->width];
	struct half *half = sine < 0.0F ? &sector->below : &sector->above;
	const struct lp_polarization p =
		lp_stokes_polarization(&map->cells[row * grid->width + column]);

	float direction[3], seeming[2];

	if (!p.known)
		return;
	lp_grid_direction(grid, row * grid->width + column, direction);
	lp_film_turned(&map->view, direction, seeming);
	half->q += p.q - seeming[0];
	half->u += p.u - seeming[1];
	half->count++;
}

/* -1: upright; 1: level; 0: neither. */
static int leaning(const struct sector *s)
{
	const float q = s->below.q / (float)s->below.count, u = s->below.u / (float)s->below.count;
	const float above = hypotf(s->above.q, s->above.u) / (float)s->above.count;

	if (q > LEVEL)
		return 1;
	return q < UPRIGHT && fmaxf(fabsf(u), above) < MOST_OTHER * -q ? -1 : 0;
}

bool lp_stokes_map_floor_is_upright(const struct lp_stokes_map *map)
{
	const struct lp_grid *grid = map->grid;
	struct sector sectors[SECTORS] = {0};
	int known = 0, upright = 0, level = 0;

	for (int row = 0; row < grid->height; row += LP_STOKES_ROW_STEP) {
		const float sine = fabsf(grid->row_cos[row]);

		for (int column = 0; column < grid->width; column += LP_STOKES_COLUMN_STEP)
			if (sine > LEAST_SINE && sine < MOST_SINE)
				add(sectors, map, row, column);
	}
	for (int k = 0; k < SECTORS; k++) {
		const struct sector *s = &sectors[k];

		if (s->below.count < LP_STOKES_LEAST_CELLS ||
		    s->above.count < LP_STOKES_LEAST_CELLS)
			continue;
		known++;
		upright += leaning(s) < 0;
		level += leaning(s) > 0;
	}
	return known >= LEAST_SECTORS && !level && (float)upright >= LEAST_SHARE * (float)known;
}
