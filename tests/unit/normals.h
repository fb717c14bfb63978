/* SPDX-License-Identifier: Apache-2.0 */
/* Normals at which tests compare irradiance. */
#ifndef LP_TEST_NORMALS_H
#define LP_TEST_NORMALS_H

#include <math.h>

#define NORMALS 100

/* Even over the sphere (Fibonacci's lattice). */
static inline void normal_of(int k, float normal[3])
{
	const float z = 1.0F - (2.0F * (float)k + 1.0F) / (float)NORMALS;
	const float turn = (float)k * 2.39996323F;

	normal[0] = sqrtf(1.0F - z * z) * cosf(turn);
	normal[1] = z;
	normal[2] = sqrtf(1.0F - z * z) * sinf(turn);
}

static inline double cosine(const float a[3], const float b[3])
{
	return fmax(0.0, (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2]);
}

#endif
