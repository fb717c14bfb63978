/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_LIGHT_LINEAR_VECTOR_H
#define LP_LIGHT_LINEAR_VECTOR_H

/* Scalar product of two vectors of any length. */
static inline double lp_dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

#endif
