/* SPDX-License-Identifier: Apache-2.0 */
/* Non-negative least squares of a few unknowns, by an active set (Lawson & Hanson 1974, chapter
 * 23). Pure. */
#ifndef LP_LIGHT_LINEAR_NNLS_H
#define LP_LIGHT_LINEAR_NNLS_H

#include <stdbool.h>

#define LP_NNLS_MAX 17

/* The normal equations: minimise x' normal x / 2 - right' x. Only the first `count` rows and
 * columns count. */
struct lp_nnls {
	int count;
	double normal[LP_NNLS_MAX][LP_NNLS_MAX]; /* symmetric, positive definite */
	double right[LP_NNLS_MAX];
};

/* x >= 0 of least value; 0 for all of them if the matrix is not positive definite, or a number in
 * it is not finite. */
void lp_nnls_solve(const struct lp_nnls *problem, double x[LP_NNLS_MAX]);

/* The same from a solution x >= 0 of a problem that is like this one, which is faster. */
void lp_nnls_improve(const struct lp_nnls *problem, double x[LP_NNLS_MAX]);

/* Inverse of `normal` over the unknowns for which x > 0: their covariance. 0 elsewhere. False: that
 * matrix is not positive definite, so nothing is known of them; all is 0. */
bool lp_nnls_covariance(const struct lp_nnls *problem, const double x[LP_NNLS_MAX],
			double covariance[LP_NNLS_MAX][LP_NNLS_MAX]);

/* That of one unknown alone: its variance; 0 where x is 0; INFINITY:
 * nothing is known. */
double lp_nnls_variance(const struct lp_nnls *problem, const double x[LP_NNLS_MAX], int unknown);

#endif
