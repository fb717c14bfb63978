/* SPDX-License-Identifier: Apache-2.0 */
/* Normal equations that are hardly solvable: against elimination with pivots in long double. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "figure.h"
#include "light/linear/cholesky.h"
#include "light/linear/nnls.h"
#include "light/linear/symmetric3.h"
#include "random_normal.h"

#define SIZE LP_CHOLESKY_MOST
#define TRIALS 200

/* Gauss's elimination with rows exchanged: nothing of the code under test. */
static void solve_exactly(int size, const double *a, const double *b, long double *x)
{
	long double m[SIZE][SIZE + 1];

	for (int i = 0; i < size; i++) {
		for (int j = 0; j < size; j++)
			m[i][j] = a[i * size + j];
		m[i][size] = b[i];
	}
	for (int k = 0; k < size; k++) {
		int most = k;

		for (int i = k + 1; i < size; i++)
			if (fabsl(m[i][k]) > fabsl(m[most][k]))
				most = i;
		for (int j = 0; j <= size; j++) {
			const long double kept = m[k][j];

			m[k][j] = m[most][j];
			m[most][j] = kept;
		}
		for (int i = k + 1; i < size; i++)
			for (int j = size; j >= k; j--)
				m[i][j] -= m[i][k] / m[k][k] * m[k][j];
	}
	for (int i = size - 1; i >= 0; i--) {
		x[i] = m[i][size];
		for (int j = i + 1; j < size; j++)
			x[i] -= m[i][j] * x[j];
		x[i] /= m[i][i];
	}
}

/* A symmetric matrix whose eigenvalues go from 1 down to 1 / condition, turned at random. */
static void matrix_of(double condition, double *a)
{
	memset(a, 0, SIZE * SIZE * sizeof(*a));
	for (int i = 0; i < SIZE; i++)
		a[i * SIZE + i] = pow(condition, -i / (SIZE - 1.0));
	for (int turn = 0; turn < 3; turn++) {
		double v[SIZE], square = 0.0;

		for (int i = 0; i < SIZE; i++) {
			v[i] = (double)random_normal();
			square += v[i] * v[i];
		}
		for (int side = 0; side < 2; side++) /* H a H: Householder's mirror from both */
			for (int i = 0; i < SIZE; i++) {
				double along = 0.0;

				for (int j = 0; j < SIZE; j++)
					along += v[j] * (side ? a[i * SIZE + j] : a[j * SIZE + i]);
				for (int j = 0; j < SIZE; j++)
					*(side ? &a[i * SIZE + j] : &a[j * SIZE + i]) -=
						2.0 * along * v[j] / square;
			}
	}
	for (int i = 0; i < SIZE; i++)
		for (int j = 0; j < i; j++)
			a[i * SIZE + j] = a[j * SIZE + i];
}

/* The largest error of a solution, relative to its length; of what rounding to float leaves of the
 * matrix, if `in_float`. */
static double worst_error(double condition, bool in_float)
{
	double worst = 0.0;

	for (int trial = 0; trial < TRIALS; trial++) {
		double a[SIZE * SIZE], given[SIZE * SIZE], b[SIZE], x[SIZE], off = 0.0, all = 0.0;
		long double truth[SIZE];

		matrix_of(condition, a);
		for (int i = 0; i < SIZE; i++)
			b[i] = (double)random_normal();
		for (int i = 0; i < SIZE * SIZE; i++)
			given[i] = in_float ? (double)(float)a[i] : a[i];
		solve_exactly(SIZE, a, b, truth);
		assert_true(lp_cholesky_solve(SIZE, given, b, x));
		for (int i = 0; i < SIZE; i++) {
			const double apart = (double)(x[i] - truth[i]);

			off += apart * apart;
			all += (double)(truth[i] * truth[i]);
		}
		worst = fmax(worst, sqrt(off / all));
	}
	return worst;
}

/* The error grows with the condition number, and with the rounding of the numbers: no more. */
static void test_cholesky_by_condition(void **state)
{
	static const double conditions[] = {1e2, 1e6, 1e10, 1e13};

	(void)state;
	for (int k = 0; k < 4; k++) {
		char input[64];

		(void)snprintf(input, sizeof(input), "condition %.0e, double", conditions[k]);
		figure("normal equations (Cholesky)", input, "solution, relative",
		       worst_error(conditions[k], false), 4.0 * DBL_EPSILON * conditions[k]);
	}
	for (int k = 0; k < 2; k++) {
		char input[64];
		const double condition = k ? 1e5 : 1e2;

		(void)snprintf(input, sizeof(input), "condition %.0e, matrix in float32",
			       condition);
		figure("normal equations (Cholesky)", input, "solution, relative",
		       worst_error(condition, true), 2.0 * (double)FLT_EPSILON * condition);
	}
}

/* Parts of very different units: rows and columns times powers of ten change nothing. */
static void test_cholesky_in_any_units(void **state)
{
	double worst = 0.0;

	(void)state;
	for (int trial = 0; trial < TRIALS; trial++) {
		double a[SIZE * SIZE], b[SIZE], x[SIZE], scaled_x[SIZE], by[SIZE];

		matrix_of(1e3, a);
		for (int i = 0; i < SIZE; i++) {
			b[i] = (double)random_normal();
			by[i] = pow(10.0, 20.0 * (double)random_normal());
		}
		assert_true(lp_cholesky_solve(SIZE, a, b, x));
		for (int i = 0; i < SIZE; i++) {
			b[i] *= by[i];
			for (int j = 0; j < SIZE; j++)
				a[i * SIZE + j] *= by[i] * by[j];
		}
		assert_true(lp_cholesky_solve(SIZE, a, b, scaled_x));
		for (int i = 0; i < SIZE; i++)
			worst = fmax(worst, fabs(scaled_x[i] * by[i] - x[i]) / (1.0 + fabs(x[i])));
	}
	figure("normal equations (Cholesky)", "units 1e-60 … 1e60 apart", "solution, relative",
	       worst, 1e-11);
}

/* What has no answer is refused: the caller must not be handed a number. */
static void test_cholesky_refuses(void **state)
{
	static const double bad[][4] = {
		{0.0, 0.0, 0.0, 0.0},		{1.0, 2.0, 2.0, 1.0},
		{1.0, 1.0, 1.0, 1.0},		{NAN, 0.0, 0.0, 1.0},
		{1.0, NAN, NAN, 1.0},		{INFINITY, INFINITY, INFINITY, INFINITY},
		{1.0, INFINITY, INFINITY, 1.0}, {-1.0, 0.0, 0.0, 1.0},
		{INFINITY, 0.0, 0.0, 1.0},	{1e-320, 0.0, 0.0, 1.0},
	};
	const double b[2] = {1.0, 1.0};
	double x[2];

	(void)state;
	for (size_t k = 0; k < LP_COUNT(bad); k++)
		if (lp_cholesky_solve(2, bad[k], b, x))
			fail_msg("matrix %zu: %g %g", k, x[0], x[1]);
	assert_false(lp_cholesky_solve(2, (const double[]){1.0, 0.0, 0.0, 1.0},
				       (const double[]){NAN, 0.0}, x));
	assert_false(lp_cholesky_solve(2, (const double[]){1.0, 0.0, 0.0, 1.0},
				       (const double[]){INFINITY, 0.0}, x));
}

/* ---------------------------------------------------------------- not negative */

static const double far_apart[3] = {1e-9, 1.0, 1e9};

/* From whatever guess: the same solution, also where unknowns are 1e18 apart. */
static void test_nnls_from_any_guess(void **state)
{
	static const double guesses[] = {0.0, 1e-300, 1.0, 1e20, 1e200};
	double worst = 0.0;

	(void)state;
	for (size_t g = 0; g < LP_COUNT(guesses); g++) {
		struct lp_nnls problem = {.count = 3};
		double x[LP_NNLS_MAX] = {guesses[g], guesses[g], guesses[g]};

		for (int i = 0; i < 3; i++) {
			problem.normal[i][i] = 1.0 / (far_apart[i] * far_apart[i]);
			problem.right[i] = 1.0 / far_apart[i];
		}
		lp_nnls_improve(&problem, x);
		for (int i = 0; i < 3; i++)
			worst = fmax(worst, fabs(x[i] / far_apart[i] - 1.0));
	}
	figure("not negative least squares", "unknowns 1e-9 … 1e9, guess 0 … 1e200",
	       "solution, relative", worst, 1e-12);
}

static void test_nnls_of_nonsense(void **state)
{
	static const double bad[] = {NAN, INFINITY, -INFINITY, 1e308, -1.0, 0.0};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(bad); k++)
		for (int at = 0; at < 9; at++) {
			struct lp_nnls problem = {.count = 2,
						  .normal = {{2.0, 0.5}, {0.5, 1.0}},
						  .right = {1.0, 1.0}};
			double covariance[LP_NNLS_MAX][LP_NNLS_MAX];
			double x[LP_NNLS_MAX] = {0.0};

			if (at % 3 != 0)
				problem.normal[at % 2][at % 2] = bad[k];
			if (at % 3 != 1)
				problem.right[at / 3 % 2] = bad[k];
			if (at % 3 == 2)
				problem.normal[0][1] = problem.normal[1][0] = bad[k];
			if (at / 3 == 1)
				x[0] = x[1] = 1.0;
			lp_nnls_improve(&problem, x);
			lp_nnls_covariance(&problem, x, covariance);
			for (int i = 0; i < 2; i++) {
				if (!isfinite(x[i]) || x[i] < 0.0)
					fail_msg("%g at %d: x %g %g", bad[k], at, x[0], x[1]);
				for (int j = 0; j < 2; j++)
					assert_false(isnan(covariance[i][j]));
			}
		}
}

/* Columns that are the same but for rounding. */
static void test_nnls_of_columns_alike(void **state)
{
	(void)state;
	for (int e = 0; e <= 20; e++) {
		const double apart = pow(10.0, -e);
		struct lp_nnls problem = {.count = LP_NNLS_MAX};
		double x[LP_NNLS_MAX], sum = 0.0;

		for (int i = 0; i < LP_NNLS_MAX; i++) {
			problem.right[i] = 3.0;
			for (int j = 0; j < LP_NNLS_MAX; j++)
				problem.normal[i][j] = 1.0 + (i == j) * apart;
		}
		lp_nnls_solve(&problem, x);
		for (int i = 0; i < LP_NNLS_MAX; i++) {
			assert_true(x[i] >= 0.0 && isfinite(x[i]));
			sum += x[i];
		}
		assert_float_equal(sum, 3.0, 3.0 * apart + 1e-6);
	}
}

/* ---------------------------------------------------------------- eigenvectors */

static void test_symmetric3(void **state)
{
	static const double scales[] = {1e-150, 1e-12, 1.0, 1e12, 1e150};
	static const double ratios[] = {0.0, 1e-16, 1e-8, 0.5, 1.0 - 1e-8, 1.0};
	double worst = 0.0;

	(void)state;
	for (int s = 0; s < 5; s++)
		for (int r = 0; r < 6; r++) {
			/* the larger along (1, 2, 2) / 3 */
			const double u[3] = {1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0};
			double m[6], v[3], off = 0.0;

			for (int i = 0, at = 0; i < 3; i++)
				for (int j = i; j < 3; j++, at++)
					m[at] = scales[s] * ((1.0 - ratios[r]) * u[i] * u[j] +
							     ratios[r] * (i == j));
			const double value = lp_symmetric3_largest(m, v);

			for (int i = 0; i < 3; i++) {
				double image = 0.0;

				for (int j = 0; j < 3; j++)
					image += m[(int[3][3]){
							 {0, 1, 2}, {1, 3, 4}, {2, 4, 5}}[i][j]] *
						 v[j];
				off = fmax(off, fabs(image - value * v[i]) / scales[s]);
			}
			worst = fmax(worst, fmax(off, fabs(value / scales[s] - 1.0)));
		}
	figure("eigenvector of 3 × 3", "scales 1e-150 … 1e150, eigenvalues alike or 0",
	       "residual, relative", worst, 1e-14);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_cholesky_by_condition),
		cmocka_unit_test(test_cholesky_in_any_units),
		cmocka_unit_test(test_cholesky_refuses),
		cmocka_unit_test(test_nnls_from_any_guess),
		cmocka_unit_test(test_nnls_of_nonsense),
		cmocka_unit_test(test_nnls_of_columns_alike),
		cmocka_unit_test(test_symmetric3),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
