/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/room.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "light/math/cholesky.h"
#include "light/math/grid.h"
#include "light/math/sh.h"
#include "light/place/parallax.h"

/* Parameters: logarithms of the distances of six walls, the yaw, and how old the light in a
 * picture is (the map of radiance lags behind a probe that goes). */
enum { YAW = 6, LATE = 7, SIZE = 8, SLOPES = 3 };
#define VIEWS 8
#define SH_COUNT 25
/* Chosen by hand (docs/maintainers/constants.md): pictures are taken so far from each other; one
 * that is older is replaced by a new one from the same place. */
#define APART_M 0.08
#define OLD_S 5.0
/* Light that differs by more from that of the nearest picture has changed; and so much more for
 * each metre between them. */
#define MOST_CHANGE 0.1
#define MOST_CHANGE_PER_M 1.0
/* A fit begins with so many pictures, the farthest so far from the middle. */
#define LEAST_VIEWS 4
#define LEAST_REACH_M 0.12
/* The prior: rooms are some metres wide; pictures are this old. 1 sigma. */
#define USUAL_WALL_M 2.0
#define WALL_SIGMA 1.0 /* of the logarithm */
#define LATE_SIGMA_S 0.3
#define YAW_SIGMA_RAD 10.0
/* Pictures differ by this share of their mean luminance even where the box is right (furniture,
 * noise); and neighbouring cells differ alike: a picture is worth so many cells. */
#define MISFIT 0.03
#define WORTH 64.0
/* A cell so many times MISFIT off is an outlier (Huber 1964). */
#define OUTLIER 3.0
/* Yaws from which the fit starts: a box looks the same after a quarter turn. */
#define STARTS 6
#define STEPS_OF_START 4
#define STEPS_OF_FIT 10
#define CONVERGED 1e-3 /* relative change of the cost */
#define MOST_STEP 0.5 /* of a parameter */
#define NEAREST_WALL_M 0.1
/* Of a fit to few pictures what is left over tells too little. */
#define MORE_ERROR 1.5

struct view {
	double t_s;
	double position_m[3], velocity_m_s[3];
	double mean;	     /* luminance */
	double sh[SH_COUNT]; /* of luminance, world */
	float cells[LP_COARSE_CELLS];
};

/* A guess, and what the pictures say of it. */
struct guess {
	double at[SIZE];
	double normal[SIZE][SIZE], right[SIZE];
	double cost;
};

struct lp_room {
	struct lp_grid *grid;
	uint32_t world;
	int count, middle; /* views; the one in the middle */
	struct view views[VIEWS];
	int start, steps; /* of the search: start STARTS, all have been tried */
	double damping;
	struct guess guess, best; /* of this start; of all starts */
	bool is_due;		  /* a step of the fit */
	bool has_converged;
	bool known;
	struct lp_room_found found;
};

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double apart_m(const double a[3], const double b[3])
{
	const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};

	return sqrt(dot(d, d));
}

int lp_room_create(struct lp_room **room)
{
	struct lp_room *r = calloc(1, sizeof(*r));
	int ret;

	if (!r)
		return -ENOMEM;
	ret = lp_grid_create(LP_COARSE_COLUMNS, LP_COARSE_ROWS, &r->grid);
	if (ret < 0) {
		free(r);
		return ret;
	}
	*room = r;
	return 0;
}

void lp_room_destroy(struct lp_room *room)
{
	if (!room)
		return;
	lp_grid_destroy(room->grid);
	free(room);
}

const struct lp_grid *lp_room_grid(const struct lp_room *room)
{
	return room->grid;
}

void lp_room_forget(struct lp_room *room)
{
	room->count = room->start = room->steps = 0;
	room->known = room->is_due = false;
}

/* ---------------------------------------------------------------- pictures */

/* The view nearest to a place; -1: there is none. */
static int nearest(const struct lp_room *r, const double place_m[3])
{
	int at = -1;

	for (int k = 0; k < r->count; k++)
		if (at < 0 || apart_m(r->views[k].position_m, place_m) <
				      apart_m(r->views[at].position_m, place_m))
			at = k;
	return at;
}

bool lp_room_wants(const struct lp_room *room, const struct lp_probe_pose *pose)
{
	const int at = nearest(room, pose->position_m);

	if (at < 0 || room->world != pose->world)
		return true;
	return apart_m(room->views[at].position_m, pose->position_m) > APART_M ||
	       (double)pose->t_ns / 1e9 - room->views[at].t_s > OLD_S;
}

/* Where a new view goes: in place of one that is as near, or, if all are taken, of the oldest. */
static struct view *place_for(struct lp_room *r, const double position_m[3])
{
	const int near = nearest(r, position_m);
	int oldest = 0;

	if (near >= 0 && apart_m(r->views[near].position_m, position_m) <= APART_M)
		return &r->views[near];
	if (r->count < VIEWS)
		return &r->views[r->count++];
	for (int k = 1; k < r->count; k++)
		if (r->views[k].t_s < r->views[oldest].t_s)
			oldest = k;
	return &r->views[oldest];
}

/* The view in the middle of all is the one that the box is hung up on. */
static void find_middle(struct lp_room *r)
{
	double mean_m[3] = {0.0}, wall_m[6];

	for (int k = 0; k < r->count; k++)
		for (int a = 0; a < 3; a++)
			mean_m[a] += r->views[k].position_m[a] / r->count;
	r->middle = nearest(r, mean_m);
	if (r->start < STARTS)
		return;
	struct lp_box box = r->found.box;

	for (int w = 0; w < 6; w++)
		box.wall_m[w] = exp(r->guess.at[w]);
	lp_box_walls_from(&box, r->views[r->middle].position_m, wall_m);
	for (int w = 0; w < 6; w++)
		r->guess.at[w] = log(fmax(wall_m[w], NEAREST_WALL_M));
	memcpy(r->found.box.origin_m, r->views[r->middle].position_m,
	       sizeof(r->found.box.origin_m));
}

static bool has_changed(const struct view *before, const struct view *now)
{
	return fabs(log(now->mean / before->mean)) >
	       MOST_CHANGE + MOST_CHANGE_PER_M * apart_m(before->position_m, now->position_m);
}

void lp_room_see(struct lp_room *room, const struct lp_probe_pose *pose, const float *cells)
{
	struct view seen = {.t_s = (double)pose->t_ns / 1e9};

	memcpy(seen.position_m, pose->position_m, sizeof(seen.position_m));
	memcpy(seen.velocity_m_s, pose->velocity_m_s, sizeof(seen.velocity_m_s));
	memcpy(seen.cells, cells, sizeof(seen.cells));
	lp_coarse_blur(seen.cells);
	seen.mean = lp_coarse_project(room->grid, seen.cells, seen.sh);
	if (!(seen.mean > 0.0) || !isfinite(seen.mean))
		return;
	if (room->world != pose->world)
		lp_room_forget(room);
	room->world = pose->world;
	const int near = nearest(room, pose->position_m);

	/* the box is as it was: its light is another */
	if (near >= 0 && has_changed(&room->views[near], &seen))
		room->count = 0;
	*place_for(room, pose->position_m) = seen;
	find_middle(room);
	room->is_due = true;
	if (room->start == STARTS) {
		room->steps = 0;
		room->guess.cost = INFINITY; /* of other pictures */
	}
}

/* ---------------------------------------------------------------- the fit */

static struct lp_box box_of(const double at[SIZE])
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
static bool compare(const struct view *middle, const struct lp_box_view *box,
		    const double velocity[3], const double along[3], float cell, double *off,
		    struct slope *slope)
{
	const struct lp_box_hit hit = lp_box_hit(box, along);
	double value, by[3];

	if (isnan(cell) || !lp_coarse_look(middle->cells, hit.at_m, &value, by))
		return false;
	/* the hit moves along the ray; each slope is how far */
	const double by_way = dot(by, along) / hit.cosine;
	const double aside = hit.normal[0] * hit.at_m[2] - hit.normal[2] * hit.at_m[0];

	*off = value / middle->mean - (double)cell / middle->mean;
	slope->of[0] = hit.wall;
	slope->of[1] = YAW;
	slope->of[2] = LATE;
	slope->by[0] = by_way * box->box.wall_m[hit.wall] / middle->mean;
	slope->by[1] = by_way * aside / middle->mean;
	slope->by[2] = (by_way * dot(hit.normal, velocity) - dot(by, velocity)) / middle->mean;
	return true;
}

static void add_cell(struct guess *g, double off, const struct slope *slope, double weight)
{
	const double size = fabs(off) / (OUTLIER * MISFIT);
	const double pull = weight / fmax(size, 1.0);

	g->cost += weight * OUTLIER * OUTLIER * MISFIT * MISFIT *
		   (size > 1.0 ? 2.0 * size - 1.0 : size * size);
	for (int i = 0; i < SLOPES; i++) {
		const int a = slope->of[i];

		g->right[a] -= pull * slope->by[i] * off;
		for (int j = 0; j < SLOPES; j++)
			g->normal[a][slope->of[j]] += pull * slope->by[i] * slope->by[j];
	}
}

static void add_view(const struct lp_room *r, const struct view *view, struct guess *g)
{
	const struct view *middle = &r->views[r->middle];
	const struct lp_box box = box_of(g->at);
	double from_m[3], velocity[3], off;
	struct slope slope;

	for (int a = 0; a < 3; a++) {
		velocity[a] = view->velocity_m_s[a] - middle->velocity_m_s[a];
		from_m[a] = view->position_m[a] - middle->position_m[a] - g->at[LATE] * velocity[a];
	}
	const struct lp_box_view seen = lp_box_look(&box, from_m);
	const double weight = WORTH / (4.0 * M_PI * MISFIT * MISFIT);

	for (int row = 0; row < LP_COARSE_ROWS; row++) {
		/* columns crowd towards the poles */
		const int step = (int)fmin(1.0F / r->grid->row_sin[row], 8.0F);

		for (int column = 0; column < LP_COARSE_COLUMNS; column += step) {
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

static void weigh(const struct lp_room *r, struct guess *g)
{
	static const double sigma[SIZE] = {WALL_SIGMA, WALL_SIGMA, WALL_SIGMA,	  WALL_SIGMA,
					   WALL_SIGMA, WALL_SIGMA, YAW_SIGMA_RAD, LATE_SIGMA_S};

	memset(g->normal, 0, sizeof(g->normal));
	memset(g->right, 0, sizeof(g->right));
	g->cost = 0.0;
	for (int a = 0; a < SIZE; a++) {
		const double off = g->at[a] - (a < YAW ? log(USUAL_WALL_M) : 0.0);
		const double information = 1.0 / (sigma[a] * sigma[a]);

		g->normal[a][a] = information;
		g->right[a] = -information * off;
		g->cost += information * off * off;
	}
	for (int k = 0; k < r->count; k++)
		if (k != r->middle)
			add_view(r, &r->views[k], g);
}

/* The guess, a step on (Levenberg-Marquardt): the better of both stays. */
static void step(struct lp_room *r)
{
	struct guess next = r->guess;
	double damped[SIZE][SIZE], by[SIZE];

	memcpy(damped, next.normal, sizeof(damped));
	for (int a = 0; a < SIZE; a++)
		damped[a][a] *= 1.0 + r->damping;
	if (!lp_cholesky_solve(SIZE, damped[0], next.right, by))
		return;
	for (int a = 0; a < SIZE; a++)
		next.at[a] += fmin(fmax(by[a], -MOST_STEP), MOST_STEP);
	weigh(r, &next);
	if (next.cost <= r->guess.cost) {
		r->has_converged = r->guess.cost - next.cost < CONVERGED * next.cost;
		r->guess = next;
		r->damping *= 0.3;
	} else {
		r->damping = fmax(r->damping, 1e-3) * 10.0;
	}
}

static void begin(struct lp_room *r)
{
	memset(&r->guess, 0, sizeof(r->guess));
	for (int w = 0; w < 6; w++)
		r->guess.at[w] = log(USUAL_WALL_M);
	r->guess.at[YAW] = M_PI / 2.0 / STARTS * (r->start - STARTS / 2);
	r->damping = 1e-3;
	r->steps = 0;
	weigh(r, &r->guess);
}

/* ---------------------------------------------------------------- what it is worth */

/* Squared, of the irradiance, mean over all normals (Parseval). */
static double square_of(const double *sh, int order)
{
	double sum = 0.0;

	for (int l = 0; l <= order; l++)
		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			sum += lp_sh_cosine(l) * lp_sh_cosine(l) * sh[i] * sh[i];
	return sum / (4.0 * M_PI);
}

/* How wrong the light at the places of the views is, if the middle one is moved there as spherical
 * harmonics of this order; INFINITY: no less than if it is not moved. */
static double error_per_m(const struct lp_room *r, int order)
{
	const struct view *middle = &r->views[r->middle];
	const double mean = lp_sh_cosine(0) * middle->sh[0] / sqrt(4.0 * M_PI);
	double way2 = 0.0, error2 = 0.0, unmoved2 = 0.0, moved[SH_COUNT], change[SH_COUNT];

	for (int k = 0; k < r->count; k++) {
		const struct view *view = &r->views[k];
		double from_m[3];

		for (int a = 0; a < 3; a++)
			from_m[a] = view->position_m[a] - middle->position_m[a] -
				    r->guess.at[LATE] *
					    (view->velocity_m_s[a] - middle->velocity_m_s[a]);
		lp_box_move_sh(&r->found.box, from_m, order, middle->sh, moved);
		for (int i = 0; i < (order + 1) * (order + 1); i++) {
			moved[i] -= view->sh[i];
			change[i] = middle->sh[i] - view->sh[i];
		}
		way2 += dot(from_m, from_m);
		error2 += square_of(moved, order);
		unmoved2 += square_of(change, order);
	}
	if (!(error2 < unmoved2))
		return INFINITY;
	return MORE_ERROR * sqrt(error2 / way2) / mean;
}

static void conclude(struct lp_room *r)
{
	const double origin[3] = {r->views[r->middle].position_m[0],
				  r->views[r->middle].position_m[1],
				  r->views[r->middle].position_m[2]};
	const double scatter = fmax(r->guess.cost / (WORTH * (r->count - 1)), 1.0);
	double of[SIZE], by[SIZE];

	r->found.box = box_of(r->guess.at);
	memcpy(r->found.box.origin_m, origin, sizeof(origin));
	for (int w = 0; w < 6; w++) {
		memset(of, 0, sizeof(of));
		of[w] = 1.0;
		if (!lp_cholesky_solve(SIZE, r->guess.normal[0], of, by))
			return;
		r->found.wall_sigma_m[w] = r->found.box.wall_m[w] * sqrt(scatter * by[w]);
	}
	for (int order = 0; order < LP_ROOM_ORDERS; order++)
		r->found.error_per_m[order] = error_per_m(r, order);
	r->known = isfinite(r->found.error_per_m[LP_ROOM_ORDERS - 1]);
}

static bool reaches(const struct lp_room *r)
{
	for (int k = 0; k < r->count && r->count >= LEAST_VIEWS; k++)
		if (apart_m(r->views[k].position_m, r->views[r->middle].position_m) >=
		    LEAST_REACH_M)
			return true;
	return false;
}

static void next_start(struct lp_room *r)
{
	if (r->start == 0 || r->guess.cost < r->best.cost)
		r->best = r->guess;
	r->start++;
	if (r->start == STARTS)
		r->guess = r->best;
	r->steps = 0;
}

void lp_room_work(struct lp_room *room)
{
	if (!room->is_due || !reaches(room))
		return;
	if (room->steps == 0 && room->start < STARTS)
		begin(room);
	else if (isinf(room->guess.cost))
		weigh(room, &room->guess);
	room->has_converged = false;
	step(room);
	room->steps++;
	if (room->start < STARTS && room->steps == STEPS_OF_START)
		next_start(room);
	else if (room->start == STARTS && (room->has_converged || room->steps >= STEPS_OF_FIT)) {
		conclude(room);
		room->is_due = false;
		if (!room->known)
			room->start = room->steps = 0; /* again, with the next picture */
	}
}

bool lp_room_found(const struct lp_room *room, const struct lp_probe_pose *pose,
		   struct lp_room_found *found)
{
	double wall_m[6];

	if (!room->known || room->world != pose->world)
		return false;
	*found = room->found;
	lp_box_walls_from(&room->found.box, pose->position_m, wall_m);
	memcpy(found->box.origin_m, pose->position_m, sizeof(found->box.origin_m));
	memcpy(found->box.wall_m, wall_m, sizeof(wall_m));
	for (int w = 0; w < 6; w++)
		if (!(wall_m[w] > 0.0))
			return false;
	return true;
}
