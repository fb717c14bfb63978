/* SPDX-License-Identifier: Apache-2.0 */
/* The film's surfaces take light off its axis, and what its angles tell is freed of that by where
 * the wheel says it stands. A film that has been put in a quarter turn wrong makes all light seem
 * polarized, around its axis, as lp_film_turned() says. Nothing in a room looks so on all sides. */
#include "light/math/grid.h"
#include "vision/film/stokes_map.h"

#define QUARTERS 4
/* Chosen by hand (docs/maintainers/constants.md): squared DoLP from which on a cell tells, 0.05;
 * and the share of what a turned film would show. */
#define LEAST_DOLP2 0.0025F
#define LEAST_SHARE 0.5F
#define MOST_SHARE 1.5F

struct quarter {
	float seen, expected; /* along what is expected: sums of products and of squares */
	int count;
};

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static struct quarter *quarter_of(struct quarter quarters[QUARTERS],
				  const struct lp_film_view *view, const float direction[3])
{
	const float *n = view->normal[0], *a = view->across[0];
	const float axis[3] = {n[1] * a[2] - n[2] * a[1], n[2] * a[0] - n[0] * a[2],
			       n[0] * a[1] - n[1] * a[0]};

	return &quarters[2 * (dot(a, direction) > 0.0F) + (dot(axis, direction) > 0.0F)];
}

static void add(struct quarter quarters[QUARTERS], const struct lp_stokes_map *map, int cell)
{
	const struct lp_polarization p = lp_stokes_polarization(&map->cells[cell]);
	float direction[3], seeming[2];

	if (!p.known)
		return;
	lp_grid_direction(map->grid, cell, direction);
	lp_film_turned(&map->view, direction, seeming);
	const float dolp2 = seeming[0] * seeming[0] + seeming[1] * seeming[1];
	struct quarter *quarter = quarter_of(quarters, &map->view, direction);

	if (dolp2 < LEAST_DOLP2)
		return;
	quarter->seen += p.q * seeming[0] + p.u * seeming[1];
	quarter->expected += dolp2;
	quarter->count++;
}

bool lp_stokes_map_surfaces_seem_turned(const struct lp_stokes_map *map)
{
	const struct lp_grid *grid = map->grid;
	struct quarter quarters[QUARTERS] = {0};
	bool turned = true;

	for (int row = 0; row < grid->height; row += LP_STOKES_ROW_STEP)
		for (int column = 0; column < grid->width; column += LP_STOKES_COLUMN_STEP)
			add(quarters, map, row * grid->width + column);
	for (int k = 0; k < QUARTERS; k++) {
		const struct quarter *q = &quarters[k];

		turned = turned && q->count >= LP_STOKES_LEAST_CELLS &&
			 q->seen > LEAST_SHARE * q->expected && q->seen < MOST_SHARE * q->expected;
	}
	return turned;
}
