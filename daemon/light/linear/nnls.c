/* SPDX-License-Identifier: Apache-2.0 */
#include "light/linear/nnls.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

/* The unknowns that are free, and the Cholesky factor of their part of the matrix. */
struct factor {
	int count;
	int index[LP_NNLS_MAX];
	double lower[LP_NNLS_MAX][LP_NNLS_MAX];
};

static bool factorise(const struct lp_nnls *problem, const bool *is_free, struct factor *f)
{
	f->count = 0;
	for (int i = 0; i < problem->count; i++)
		if (is_free[i])
			f->index[f->count++] = i;
	for (int i = 0; i < f->count; i++)
		for (int j = 0; j <= i; j++) {
			double sum = problem->normal[f->index[i]][f->index[j]];

			for (int k = 0; k < j; k++)
				sum -= f->lower[i][k] * f->lower[j][k];
			if (i == j && !(sum > 0.0 && sum <= DBL_MAX))
				return false;
			f->lower[i][j] = i == j ? sqrt(sum) : sum / f->lower[j][j];
		}
	return true;
}

/* value: right side in, solution out. */
static void substitute(const struct factor *f, double value[LP_NNLS_MAX])
{
	for (int i = 0; i < f->count; i++) {
		for (int k = 0; k < i; k++)
			value[i] -= f->lower[i][k] * value[k];
		value[i] /= f->lower[i][i];
	}
	for (int i = f->count - 1; i >= 0; i--) {
		for (int k = i + 1; k < f->count; k++)
			value[i] -= f->lower[k][i] * value[k];
		value[i] /= f->lower[i][i];
	}
}

/* The bound unknown that would lower the value most steeply; -1: none. */
static int steepest(const struct lp_nnls *problem, const bool *is_free, const double *x)
{
	int found = -1;
	double best = 0.0;

	for (int i = 0; i < problem->count; i++) {
		double slope = problem->right[i], size = fabs(slope);

		for (int j = 0; j < problem->count; j++) {
			slope -= problem->normal[i][j] * x[j];
			size += fabs(problem->normal[i][j] * x[j]);
		}
		/* of unknowns in different units: by what each can bring */
		const double gain = slope / sqrt(problem->normal[i][i]);

		if (!is_free[i] && slope > 1e-10 * size && gain > best) {
			best = gain;
			found = i;
		}
	}
	return found;
}

/* Go from x towards `wanted` as far as nothing becomes negative; what becomes 0 is bound. True: all
 * the way. Ratios of numbers far apart round to 1. */
static bool step(const struct factor *f, const double *wanted, bool *is_free, double *x)
{
	double share = 1.0;
	int first = -1;

	for (int i = 0; i < f->count; i++) {
		const double from = x[f->index[i]];
		const double part = from / (from - wanted[i]);

		if (wanted[i] <= 0.0 && (part < share || (first < 0 && wanted[i] < 0.0))) {
			share = fmax(part, 0.0);
			first = f->index[i];
		}
	}
	for (int i = 0; i < f->count; i++)
		x[f->index[i]] =
			first < 0
				? wanted[i]
				: fmax(x[f->index[i]] + share * (wanted[i] - x[f->index[i]]), 0.0);
	if (first < 0)
		return true;
	x[first] = 0.0;
	is_free[first] = false;
	return false;
}

static bool are_finite(const double *values, int count)
{
	for (int i = 0; i < count; i++)
		if (!isfinite(values[i]))
			return false;
	return true;
}

/* The least value over the unknowns that are free, as far as none becomes negative. False: the
 * matrix is not positive definite, or there is none that is finite. */
static bool descend(const struct lp_nnls *problem, bool *is_free, double *x)
{
	for (bool there = false; !there;) {
		double wanted[LP_NNLS_MAX];
		struct factor f;

		if (!factorise(problem, is_free, &f))
			return false;
		for (int i = 0; i < f.count; i++)
			wanted[i] = problem->right[f.index[i]];
		substitute(&f, wanted);
		if (!are_finite(wanted, f.count))
			return false;
		there = step(&f, wanted, is_free, x);
	}
	return true;
}

void lp_nnls_improve(const struct lp_nnls *problem, double x[LP_NNLS_MAX])
{
	bool is_free[LP_NNLS_MAX] = {false};

	for (int i = 0; i < problem->count; i++)
		is_free[i] = x[i] > 0.0;
	if (!descend(problem, is_free, x)) {
		memset(x, 0, LP_NNLS_MAX * sizeof(*x));
		return;
	}
	for (int round = 0; round < 3 * LP_NNLS_MAX; round++) {
		const int next = steepest(problem, is_free, x);

		if (next < 0)
			return;
		is_free[next] = true;
		x[next] = DBL_MIN; /* free, so that step() can go away from it */
		if (!descend(problem, is_free, x)) {
			x[next] = 0.0;
			return;
		}
	}
}

void lp_nnls_solve(const struct lp_nnls *problem, double x[LP_NNLS_MAX])
{
	memset(x, 0, LP_NNLS_MAX * sizeof(*x));
	lp_nnls_improve(problem, x);
}

bool lp_nnls_covariance(const struct lp_nnls *problem, const double x[LP_NNLS_MAX],
			double covariance[LP_NNLS_MAX][LP_NNLS_MAX])
{
	bool is_free[LP_NNLS_MAX] = {false};
	struct factor f;

	memset(covariance, 0, LP_NNLS_MAX * sizeof(*covariance));
	for (int i = 0; i < problem->count; i++)
		is_free[i] = x[i] > 0.0;
	if (!factorise(problem, is_free, &f))
		return false;
	for (int j = 0; j < f.count; j++) {
		double column[LP_NNLS_MAX] = {0.0};

		column[j] = 1.0;
		substitute(&f, column);
		for (int i = 0; i < f.count; i++)
			covariance[f.index[i]][f.index[j]] = column[i];
	}
	return true;
}

double lp_nnls_variance(const struct lp_nnls *problem, const double x[LP_NNLS_MAX], int unknown)
{
	bool is_free[LP_NNLS_MAX] = {false};
	double column[LP_NNLS_MAX] = {0.0};
	struct factor f;
	int at = -1;

	for (int i = 0; i < problem->count; i++)
		is_free[i] = x[i] > 0.0;
	if (!is_free[unknown])
		return 0.0;
	if (!factorise(problem, is_free, &f))
		return INFINITY;
	for (int i = 0; i < f.count; i++)
		if (f.index[i] == unknown)
			at = i;
	column[at] = 1.0;
	substitute(&f, column);
	return column[at];
}
