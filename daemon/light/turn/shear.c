/* SPDX-License-Identifier: Apache-2.0 */
#include "light/turn/shear.h"

#include <math.h>
#include <stddef.h>

#include "light/math/grid.h"

bool lp_shear_is_none(const struct lp_shear *shear)
{
	const double *t = shear->turn;

	return !shear->row_share || (t[0] == 0.0 && t[1] == 0.0 && t[2] == 0.0);
}

/* Turn by `share` of the read-out's turn. */
static void turn_by(const struct lp_shear *shear, float share, float d[3])
{
	const float t[3] = {share * (float)shear->turn[0], share * (float)shear->turn[1],
			    share * (float)shear->turn[2]};
	const float turned[3] = {d[0] + t[1] * d[2] - t[2] * d[1], d[1] + t[2] * d[0] - t[0] * d[2],
				 d[2] + t[0] * d[1] - t[1] * d[0]};
	const float length =
		sqrtf(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2]);

	for (int a = 0; a < 3; a++)
		d[a] = turned[a] / length;
}

void lp_shear_to_middle(const struct lp_shear *shear, float direction[3])
{
	if (!lp_shear_is_none(shear))
		turn_by(shear, shear->row_share[lp_grid_cell(shear->grid, direction)], direction);
}

void lp_shear_from_middle(const struct lp_shear *shear, float direction[3])
{
	if (!lp_shear_is_none(shear))
		turn_by(shear, -shear->row_share[lp_grid_cell(shear->grid, direction)], direction);
}
