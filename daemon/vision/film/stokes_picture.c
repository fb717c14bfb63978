/* SPDX-License-Identifier: Apache-2.0 */
/* A coarse picture of how light is polarized, for clients. */
#include <math.h>
#include <string.h>

#include "base/half.h"
#include "include/polarization_grid.h"
#include "light/math/grid.h"
#include "vision/film/stokes_map.h"

/* A cell of the picture is the mean of so many looks along and across. */
#define LOOKS 2
/* S0 is at most so many times the brightest reading: what remains of half floats' range is below.
 */
#define S0_RANGE 32768.0F

/* Sums over the looks of one cell, weighed by S0. */
struct sum {
	int known;
	float s0, q, u, variance;
};

/* What the map knows along a direction of the picture's frame, in that frame. */
static void look(const struct lp_stokes_map *map, const struct lp_rotation *to_map,
		 const struct lp_rotation *back, const float direction[3], struct sum *sum)
{
	float in_map[3];

	memcpy(in_map, direction, sizeof(in_map));
	lp_rotate_direction(to_map, in_map);
	const struct lp_polarization p =
		lp_stokes_polarization(&map->cells[lp_grid_cell(map->grid, in_map)]);

	if (isnan(p.s0))
		return;
	const float turn = 2.0F * lp_stokes_frame_turn(back, in_map);

	sum->known++;
	sum->s0 += p.s0;
	sum->q += p.s0 * (cosf(turn) * p.q + sinf(turn) * p.u);
	sum->u += p.s0 * (cosf(turn) * p.u - sinf(turn) * p.q);
	sum->variance += p.s0 * (p.qq + p.uu) / 2.0F;
}

/* As include/panorama.h places cells. */
static void direction_of(float column, float row, float direction[3])
{
	const float polar = (float)M_PI * row / LP_POLARIZATION_HEIGHT;
	const float longitude = 2.0F * (float)M_PI * (column / LP_POLARIZATION_WIDTH - 0.5F);

	direction[0] = sinf(polar) * sinf(longitude);
	direction[1] = cosf(polar);
	direction[2] = -sinf(polar) * cosf(longitude);
}

static float brightest(const struct lp_stokes_map *map)
{
	float most = 0.0F;

	for (int i = 0; i < map->grid->width * map->grid->height; i++)
		most = fmaxf(most, map->cells[i].scale);
	return most;
}

static void store(const struct sum *sum, float s0_unit, uint16_t cell[4])
{
	for (int k = 0; k < 4; k++)
		cell[k] = LP_HALF_NAN;
	if (2 * sum->known < LOOKS * LOOKS)
		return;
	cell[0] = lp_half(sum->s0 / (float)sum->known / s0_unit);
	cell[1] = lp_half(sum->q / sum->s0);
	cell[2] = lp_half(sum->u / sum->s0);
	/* Neighbours share their errors, such as that of the film's angle: sigmas do not shrink. */
	cell[3] = lp_half(sqrtf(sum->variance / sum->s0));
}

void lp_stokes_map_picture(const struct lp_stokes_map *map, const struct lp_rotation *to_map,
			   struct lp_polarization_grid *picture)
{
	const struct lp_rotation back = lp_rotation_inverse(to_map);
	const float most = brightest(map);

	picture->s0_unit = most > 0.0F ? most / S0_RANGE : 1.0F;
	for (int i = 0; i < LP_POLARIZATION_CELLS; i++) {
		const int row = i / LP_POLARIZATION_WIDTH, column = i % LP_POLARIZATION_WIDTH;
		struct sum sum = {0};

		for (int k = 0; k < LOOKS * LOOKS; k++) {
			const float x = ((float)(k % LOOKS) + 0.5F) / LOOKS;
			const float y = ((float)(k / LOOKS) + 0.5F) / LOOKS;
			float direction[3];

			direction_of((float)column + x, (float)row + y, direction);
			look(map, to_map, &back, direction, &sum);
		}
		store(&sum, picture->s0_unit, picture->cells[i]);
	}
}
