/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_LIGHT_MATH_QUADRATURE_H
#define LP_LIGHT_MATH_QUADRATURE_H

#ifdef __cplusplus
extern "C" {
#endif

/* Gauss-Legendre nodes and weights on [-1, 1], exact for polynomials up to degree 2 n - 1, by
 * Newton's method (Press et al., "Numerical Recipes", section 4.6). */
void lp_gauss_legendre(int n, double *node, double *weight);

#ifdef __cplusplus
}
#endif

#endif
