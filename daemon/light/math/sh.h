/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Real spherical harmonics, orthonormal, without Condon-Shortley sign, index i = l (l + 1) + m,
 * polar axis +Z of the probe frame (docs/users/conventions.md). Coefficients are of radiance, RGB
 * per index.
 */
#ifndef LP_LIGHT_MATH_SH_H
#define LP_LIGHT_MATH_SH_H

#define LP_SH_MAX_ORDER 8 /* inside; the wire carries up to LP_MAX_SH_ORDER */
#define LP_SH_MAX_COUNT ((LP_SH_MAX_ORDER + 1) * (LP_SH_MAX_ORDER + 1))

/* Y_i(direction) for all i up to `order` (0..8) into y[(order + 1)^2]. `direction` is a unit
 * vector. */
void lp_sh_basis(int order, const double direction[3], double *y);

/* As above with any right-handed frame: polar axis is component `polar` (0 x, 1 y, 2 z), and the
 * two others follow it cyclically. lp_sh_basis() is polar = 2. */
void lp_sh_basis_polar(int order, int polar, const double direction[3], double *y);

/* A_l of E(n) = sum A_l L_i Y_i(n): the clamped cosine's band factors (Ramamoorthi & Hanrahan 2001,
 * eq. 19), pi, 2 pi / 3, pi / 4, 0, -pi / 24, ... */
double lp_sh_cosine(int l);

/* Band factor of a uniform disc of the given angular radius, 1 for a point: the projection of a
 * disc of irradiance-at-normal-incidence E along d is E * lp_sh_disc(l, r) * Y_i(d). Ratio of
 * Legendre integrals, (P_{l-1}(c) - P_{l+1}(c)) / ((2 l + 1) (1 - c)), c = cos r. */
double lp_sh_disc(int l, double radius_rad);

/* Add a lamp: sh[i] += scale * irradiance * disc factor * Y_i(direction), up to `order`. */
void lp_sh_add_lamp(int order, const float direction[3], const float irradiance[3],
		    double radius_rad, double scale, double (*sh)[3]);

/* Irradiance E(normal), RGB, of radiance coefficients up to `order`. */
void lp_sh_irradiance(int order, const float (*sh)[3], const float normal[3], float irradiance[3]);

#endif
