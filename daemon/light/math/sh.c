/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/sh.h"

#include <math.h>

/*
 * Sectoral-first recurrence of the normalised associated Legendre functions, with sin^m taken into
 * cos(m phi), sin(m phi) as polynomials of x and y, so that the poles need no special case
 * (Sloan 2013, "Efficient Spherical Harmonic Evaluation", section 2).
 */
void lp_sh_basis_polar(int order, int polar, const double direction[3], double *y)
{
	const double z = direction[polar];
	const double x = direction[(polar + 1) % 3];
	const double w = direction[(polar + 2) % 3];
	double sectoral = sqrt(1.0 / (4.0 * M_PI)); /* normalised P_m^m without sin^m */
	double cosine = 1.0, sine = 0.0;	    /* sin^m(theta) * cos, sin(m phi) */

	for (int m = 0; m <= order; m++) {
		const double azimuth = m ? M_SQRT2 : 1.0;
		double below = 0.0, legendre = sectoral;

		for (int l = m; l <= order; l++) {
			const int centre = l * (l + 1);

			if (m)
				y[centre - m] = azimuth * legendre * sine;
			y[centre + m] = azimuth * legendre * cosine;

			const double a = sqrt((4.0 * (l + 1) * (l + 1) - 1.0) /
					      ((double)(l + 1) * (l + 1) - (double)m * m));
			const double b = l == m ? 0.0
						: sqrt(((double)l * l - (double)m * m) /
						       (4.0 * l * l - 1.0));
			const double next = a * (z * legendre - b * below);

			below = legendre;
			legendre = next;
		}
		sectoral *= sqrt((2.0 * m + 3.0) / (2.0 * m + 2.0));
		const double turned = x * cosine - w * sine;
		sine = x * sine + w * cosine;
		cosine = turned;
	}
}

void lp_sh_basis(int order, const double direction[3], double *y)
{
	lp_sh_basis_polar(order, 2, direction, y);
}

double lp_sh_cosine(int l)
{
	double factor = 2.0 * M_PI;

	if (l == 1)
		return 2.0 * M_PI / 3.0;
	if (l % 2)
		return 0.0;
	/* 2 pi (-1)^(l/2 - 1) / ((l + 2) (l - 1)) * l! / (2^l ((l/2)!)^2) */
	for (int k = 1; k <= l / 2; k++)
		factor *= (double)(l / 2 + k) / k / 4.0;
	return (l / 2 % 2 ? 1.0 : -1.0) * factor / ((l + 2.0) * (l - 1.0));
}

double lp_sh_disc(int l, double radius_rad)
{
	const double half = sin(radius_rad / 2.0);
	const double below_one = 2.0 * half * half; /* 1 - cos r without cancellation */
	const double c = 1.0 - below_one;
	double previous = 1.0, legendre = c; /* P_{k-1}, P_k */

	if (l == 0)
		return 1.0;
	if (below_one < 1e-6) /* first term of the series: 1 - l (l + 1) (1 - c) / 4 */
		return 1.0 - l * (l + 1) * below_one / 4.0;
	for (int k = 1; k <= l; k++) {
		const double next = ((2 * k + 1) * c * legendre - k * previous) / (k + 1);

		if (k == l)
			return (previous - next) / ((2 * l + 1) * below_one);
		previous = legendre;
		legendre = next;
	}
	return 1.0;
}

void lp_sh_add_lamp(int order, const float direction[3], const float irradiance[3],
		    double radius_rad, double scale, double (*sh)[3])
{
	const double d[3] = {direction[0], direction[1], direction[2]};
	double y[LP_SH_MAX_COUNT];

	lp_sh_basis(order, d, y);
	for (int l = 0; l <= order; l++) {
		const double band = scale * lp_sh_disc(l, radius_rad);

		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			for (int c = 0; c < 3; c++)
				sh[i][c] += band * irradiance[c] * y[i];
	}
}

void lp_sh_irradiance(int order, const float (*sh)[3], const float normal[3], float irradiance[3])
{
	const double n[3] = {normal[0], normal[1], normal[2]};
	double y[LP_SH_MAX_COUNT];
	double sum[3] = {0.0};

	lp_sh_basis(order, n, y);
	for (int l = 0; l <= order; l++)
		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			for (int c = 0; c < 3; c++)
				sum[c] += lp_sh_cosine(l) * y[i] * sh[i][c];
	for (int c = 0; c < 3; c++)
		irradiance[c] = (float)sum[c];
}
