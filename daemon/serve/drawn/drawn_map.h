/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What each size of reflection maps leaves out of what glossy surfaces and mirrors show. A coarser
 * map is compared with the finest at hand. What the finest leaves out is found on itself: a texel
 * averages over its width, which blurs by a twelfth of its square as variance, and a lamp lies
 * between four texels, by a sixth on average. So much more blur changes what a surface shows by
 * about as much again.
 */
#ifndef LP_SERVE_DRAWN_DRAWN_MAP_H
#define LP_SERVE_DRAWN_DRAWN_MAP_H

#include "light/send/cube.h"
#include "serve/drawn/drawn.h"

struct lp_drawn_mirrors;

/* For maps up to `size`; `grids`: of 16, 32, 64 as far as there are, borrowed. NULL: out of memory.
 */
struct lp_drawn_mirrors *lp_drawn_mirrors_create(int size,
						 struct lp_cube_grid *const grids[LP_DRAWN_SIZES]);
void lp_drawn_mirrors_destroy(struct lp_drawn_mirrors *mirrors); /* accepts NULL */

/* Planes to be filled, 4 bytes a texel: luminance of the finest map without lamps; and of the lamps
 * alone, as each size up to that has them. */
float *lp_drawn_mirrors_luminance(struct lp_drawn_mirrors *mirrors, int size);
float *lp_drawn_mirrors_lamps(struct lp_drawn_mirrors *mirrors, int size);

/* What that map shows with its lamps, and coarser ones made of it. */
void lp_drawn_measure(struct lp_drawn_mirrors *mirrors, int size, struct lp_drawn_maps *maps);

#endif
