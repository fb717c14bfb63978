/* SPDX-License-Identifier: Apache-2.0 */
/* Symmetric 3x3 matrices, stored xx xy xz yy yz zz. */
#ifndef LP_LIGHT_LINEAR_SYMMETRIC3_H
#define LP_LIGHT_LINEAR_SYMMETRIC3_H

/* Largest eigenvalue and its unit eigenvector (cyclic Jacobi rotations; exact for diagonal input).
 */
double lp_symmetric3_largest(const double matrix[6], double vector[3]);

#endif
