/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The room around a probe that goes from place to place, as a box: coarse pictures from a few
 * places are kept, and the box is found by which the one in the middle, laid on its walls, is seen
 * from the other places as they were (Levenberg-Marquardt). What is left over tells how far the box
 * can be believed. One thread; storage is allocated once.
 */
#ifndef LP_LIGHT_PLACE_ROOM_H
#define LP_LIGHT_PLACE_ROOM_H

#include <stdbool.h>
#include <stdint.h>

#include "light/place/box.h"
#include "light/place/coarse.h"

struct lp_grid;
struct lp_probe_pose;
struct lp_room;

/* What is known of the room. */
struct lp_room_found {
	struct lp_box box;
	double wall_sigma_m[6];
	/* 1 sigma of the light that is moved to a place as spherical harmonics of an order: root
	 * mean square of the irradiance over all normals, relative to its mean, for each metre.
	 * INFINITY: such harmonics are better left as they are. */
	double error_per_m[LP_BOX_ORDERS];
	double bare_error_per_m[LP_BOX_ORDERS]; /* of light without area lights */
};

int lp_room_create(struct lp_room **room);  /* -ENOMEM */
void lp_room_destroy(struct lp_room *room); /* accepts NULL */

/* The grid of the pictures, in the axes of the world. */
const struct lp_grid *lp_room_grid(const struct lp_room *room);

/* Whether a picture from here is of use: none from so near is kept, or an old one. */
bool lp_room_wants(const struct lp_room *room, const struct lp_probe_pose *pose);

/* A picture from here: LP_COARSE_CELLS cells, not blurred; lamps, which have places of their own,
 * are unknown in it, and in `bare_cells` area lights, too. Copied. */
void lp_room_see(struct lp_room *room, const struct lp_probe_pose *pose, const float *cells,
		 const float *bare_cells);

/* One step of the fit, if one is due; once a frame. */
void lp_room_work(struct lp_room *room);

/* The room in which `pose` is. False: nothing is known of it, or no box explains what was seen. */
bool lp_room_found(const struct lp_room *room, const struct lp_probe_pose *pose,
		   struct lp_room_found *found);

#endif
