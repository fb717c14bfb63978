/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Coarse pictures of all around, by which places are compared: luminance on a grid of 64 x 32 cells
 * (light/math/grid.h) in the axes of the world; NAN where nothing is known. Pure functions.
 */
#ifndef LP_LIGHT_PLACE_COARSE_H
#define LP_LIGHT_PLACE_COARSE_H

#include <stdbool.h>

struct lp_grid;

#define LP_COARSE_COLUMNS 64
#define LP_COARSE_ROWS 32
#define LP_COARSE_CELLS (LP_COARSE_COLUMNS * LP_COARSE_ROWS)

/* Blur by about a cell, so that the picture can be looked up between cells. What is not known is
 * left out; it stays so where nothing near is known. In place. */
void lp_coarse_blur(float *cells);

/* Median of what is known; 0: nothing is. */
float lp_coarse_median(const float *cells);

/* Luminance L becomes L / (L + level), so that lamps and windows count no more than pictures on a
 * wall; below 0 it is 0. In place. */
void lp_coarse_compress(float *cells, float level);

/* Bilinear value along `towards` (any length > 0), and how it changes as `towards` does. False:
 * it is not known there. */
bool lp_coarse_look(const float *cells, const double towards[3], double *value, double slope[3]);

/* Spherical harmonics (up to order 4, 25 of them); what is not known counts as the mean. Returns
 * the mean of what is known; 0: nothing is. */
double lp_coarse_project(const struct lp_grid *grid, const float *cells, double *sh);

#endif
