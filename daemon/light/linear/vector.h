/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_LIGHT_LINEAR_VECTOR_H
#define LP_LIGHT_LINEAR_VECTOR_H

#include <math.h>

/* Scalar product of two vectors of any length. */
static inline double lp_dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void lp_cross(const double a[3], const double b[3], double c[3])
{
	c[0] = a[1] * b[2] - a[2] * b[1];
	c[1] = a[2] * b[0] - a[0] * b[2];
	c[2] = a[0] * b[1] - a[1] * b[0];
}

/* Returns the length; a vector of length 0 stays. */
static inline double lp_normalise(double v[3])
{
	const double length = sqrt(lp_dot(v, v));

	for (int a = 0; length > 0.0 && a < 3; a++)
		v[a] /= length;
	return length;
}

/* Two unit vectors across the unit vector `along`. */
static inline void lp_across(const double along[3], double basis[2][3])
{
	const double aside[3] = {fabs(along[0]) < 0.7, fabs(along[0]) >= 0.7, 0.0};

	lp_cross(along, aside, basis[0]);
	(void)lp_normalise(basis[0]);
	lp_cross(along, basis[0], basis[1]);
}

#endif
