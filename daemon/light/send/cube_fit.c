/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lp_cube_fit(): radiance L of one channel becomes L (1 + sum_i c_i Y_i), which a picture hardly
 * shows. What c must be follows from the projections m_i = sum L Y_i w and their derivatives
 * M_ij = sum L Y_i Y_j w; the factor has bounds, so that it takes a few steps.
 */
#include "light/send/cube.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#define N LP_CUBE_BANDS
#define STEPS 4
/* Of one step; light beyond this is added all around instead. */
#define LEAST_FACTOR 0.25F
#define MOST_FACTOR 4.0F
/* Relative to the mean: a tenth of what the invariant allows. */
#define CLOSE_ENOUGH 5e-4
/* Keeps M regular where a cube's light is in a few texels: share of its mean diagonal. */
#define RIDGE 1e-3
#define SQRT_4_PI 3.5449077018110318

typedef float v4 __attribute__((vector_size(16), may_alias)); /* of planes of floats */
typedef int32_t mask4 __attribute__((vector_size(16)));

static v4 select4(mask4 which, v4 yes, v4 no)
{
	return (v4)((which & (mask4)yes) | (~which & (mask4)no));
}

static double sum_of(v4 v)
{
	return (double)v[0] + (double)v[1] + (double)v[2] + (double)v[3];
}

static const v4 *vectors(const float *plane)
{
	return (const v4 *)__builtin_assume_aligned(plane, 16);
}

static void project(const struct lp_cube_grid *grid, const float *plane, double moments[N])
{
	const v4 *radiance = vectors(plane), *weight = vectors(grid->solid_angle_sr);
	const int row =
		grid->texels / 6 / 4; /* of four; sums of a face stay exact enough in float */

	memset(moments, 0, N * sizeof(*moments));
	for (int face = 0; face < 6; face++) {
		v4 sum[N] = {{0.0F}};

		for (int i = face * row; i < (face + 1) * row; i++) {
			const v4 flux = radiance[i] * weight[i];

			for (int k = 0; k < N; k++)
				sum[k] += flux * vectors(grid->basis[k])[i];
		}
		for (int k = 0; k < N; k++)
			moments[k] += sum_of(sum[k]);
	}
}

void lp_cube_project(const struct lp_cube *cube, double scale, double (*sh)[3])
{
	double moments[N];

	for (int c = 0; c < 3; c++) {
		project(cube->grid, cube->rgb[c], moments);
		for (int k = 0; k < N; k++)
			sh[k][c] += scale * moments[k];
	}
}

static void derivatives(const struct lp_cube_grid *grid, const float *plane, double m[N][N])
{
	const v4 *radiance = vectors(plane), *weight = vectors(grid->solid_angle_sr);

	for (int i = 0; i < N; i++) {
		v4 sum[N] = {{0.0F}};

		for (int t = 0; t < grid->texels / 4; t++) {
			const v4 flux = radiance[t] * weight[t] * vectors(grid->basis[i])[t];

			for (int j = 0; j <= i; j++)
				sum[j] += flux * vectors(grid->basis[j])[t];
		}
		for (int j = 0; j <= i; j++)
			m[i][j] = sum_of(sum[j]);
	}
}

/* Cholesky's factor in the lower triangle, in place. False: there is no light, or products of it
 * are no floats. */
static bool factorize(double m[N][N])
{
	double ridge = 0.0;

	for (int i = 0; i < N; i++)
		ridge += RIDGE * m[i][i] / N;
	if (!(ridge > 0.0 && isfinite(ridge)))
		return false;
	for (int i = 0; i < N; i++) {
		m[i][i] += ridge;
		for (int j = 0; j <= i; j++) {
			double sum = m[i][j];

			for (int k = 0; k < j; k++)
				sum -= m[i][k] * m[j][k];
			m[i][j] = i == j ? sqrt(fmax(sum, ridge)) : sum / m[j][j];
		}
	}
	return true;
}

static void solve(const double m[N][N], double x[N])
{
	for (int i = 0; i < N; i++) {
		for (int k = 0; k < i; k++)
			x[i] -= m[i][k] * x[k];
		x[i] /= m[i][i];
	}
	for (int i = N - 1; i >= 0; i--) {
		for (int k = i + 1; k < N; k++)
			x[i] -= m[k][i] * x[k];
		x[i] /= m[i][i];
	}
}

static void multiply(const struct lp_cube_grid *grid, const double c[N], float *plane)
{
	v4 *radiance = (v4 *)__builtin_assume_aligned(plane, 16);
	const v4 least = {LEAST_FACTOR, LEAST_FACTOR, LEAST_FACTOR, LEAST_FACTOR};
	const v4 most = {MOST_FACTOR, MOST_FACTOR, MOST_FACTOR, MOST_FACTOR};
	float coefficient[N];

	for (int k = 0; k < N; k++)
		coefficient[k] = (float)c[k];
	for (int t = 0; t < grid->texels / 4; t++) {
		v4 factor = {1.0F, 1.0F, 1.0F, 1.0F};

		for (int k = 0; k < N; k++)
			factor += coefficient[k] * vectors(grid->basis[k])[t];
		factor = select4(factor < least, least, factor);
		radiance[t] *= select4(factor > most, most, factor);
	}
}

/* The mean becomes the wanted one: by a factor, and what that cannot be by light all around.
 * Radiance is not below 0 afterwards. */
static void set_mean(const struct lp_cube_grid *grid, float *plane, double wanted)
{
	double sum = 0.0, factor;
	float rest;

	for (int i = 0; i < grid->texels; i++) {
		plane[i] = fmaxf(plane[i], 0.0F);
		sum += (double)plane[i] * (double)grid->solid_angle_sr[i];
	}
	wanted = fmax(wanted, 0.0);
	factor = sum > 0.0 ? fmin(wanted / sum, MOST_FACTOR) : 0.0;
	rest = (float)((wanted - factor * sum) / (4.0 * M_PI));
	rest = fabsf(rest) > 1e-6F * (float)wanted ? rest : 0.0F;
	for (int i = 0; i < grid->texels; i++)
		plane[i] = (float)factor * plane[i] + rest;
}

static void fit_plane(const struct lp_cube_grid *grid, float *plane, const double wanted[N])
{
	double m[N][N], moments[N];
	bool have_m = false;

	set_mean(grid, plane, wanted[0] * SQRT_4_PI);
	if (!(wanted[0] > 0.0))
		return;
	for (int step = 0; step < STEPS; step++) {
		double apart = 0.0, c[N];

		project(grid, plane, moments);
		for (int k = 0; k < N; k++) {
			c[k] = wanted[k] - moments[k];
			apart = fmax(apart, fabs(c[k]));
		}
		if (apart < CLOSE_ENOUGH * wanted[0])
			return;
		if (!have_m) {
			derivatives(grid, plane, m);
			have_m = factorize(m);
		}
		if (!have_m)
			return;
		solve((const double(*)[N])m, c);
		multiply(grid, c, plane);
	}
}

void lp_cube_fit(struct lp_cube *cube, const double (*sh)[3])
{
	double wanted[N];

	for (int c = 0; c < 3; c++) {
		for (int k = 0; k < N; k++)
			wanted[k] = sh[k][c];
		fit_plane(cube->grid, cube->rgb[c], wanted);
	}
}
