/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_LIGHT_LINEAR_CHOLESKY_H
#define LP_LIGHT_LINEAR_CHOLESKY_H

#include <stdbool.h>

#define LP_CHOLESKY_MOST 8

/* Solve a x = b for a symmetric, positive definite matrix of `size` (up to LP_CHOLESKY_MOST) rows,
 * row-major, by Cholesky's decomposition; x may be b. False: the matrix is none, or one of its
 * numbers or of x is not finite. Pure. */
bool lp_cholesky_solve(int size, const double *a, const double *b, double *x);

#endif
