/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/room_worth.h"

#include <math.h>
#include <string.h>

#include "base/select.h"
#include "light/math/sh.h"

#define MOST_PAIRS (LP_ROOM_MOST_VIEWS * (LP_ROOM_MOST_VIEWS - 1) / 2)
/* Places that are nearer to each other tell of noise alone. */
#define LEAST_WAY_M 0.06
/* Of all pairs of pictures this share is no more wrong than is stated: where large lamps are in the
 * light, few tell how wrong it gets. */
#define SHARE 0.9
#define BARE_SHARE 0.7

/* Of pairs of pictures, by the order of the harmonics: errors of light that is moved from one's
 * place to the other's, and of light that stays as it is; for each metre. */
struct errors {
	int count;
	float moved[LP_BOX_ORDERS][MOST_PAIRS], unmoved[LP_BOX_ORDERS][MOST_PAIRS];
};

/* Squared, of the irradiance, mean over all normals (Parseval). */
static double square_of(const double *sh, int order)
{
	double sum = 0.0;

	for (int l = 0; l <= order; l++)
		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			sum += lp_sh_cosine(l) * lp_sh_cosine(l) * sh[i] * sh[i];
	return sum / (4.0 * M_PI);
}

static void add_pair(const struct lp_box_rays *rays,
		     const double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT], double length_m,
		     const struct lp_room_light *here, const struct lp_room_light *there,
		     struct errors *errors)
{
	const double mean = lp_sh_cosine(0) * there->sh[0] / sqrt(4.0 * M_PI);
	double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT], change[LP_BOX_SH_COUNT];

	lp_box_move_sh(rays, seen, here->sh, moved);
	for (int i = 0; i < LP_BOX_SH_COUNT; i++)
		change[i] = here->sh[i] - there->sh[i];
	for (int order = 0; order < LP_BOX_ORDERS; order++) {
		for (int i = 0; i < LP_BOX_SH_COUNT; i++)
			moved[order][i] -= there->sh[i];
		errors->moved[order][errors->count] =
			(float)(sqrt(square_of(moved[order], order)) / mean / length_m);
		errors->unmoved[order][errors->count] =
			(float)(sqrt(square_of(change, order)) / mean / length_m);
	}
	errors->count++;
}

static void conclude(struct errors *errors, double share, double error_per_m[LP_BOX_ORDERS])
{
	const int rank = (int)(share * errors->count), middle = errors->count / 2;

	for (int order = 0; order < LP_BOX_ORDERS; order++) {
		error_per_m[order] = INFINITY;
		if (errors->count == 0)
			continue;
		/* one bad picture, which is in a quarter of the pairs, does not decide */
		if (lp_select(errors->moved[order], errors->count, middle) <
		    lp_select(errors->unmoved[order], errors->count, middle))
			error_per_m[order] = lp_select(errors->moved[order], errors->count, rank);
	}
}

void lp_room_find_errors(const struct lp_box_rays *rays, const struct lp_room_views *views,
			 const struct lp_box *box, double late_s, double error_per_m[LP_BOX_ORDERS],
			 double bare_error_per_m[LP_BOX_ORDERS])
{
	struct errors light = {0}, bare = {0};
	double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT];

	for (int i = 0; i < views->count; i++) {
		const struct lp_room_view *here = &views->list[i];
		struct lp_box around = {.yaw_rad = box->yaw_rad};

		lp_box_walls_from(box, here->position_m, around.wall_m);
		for (int k = i + 1; k < views->count; k++) {
			const struct lp_room_view *there = &views->list[k];
			double way_m[3], length2 = 0.0;

			for (int a = 0; a < 3; a++) {
				way_m[a] =
					there->position_m[a] - here->position_m[a] -
					late_s * (there->velocity_m_s[a] - here->velocity_m_s[a]);
				length2 += way_m[a] * way_m[a];
			}
			if (!(length2 > LEAST_WAY_M * LEAST_WAY_M))
				continue;
			lp_box_look_around(rays, &around, way_m, seen);
			add_pair(rays, (const double(*)[LP_BOX_SH_COUNT])seen, sqrt(length2),
				 &here->light, &there->light, &light);
			add_pair(rays, (const double(*)[LP_BOX_SH_COUNT])seen, sqrt(length2),
				 &here->bare, &there->bare, &bare);
		}
	}
	conclude(&light, SHARE, error_per_m);
	conclude(&bare, BARE_SHARE, bare_error_per_m);
}
