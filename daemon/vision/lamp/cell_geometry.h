/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_VISION_LAMP_CELL_GEOMETRY_H
#define LP_VISION_LAMP_CELL_GEOMETRY_H

#include <stdbool.h>

struct lp_imager;

/* How the pixels of one camera cell lie on the sphere: direction by bilinear interpolation of its
 * corners, which errs by less than a hundredth of a degree over a block. */
struct lp_cell_geometry {
	double corner[4][3];
	double share; /* of the light that this lens takes, over its illumination */
	bool seen;
};

/* Directions from the probe, probe frame. */
struct lp_cell_geometry lp_cell_geometry(const struct lp_imager *imager, int column, int row);

/* Directions along a row are first + u * along: a cell is so small that their lengths differ from 1
 * by no more than 1e-4. */
struct lp_row_geometry {
	double first[3], along[3];
};

/* v: 0..1, down the cell. */
struct lp_row_geometry lp_row_geometry(const struct lp_cell_geometry *g, double v);

#endif
