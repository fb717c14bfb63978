/* SPDX-License-Identifier: Apache-2.0 */
/* The fit of light/place/room.h: what pictures from several places say of a box. Plain data. */
#ifndef LP_LIGHT_PLACE_ROOM_FIT_H
#define LP_LIGHT_PLACE_ROOM_FIT_H

#include "light/place/box.h"
#include "light/place/coarse.h"

struct lp_grid;

#define LP_ROOM_MOST_VIEWS 8
/* Parameters: logarithms of the distances of six walls, the yaw, and how old the light in a
 * picture is (the map of radiance lags behind a probe that goes). */
enum { LP_ROOM_YAW = 6, LP_ROOM_LATE = 7, LP_ROOM_SIZE = 8 };
#define LP_ROOM_USUAL_WALL_M 2.0
/* Neighbouring cells differ alike: a whole picture counts as so many independent ones. */
#define LP_ROOM_WORTH 64.0

/* All light of a picture: mean luminance, and its spherical harmonics, in the world. */
struct lp_room_light {
	double mean, sh[LP_BOX_SH_COUNT];
};

/* A picture from a place. */
struct lp_room_view {
	double t_s;
	double position_m[3], velocity_m_s[3];
	struct lp_room_light light, bare; /* with, and without, what may be listed as area lights */
	float cells[LP_COARSE_CELLS];	  /* compressed */
};

struct lp_room_views {
	const struct lp_grid *grid; /* of their cells; borrowed */
	int count, middle;	    /* the middle one shows what is on the box's walls */
	struct lp_room_view list[LP_ROOM_MOST_VIEWS];
};

/* A guess, and what the pictures say of it. Walls count from the middle one's place. */
struct lp_room_guess {
	double at[LP_ROOM_SIZE];
	double normal[LP_ROOM_SIZE][LP_ROOM_SIZE], right[LP_ROOM_SIZE];
	double cost;  /* in squared sigmas, with the prior */
	double worth; /* of the cells that were compared; LP_ROOM_WORTH for each whole picture */
	double damping;
};

/* The box of a guess. */
struct lp_box lp_room_box(const double at[LP_ROOM_SIZE]);

/* Fill the guess's equations and cost: the middle picture, laid on the box's walls, as it is seen
 * from the other places, against what was seen there. */
void lp_room_weigh(const struct lp_room_views *views, struct lp_room_guess *guess);

/* A step (Levenberg-Marquardt) from a guess that is weighed. Returns by which share the cost has
 * fallen; INFINITY: the step was bad, and the guess is as it was, more damped. */
double lp_room_step(const struct lp_room_views *views, struct lp_room_guess *guess);

#endif
