/* SPDX-License-Identifier: Apache-2.0 */
#include "light/linear/cholesky.h"

#include <float.h>
#include <math.h>

/* Lower triangle, row-major. An infinite row would say that its unknown is 0 for certain. */
static bool decompose(int size, const double *a, double *root)
{
	for (int i = 0; i < size; i++)
		for (int j = 0; j <= i; j++) {
			double sum = a[i * size + j];

			for (int k = 0; k < j; k++)
				sum -= root[i * size + k] * root[j * size + k];
			if (i == j && !(sum > 0.0 && sum <= DBL_MAX))
				return false;
			root[i * size + j] = i == j ? sqrt(sum) : sum / root[j * size + j];
		}
	return true;
}

bool lp_cholesky_solve(int size, const double *a, const double *b, double *x)
{
	double root[LP_CHOLESKY_MOST * LP_CHOLESKY_MOST];
	bool finite = true;

	if (!decompose(size, a, root))
		return false;
	for (int i = 0; i < size; i++) {
		x[i] = b[i];
		for (int k = 0; k < i; k++)
			x[i] -= root[i * size + k] * x[k];
		x[i] /= root[i * size + i];
	}
	for (int i = size - 1; i >= 0; i--) {
		for (int k = i + 1; k < size; k++)
			x[i] -= root[k * size + i] * x[k];
		x[i] /= root[i * size + i];
		finite = finite && isfinite(x[i]);
	}
	return finite;
}
