/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a packet's SH and lights leave out of what is drawn, for every order and number of lights:
 * against all that the estimate knows, SH to the order LP_FINE_SH_COUNT holds and every light.
 * Measures: docs/users/conventions.md, "What is drawn".
 */
#ifndef LP_SERVE_DRAWN_DRAWN_LIGHT_H
#define LP_SERVE_DRAWN_DRAWN_LIGHT_H

#include "serve/drawn/drawn.h"

struct lp_drawn_tables;

/* Directions, points of the table and their SH; immutable. NULL: out of memory. */
struct lp_drawn_tables *lp_drawn_tables_create(void);
void lp_drawn_tables_destroy(struct lp_drawn_tables *tables); /* accepts NULL */

/* The lights are left out from the last to the first; `key`: KEY is sent, too. */
void lp_drawn_predict(const struct lp_drawn_tables *tables,
		      const struct lp_light_estimate *estimate, bool key,
		      struct lp_drawn_models *models);

/* Blur of what a glossy surface and a mirror show, 1 sigma of each axis. */
#define LP_GLOSSY_DEG 15.0
#define LP_MIRROR_DEG 1.5

/* Lobe of a surface of that blur (radians), per steradian, at a cosine; its integral is 1. */
double lp_drawn_lobe(double blur_rad, double cosine);

/* Point `index` of `count`, spread evenly over the sphere (a Fibonacci lattice). */
void lp_drawn_spread(int index, int count, double direction[3]);

#endif
