/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/room_fit.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "light/linear/cholesky.h"
#include "light/linear/vector.h"
#include "light/math/grid.h"

enum { YAW = LP_ROOM_YAW, LATE = LP_ROOM_LATE, SIZE = LP_ROOM_SIZE, SLOPES = 3 };
/* The prior: rooms are some metres wide; pictures are this old. 1 sigma. */
#define WALL_SIGMA 1.0 /* of the logarithm */
#define LATE_SIGMA_S 0.3
#define YAW_SIGMA_RAD 10.0
/* Pictures differ by so much of full scale even where the box is right: furniture, noise. */
#define MISFIT 0.008
/* A cell so many times MISFIT off is an outlier (Huber 1964). */
#define OUTLIER 3.0
#define MOST_STEP 0.5 /* of a parameter */
/* How the damping of steps changes after good and bad ones. */
#define LEAST_DAMPING 1e-3
#define LESS_DAMPING 0.3
#define MORE_DAMPING 10.0

struct lp_box lp_room_box(const double at[SIZE])
{
	struct lp_box box = {.yaw_rad = at[YAW]};

	for (int w = 0; w < 6; w++)
		box.wall_m[w] = exp(at[w]);
	return box;
}

/* By how much a difference grows with each of the few parameters that a cell depends on. */
struct slope {
	int of[SLOPES];
	double by[SLOPES];
};

/* One cell of a view against the middle one as the box shows it from there: the difference, and its
 * slopes. False: not known. */
static bool compare(const struct lp_room_view *middle, const struct lp_box_view *box,
		    const double velocity[3], const double along[3], float cell, double *off,
		    struct slope *slope)
{
	const struct lp_box_hit hit = lp_box_hit(box, along);
	double value, by[3];

	if (isnan(cell) || !lp_coarse_look(middle->cells, hit.at_m, &value, by))
		return false;
	/* the hit moves along the ray; each slope is how far */
	const double by_way = lp_dot(by, along) / hit.cosine;
	const double aside = hit.normal[0] * hit.at_m[2] - hit.normal[2] * hit.at_m[0];

	*off = value - (double)cell;
	slope->of[0] = hit.wall;
	slope->of[1] = YAW;
	slope->of[2] = LATE;
	slope->by[0] = by_way * box->box.wall_m[hit.wall];
	slope->by[1] = by_way * aside;
	slope->by[2] = (by_way * lp_dot(hit.normal, velocity) - lp_dot(by, velocity));
	return true;
}

static void add_cell(struct lp_room_guess *g, double off, const struct slope *slope, double weight)
{
	const double size = fabs(off) / (OUTLIER * MISFIT);
	const double pull = weight / fmax(size, 1.0);

	g->worth += weight * MISFIT * MISFIT;
	g->cost += weight * OUTLIER * OUTLIER * MISFIT * MISFIT *
		   (size > 1.0 ? 2.0 * size - 1.0 : size * size);
	for (int i = 0; i < SLOPES; i++) {
		const int a = slope->of[i];

		g->right[a] -= pull * slope->by[i] * off;
		for (int j = 0; j < SLOPES; j++)
			g->normal[a][slope->of[j]] += pull * slope->by[i] * slope->by[j];
	}
}

static void add_view(const struct lp_room_views *r, const struct lp_room_view *view,
		     struct lp_room_guess *g)
{
	const struct lp_room_view *middle = &r->list[r->middle];
	const struct lp_box box = lp_room_box(g->at);
	double from_m[3], velocity[3], off;
	struct slope slope;

	for (int a = 0; a < 3; a++) {
		velocity[a] = view->velocity_m_s[a] - middle->velocity_m_s[a];
		from_m[a] = view->position_m[a] - middle->position_m[a] - g->at[LATE] * velocity[a];
	}
	const struct lp_box_view seen = lp_box_look(&box, from_m);
	const double weight = LP_ROOM_WORTH / (4.0 * M_PI * MISFIT * MISFIT);

	for (int row = 0; row < LP_COARSE_ROWS; row++) {
		/* Columns crowd towards the poles. Every second cell serves: pictures are blurred.
		 */
		const int step = 2 * (int)fmin(1.0F / r->grid->row_sin[row], 8.0F);

		for (int column = row % 2; column < LP_COARSE_COLUMNS; column += step) {
			const int cell = row * LP_COARSE_COLUMNS + column;
			float towards[3];

			lp_grid_direction(r->grid, cell, towards);
			const double along[3] = {towards[0], towards[1], towards[2]};

			if (compare(middle, &seen, velocity, along, view->cells[cell], &off,
				    &slope))
				add_cell(g, off, &slope,
					 weight * step * r->grid->row_solid_angle_sr[row]);
		}
	}
}

void lp_room_weigh(const struct lp_room_views *r, struct lp_room_guess *g)
{
	static const double sigma[SIZE] = {WALL_SIGMA, WALL_SIGMA, WALL_SIGMA,	  WALL_SIGMA,
					   WALL_SIGMA, WALL_SIGMA, YAW_SIGMA_RAD, LATE_SIGMA_S};

	memset(g->normal, 0, sizeof(g->normal));
	memset(g->right, 0, sizeof(g->right));
	g->cost = g->worth = 0.0;
	for (int a = 0; a < SIZE; a++) {
		const double off = g->at[a] - (a < YAW ? log(LP_ROOM_USUAL_WALL_M) : 0.0);
		const double information = 1.0 / (sigma[a] * sigma[a]);

		g->normal[a][a] = information;
		g->right[a] = -information * off;
		g->cost += information * off * off;
	}
	for (int k = 0; k < r->count; k++)
		if (k != r->middle)
			add_view(r, &r->list[k], g);
}

double lp_room_step(const struct lp_room_views *r, struct lp_room_guess *g)
{
	struct lp_room_guess next = *g;
	double damped[SIZE][SIZE], by[SIZE];

	memcpy(damped, next.normal, sizeof(damped));
	for (int a = 0; a < SIZE; a++)
		damped[a][a] *= 1.0 + fmax(g->damping, LEAST_DAMPING);
	if (!lp_cholesky_solve(SIZE, damped[0], next.right, by))
		return 0.0;
	for (int a = 0; a < SIZE; a++)
		next.at[a] += fmin(fmax(by[a], -MOST_STEP), MOST_STEP);
	lp_room_weigh(r, &next);
	if (!(next.cost <= g->cost)) {
		g->damping = fmax(g->damping, LEAST_DAMPING) * MORE_DAMPING;
		return INFINITY;
	}
	const double gained = (g->cost - next.cost) / fmax(next.cost, 1e-300);

	next.damping = g->damping * LESS_DAMPING;
	*g = next;
	return gained;
}
