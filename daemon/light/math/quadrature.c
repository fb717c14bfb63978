/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/quadrature.h"

#include <math.h>

void lp_gauss_legendre(int n, double *node, double *weight)
{
	for (int i = 0; i < n; i++) {
		double x = cos(M_PI * (i + 0.75) / (n + 0.5)), slope = 1.0;

		for (int iteration = 0; iteration < 50; iteration++) {
			double p = 1.0, below = 0.0;

			for (int k = 0; k < n; k++) {
				const double above = ((2 * k + 1) * x * p - k * below) / (k + 1);

				below = p;
				p = above;
			}
			slope = n * (x * p - below) / (x * x - 1.0);
			x -= p / slope;
			if (fabs(p / slope) < 1e-15)
				break;
		}
		node[i] = x;
		weight[i] = 2.0 / ((1.0 - x * x) * slope * slope);
	}
}
