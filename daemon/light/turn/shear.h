/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a rolling shutter does to the picture of a camera that turns: each row is exposed a little
 * later than the one above, when the camera looks elsewhere. To first order in the turn during the
 * read-out.
 */
#ifndef LP_LIGHT_TURN_SHEAR_H
#define LP_LIGHT_TURN_SHEAR_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_grid;

struct lp_shear {
	const struct lp_grid *grid; /* borrowed */
	/* Per cell of the grid, camera frame: when its row is exposed, from -1/2 (the first) to 1/2
	 * (the last) of the read-out after the middle row. Borrowed; NULL: all at once. */
	const float *row_share;
	double turn[3]; /* rotation vector of the camera during the read-out, in its own frame */
};

/* Whether rows look elsewhere at all. */
bool lp_shear_is_none(const struct lp_shear *shear);

/* From where a direction is in the camera's picture to where it was while the middle row was
 * exposed; and back. Unit vectors, camera frame. */
void lp_shear_to_middle(const struct lp_shear *shear, float direction[3]);
void lp_shear_from_middle(const struct lp_shear *shear, float direction[3]);

#ifdef __cplusplus
}
#endif

#endif
