/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/box.h"

#include <math.h>
#include <string.h>

#include "light/linear/vector.h"
#include "light/math/sh.h"

#define MOST_ORDER (LP_BOX_ORDERS - 1)
/* No place counts that is nearer to a wall: as in the clients (docs/users/conventions.md). */
#define FARTHEST 0.95
#define LEAST_COSINE 1e-9

/* The axes of the box, in the world. */
static void axes_of(const struct lp_box *box, double axes[3][3])
{
	const double c = cos(box->yaw_rad), s = sin(box->yaw_rad);

	axes[0][0] = c, axes[0][1] = 0.0, axes[0][2] = -s;
	axes[1][0] = 0.0, axes[1][1] = 1.0, axes[1][2] = 0.0;
	axes[2][0] = s, axes[2][1] = 0.0, axes[2][2] = c;
}

struct lp_box_view lp_box_look(const struct lp_box *box, const double from_m[3])
{
	struct lp_box_view view = {.box = *box};

	axes_of(box, view.axes);
	for (int i = 0; i < 3; i++) {
		/* an origin that is behind a wall counts as in it */
		const double below_m = fmax(box->wall_m[2 * i], 0.0);
		const double above_m = fmax(box->wall_m[2 * i + 1], 0.0);
		const double own_m = fmin(fmax(lp_dot(view.axes[i], from_m), -FARTHEST * below_m),
					  FARTHEST * above_m);

		view.left_m[2 * i] = below_m + own_m;
		view.left_m[2 * i + 1] = above_m - own_m;
		for (int a = 0; a < 3; a++)
			view.from_m[a] += own_m * view.axes[i][a];
	}
	return view;
}

struct lp_box_hit lp_box_hit(const struct lp_box_view *view, const double along[3])
{
	const double c = view->axes[0][0], s = view->axes[2][0]; /* upright: along its axes */
	const double towards[3] = {c * along[0] - s * along[2], along[1],
				   s * along[0] + c * along[2]};
	struct lp_box_hit hit = {0};
	double way_m = INFINITY;

	for (int i = 0; i < 3; i++) {
		const int wall = 2 * i + (towards[i] > 0.0);
		const double cosine = fmax(fabs(towards[i]), LEAST_COSINE);

		if (view->left_m[wall] < way_m * cosine) {
			way_m = view->left_m[wall] / cosine;
			hit.wall = wall;
			hit.cosine = cosine;
		}
	}
	for (int a = 0; a < 3; a++) {
		const double axis = view->axes[hit.wall / 2][a];

		hit.normal[a] = hit.wall & 1 ? axis : -axis;
		hit.at_m[a] = view->from_m[a] + way_m * along[a];
	}
	return hit;
}

void lp_box_walls_from(const struct lp_box *box, const double place_m[3], double wall_m[6])
{
	double axes[3][3], from[3];

	axes_of(box, axes);
	for (int a = 0; a < 3; a++)
		from[a] = place_m[a] - box->origin_m[a];
	for (int wall = 0; wall < 6; wall++)
		wall_m[wall] =
			box->wall_m[wall] + (wall & 1 ? -1.0 : 1.0) * lp_dot(axes[wall / 2], from);
}

/* What is seen along a direction, against what is seen along it from the box's origin. */
static void add_change(const double here[LP_BOX_SH_COUNT], const double there[LP_BOX_SH_COUNT],
		       const double sh[LP_BOX_SH_COUNT],
		       double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT])
{
	double change = 0.0;

	for (int order = 0; order < LP_BOX_ORDERS; order++) {
		const int count = (order + 1) * (order + 1);

		for (int i = order * order; i < count; i++)
			change += sh[i] * (there[i] - here[i]);
		for (int i = 0; i < count; i++)
			moved[order][i] += 4.0 * M_PI / LP_BOX_RAYS * change * here[i];
	}
}

void lp_box_fill_rays(struct lp_box_rays *rays)
{
	for (int k = 0; k < LP_BOX_RAYS; k++) {
		const double y = 1.0 - 2.0 * (k + 0.5) / LP_BOX_RAYS;
		const double turn = M_PI * (1.0 + sqrt(5.0)) * (k + 0.5);
		const double level = sqrt(1.0 - y * y);

		rays->along[k][0] = level * cos(turn);
		rays->along[k][1] = y;
		rays->along[k][2] = level * sin(turn);
		lp_sh_basis(MOST_ORDER, rays->along[k], rays->basis[k]);
	}
}

void lp_box_look_around(const struct lp_box_rays *rays, const struct lp_box *box,
			const double from_m[3], double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT])
{
	const struct lp_box_view view = lp_box_look(box, from_m);
	double towards[3];

	for (int k = 0; k < LP_BOX_RAYS; k++) {
		const struct lp_box_hit hit = lp_box_hit(&view, rays->along[k]);
		const double far_m = sqrt(lp_dot(hit.at_m, hit.at_m));

		for (int a = 0; a < 3; a++)
			/* of a place where the origin is, too, the light comes from ahead */
			towards[a] = far_m > 0.0 ? hit.at_m[a] / far_m : rays->along[k][a];
		lp_sh_basis(MOST_ORDER, towards, seen[k]);
	}
}

void lp_box_move_sh(const struct lp_box_rays *rays, const double seen[LP_BOX_RAYS][LP_BOX_SH_COUNT],
		    const double sh[LP_BOX_SH_COUNT], double moved[LP_BOX_ORDERS][LP_BOX_SH_COUNT])
{
	for (int order = 0; order < LP_BOX_ORDERS; order++)
		memcpy(moved[order], sh, LP_BOX_SH_COUNT * sizeof(*sh));
	for (int k = 0; k < LP_BOX_RAYS; k++)
		add_change(rays->basis[k], seen[k], sh, moved);
}
