/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What each size of reflection maps leaves out of what glossy surfaces and mirrors show. A coarser
 * map is compared with the finest at hand. What the finest leaves out is found on itself: a texel
 * averages over its width, which blurs like a lobe of a twelfth of its square as variance, and so
 * much more blur changes what a surface shows by as much.
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

/* The plane for the luminance of a map with all lights in it, to be filled: 4 bytes a texel. */
float *lp_drawn_mirrors_luminance(struct lp_drawn_mirrors *mirrors, int size);

/* What that map shows, and coarser ones made of it. */
void lp_drawn_measure(struct lp_drawn_mirrors *mirrors, int size, struct lp_drawn_maps *maps);

#endif
