/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/room.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "light/linear/cholesky.h"
#include "light/linear/vector.h"
#include "light/math/grid.h"
#include "light/place/parallax.h"
#include "light/place/room_fit.h"
#include "light/place/room_worth.h"

/* Chosen by hand (docs/maintainers/constants.md): pictures are taken so far from each other; one
 * that is older is replaced by a new one from the same place. */
#define APART_M 0.08
#define OLD_S 5.0
/* Light that differs by more from that of another picture has changed; and so much more for each
 * metre between them. */
#define MOST_CHANGE 0.1
#define MOST_CHANGE_PER_M 1.0
/* A fit begins with so many pictures, the farthest so far from the middle. */
#define LEAST_VIEWS 4
#define LEAST_REACH_M 0.12
/* Yaws from which the search starts: a box looks the same after a quarter turn. */
#define STARTS 6
#define STEPS_OF_START 6
/* Once there is a guess, one step of so many is another start's. */
#define CHALLENGE_EVERY 4
#define CONVERGED 1e-3 /* relative change of the cost */
#define NEAREST_WALL_M 0.1

/* One way to a guess. */
struct search {
	struct lp_room_guess guess;
	int steps;	 /* taken; 0: it has not begun */
	bool is_weighed; /* against these views */
	bool is_over;	 /* on these views */
};

struct lp_room {
	struct lp_box_rays rays;
	struct lp_grid *grid; /* of the views */
	uint32_t world;
	struct lp_room_views views;
	float level;		  /* luminance that lp_coarse_compress() makes 0.5 */
	struct search best;	  /* the guess that counts */
	struct search challenger; /* from another start */
	int start;		  /* of the challenger */
	int starts_left;	  /* until all have been tried on these views */
	unsigned calls;		  /* of lp_room_work() */
	bool known;
	struct lp_room_found found;
};

static double apart_m(const double a[3], const double b[3])
{
	const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};

	return sqrt(lp_dot(d, d));
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
	r->views.grid = r->grid;
	lp_box_fill_rays(&r->rays);
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

static void forget(struct lp_room *room)
{
	room->views.count = 0;
	room->best = room->challenger = (struct search){0};
	room->known = false;
}

/* ---------------------------------------------------------------- pictures */

/* The view nearest to a place; -1: there is none. */
static int nearest(const struct lp_room_views *views, const double place_m[3])
{
	double least_m = INFINITY;
	int found = -1;

	for (int k = 0; k < views->count; k++) {
		const double away_m = apart_m(views->list[k].position_m, place_m);

		if (away_m < least_m) {
			least_m = away_m;
			found = k;
		}
	}
	return found;
}

bool lp_room_wants(const struct lp_room *room, const struct lp_probe_pose *pose)
{
	const int at = nearest(&room->views, pose->position_m);

	if (!lp_probe_pose_is_sane(pose))
		return false;
	if (at < 0 || room->world != pose->world)
		return true;
	const struct lp_room_view *near = &room->views.list[at];

	return apart_m(near->position_m, pose->position_m) > APART_M ||
	       (double)pose->t_ns / 1e9 - near->t_s > OLD_S;
}

/* Where a new view goes: in place of one that is as near, or, if all are taken, of the oldest. */
static struct lp_room_view *place_for(struct lp_room_views *views, const double position_m[3])
{
	const int near = nearest(views, position_m);
	int oldest = 0;

	if (near >= 0 && apart_m(views->list[near].position_m, position_m) <= APART_M)
		return &views->list[near];
	if (views->count < LP_ROOM_MOST_VIEWS)
		return &views->list[views->count++];
	for (int k = 1; k < views->count; k++)
		if (views->list[k].t_s < views->list[oldest].t_s)
			oldest = k;
	return &views->list[oldest];
}

static void move_guess(struct lp_room_guess *guess, const double way_m[3])
{
	const struct lp_box box = lp_room_box(guess->at);
	double wall_m[6];

	lp_box_walls_from(&box, way_m, wall_m);
	for (int w = 0; w < 6; w++)
		guess->at[w] = log(fmax(wall_m[w], NEAREST_WALL_M));
}

/* The guesses are of the box as it lies around the middle view. */
static void find_middle(struct lp_room *r, const double before_m[3])
{
	double mean_m[3] = {0.0}, way_m[3];

	for (int k = 0; k < r->views.count; k++)
		for (int a = 0; a < 3; a++)
			mean_m[a] += r->views.list[k].position_m[a] / r->views.count;
	r->views.middle = nearest(&r->views, mean_m);
	for (int a = 0; a < 3; a++)
		way_m[a] = r->views.list[r->views.middle].position_m[a] - before_m[a];
	move_guess(&r->best.guess, way_m);
	move_guess(&r->challenger.guess, way_m);
}

static bool has_changed(const struct lp_room_view *before, const struct lp_room_view *now)
{
	return fabs(log(now->light.mean / before->light.mean)) >
	       MOST_CHANGE + MOST_CHANGE_PER_M * apart_m(before->position_m, now->position_m);
}

/* The box is as it was where light changes: only pictures of the same light are compared. */
static void drop_changed(struct lp_room_views *views, const struct lp_room_view *now)
{
	int kept = 0;

	for (int k = 0; k < views->count; k++)
		if (!has_changed(&views->list[k], now))
			views->list[kept++] = views->list[k];
	views->count = kept;
}

/* Spherical harmonics of a picture and its mean; false: it shows nothing. */
static bool project(const struct lp_grid *grid, const float *cells, struct lp_room_light *light)
{
	light->mean = lp_coarse_project(grid, cells, light->sh);
	return light->mean > 0.0 && isfinite(light->mean);
}

void lp_room_see(struct lp_room *room, const struct lp_probe_pose *pose, const float *cells,
		 const float *bare_cells)
{
	struct lp_room_view seen = {.t_s = (double)pose->t_ns / 1e9};
	double before_m[3];

	if (!lp_probe_pose_is_sane(pose))
		return;
	memcpy(seen.position_m, pose->position_m, sizeof(seen.position_m));
	memcpy(seen.velocity_m_s, pose->velocity_m_s, sizeof(seen.velocity_m_s));
	memcpy(seen.cells, bare_cells, sizeof(seen.cells));
	lp_coarse_blur(seen.cells);
	if (!project(room->grid, seen.cells, &seen.bare))
		return;
	memcpy(seen.cells, cells, sizeof(seen.cells));
	lp_coarse_blur(seen.cells);
	if (!project(room->grid, seen.cells, &seen.light))
		return;
	if (room->world != pose->world)
		forget(room);
	room->world = pose->world;
	memcpy(before_m,
	       room->views.count ? room->views.list[room->views.middle].position_m
				 : seen.position_m,
	       sizeof(before_m));
	drop_changed(&room->views, &seen);
	if (room->views.count == 0)
		room->level = lp_coarse_median(seen.cells);
	lp_coarse_compress(seen.cells, room->level);
	*place_for(&room->views, pose->position_m) = seen;
	find_middle(room, before_m);
	room->best.is_weighed = room->best.is_over = room->challenger.is_weighed = false;
	room->starts_left = STARTS;
}

static void conclude(struct lp_room *r)
{
	const struct lp_room_guess *g = &r->best.guess;
	const double scatter = fmax(g->cost / fmax(g->worth, 1.0), 1.0);
	double by[LP_ROOM_SIZE];

	r->known = false;
	r->found.box = lp_room_box(g->at);
	memcpy(r->found.box.origin_m, r->views.list[r->views.middle].position_m,
	       sizeof(r->found.box.origin_m));
	for (int w = 0; w < 6; w++) {
		double of[LP_ROOM_SIZE] = {0.0};

		of[w] = 1.0;
		if (!lp_cholesky_solve(LP_ROOM_SIZE, g->normal[0], of, by))
			return;
		r->found.wall_sigma_m[w] = r->found.box.wall_m[w] * sqrt(scatter * by[w]);
	}
	lp_room_find_errors(&r->rays, &r->views, &r->found.box, g->at[LP_ROOM_LATE],
			    r->found.error_per_m, r->found.bare_error_per_m);
	r->known = isfinite(r->found.error_per_m[LP_BOX_ORDERS - 1]) ||
		   isfinite(r->found.bare_error_per_m[LP_BOX_ORDERS - 1]);
}

/* ---------------------------------------------------------------- the search */

static bool reaches(const struct lp_room_views *views)
{
	const double *middle_m = views->list[views->middle].position_m;

	for (int k = 0; k < views->count && views->count >= LEAST_VIEWS; k++)
		if (apart_m(views->list[k].position_m, middle_m) >= LEAST_REACH_M)
			return true;
	return false;
}

static void begin(struct search *search, int start)
{
	*search = (struct search){0};
	for (int w = 0; w < 6; w++)
		search->guess.at[w] = log(LP_ROOM_USUAL_WALL_M);
	search->guess.at[LP_ROOM_YAW] = M_PI / 2.0 / STARTS * (start - STARTS / 2);
}

static void weigh(struct search *search, const struct lp_room_views *views)
{
	if (!search->is_weighed)
		lp_room_weigh(views, &search->guess);
	search->is_weighed = true;
}

/* Returns by which share its cost has fallen. */
static double step(struct search *search, const struct lp_room_views *views)
{
	weigh(search, views);
	search->steps++;
	return lp_room_step(views, &search->guess);
}

/* The guess that counts, until it no longer changes. */
static void refine(struct lp_room *r)
{
	if (step(&r->best, &r->views) >= CONVERGED)
		return;
	r->best.is_over = true;
	conclude(r);
}

/* Another start, for some steps: whether it leads to a better guess. */
static void challenge(struct lp_room *r)
{
	struct search *c = &r->challenger;

	if (c->steps == 0)
		begin(c, r->start);
	(void)step(c, &r->views);
	if (c->steps < STEPS_OF_START)
		return;
	if (r->best.steps > 0)
		weigh(&r->best, &r->views);
	if (r->best.steps == 0 || c->guess.cost < r->best.guess.cost)
		r->best = *c;
	c->steps = 0;
	r->start = (r->start + 1) % STARTS;
	r->starts_left--;
}

void lp_room_work(struct lp_room *room)
{
	const bool has_guess = room->best.steps > 0;

	if (!reaches(&room->views))
		return;
	room->calls++;
	if (room->starts_left > 0 && (!has_guess || room->calls % CHALLENGE_EVERY == 0))
		challenge(room);
	else if (has_guess && !room->best.is_over)
		refine(room);
}

bool lp_room_found(const struct lp_room *room, const struct lp_probe_pose *pose,
		   struct lp_room_found *found)
{
	if (!room->known || room->world != pose->world || !lp_probe_pose_is_sane(pose))
		return false;
	*found = room->found;
	memcpy(found->box.origin_m, pose->position_m, sizeof(found->box.origin_m));
	lp_box_walls_from(&room->found.box, pose->position_m, found->box.wall_m);
	for (int w = 0; w < 6; w++)
		if (!(found->box.wall_m[w] > 0.0))
			return false;
	return true;
}
