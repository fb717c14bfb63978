/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rotations of directions and of spherical harmonics. A rotation is a 3x3 matrix, row-major, in
 * double: `to[i] = sum_j rotation[i][j] from[j]`. A rotation vector has the axis's direction and
 * the angle in radians as its length. Pure functions.
 */
#ifndef LP_LIGHT_MATH_ROTATION_H
#define LP_LIGHT_MATH_ROTATION_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_rotation {
	double m[3][3];
};

struct lp_rotation lp_rotation_identity(void);
bool lp_rotation_is_identity(const struct lp_rotation *rotation); /* to the bit */

/* From a rotation vector (Rodrigues' formula). */
struct lp_rotation lp_rotation_of_vector(const double vector[3]);

/* Of a quaternion (x, y, z, w) of any length > 0. */
struct lp_rotation lp_rotation_of_quaternion(const double quaternion[4]);

/* The unit quaternion (x, y, z, w) of a rotation. */
void lp_rotation_quaternion(const struct lp_rotation *rotation, double quaternion[4]);

/* The rotation vector of a rotation, 0 .. pi long. */
void lp_rotation_vector(const struct lp_rotation *rotation, double vector[3]);

/* First `inner`, then `outer`. Made orthonormal again: rounding does not add up. */
struct lp_rotation lp_rotation_product(const struct lp_rotation *outer,
				       const struct lp_rotation *inner);

struct lp_rotation lp_rotation_inverse(const struct lp_rotation *rotation);

void lp_rotate(const struct lp_rotation *rotation, const double from[3], double to[3]);

/* In place, in float. */
void lp_rotate_direction(const struct lp_rotation *rotation, float direction[3]);

/* Coefficients up to `order` (0..8) of the light that `rotation` has turned, in place:
 * L'(d) = L(rotation^-1 d). Exact, by quadrature. */
void lp_sh_rotate(const struct lp_rotation *rotation, int order, float (*sh)[3]);

#ifdef __cplusplus
}
#endif

#endif
