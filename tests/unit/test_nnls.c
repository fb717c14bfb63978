/* SPDX-License-Identifier: Apache-2.0 */
/* Non-negative least squares: the conditions of optimality hold for random problems. */
#include "light/linear/nnls.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define ROWS 9

static double normal_deviate(unsigned int *seed)
{
	double sum = -6.0;

	for (int i = 0; i < 12; i++)
		sum += (double)rand_r(seed) / RAND_MAX;
	return sum;
}

/* Nine noisy rows for `count` unknowns; a little is added to the diagonal, as there may be more
 * unknowns than rows. */
static struct lp_nnls random_problem(int count, unsigned int *seed)
{
	struct lp_nnls problem = {.count = count};

	for (int r = 0; r < ROWS; r++) {
		double row[LP_NNLS_MAX];
		const double value = normal_deviate(seed);

		for (int i = 0; i < count; i++)
			row[i] = normal_deviate(seed);
		for (int i = 0; i < count; i++) {
			problem.right[i] += row[i] * value;
			for (int j = 0; j < count; j++)
				problem.normal[i][j] += row[i] * row[j];
		}
	}
	for (int i = 0; i < count; i++)
		problem.normal[i][i] += 1e-6;
	return problem;
}

/* Karush, Kuhn, Tucker: x >= 0; no slope where x > 0; none that would lower the value elsewhere. */
static void test_optimality(void **state)
{
	unsigned int seed = 1;
	int at_zero = 0;

	(void)state;
	for (int trial = 0; trial < 2000; trial++) {
		const int count = 1 + trial % LP_NNLS_MAX;
		const struct lp_nnls problem = random_problem(count, &seed);
		double x[LP_NNLS_MAX];

		lp_nnls_solve(&problem, x);
		for (int i = 0; i < count; i++) {
			double slope = problem.right[i];

			for (int j = 0; j < count; j++)
				slope -= problem.normal[i][j] * x[j];
			assert_true(x[i] >= 0.0);
			assert_true(slope < 1e-6);
			if (x[i] > 0.0)
				assert_true(slope > -1e-6);
			at_zero += x[i] == 0.0;
		}
	}
	assert_true(at_zero > 1000); /* else nothing was tested */
}

static void test_units_do_not_matter(void **state)
{
	unsigned int seed = 2;
	double x[LP_NNLS_MAX], scaled_x[LP_NNLS_MAX];

	(void)state;
	for (int trial = 0; trial < 200; trial++) {
		const struct lp_nnls problem = random_problem(6, &seed);
		struct lp_nnls scaled = problem;

		for (int i = 0; i < 6; i++) {
			scaled.right[i] *= pow(10.0, 3 * i - 9);
			for (int j = 0; j < 6; j++)
				scaled.normal[i][j] *= pow(10.0, 3 * i - 9 + 3 * j - 9);
		}
		lp_nnls_solve(&problem, x);
		lp_nnls_solve(&scaled, scaled_x);
		for (int i = 0; i < 6; i++)
			assert_float_equal(scaled_x[i] * pow(10.0, 3 * i - 9), x[i], 1e-6);
	}
}

static void test_covariance(void **state)
{
	const struct lp_nnls problem = {.count = 3,
					.normal = {{4.0, 1.0, 0.5},
						   {1.0, 3.0, 0.2},
						   {0.5, 0.2, 2.0}},
					.right = {5.0, -9.0, 3.0}};
	double x[LP_NNLS_MAX], covariance[LP_NNLS_MAX][LP_NNLS_MAX];

	(void)state;
	lp_nnls_solve(&problem, x);
	assert_true(x[0] > 0.0 && x[1] == 0.0 && x[2] > 0.0);
	lp_nnls_covariance(&problem, x, covariance);
	/* inverse of the matrix without its middle row and column */
	assert_float_equal(covariance[0][0], 2.0 / 7.75, 1e-12);
	assert_float_equal(covariance[0][2], -0.5 / 7.75, 1e-12);
	assert_float_equal(covariance[2][2], 4.0 / 7.75, 1e-12);
	assert_float_equal(covariance[1][1], 0.0, 0.0);
	for (int i = 0; i < 3; i++)
		assert_float_equal(lp_nnls_variance(&problem, x, i), covariance[i][i], 1e-12);
}

/* From the solution of another problem it comes to the same. */
static void test_improving_a_solution(void **state)
{
	unsigned int seed = 3;

	(void)state;
	for (int trial = 0; trial < 500; trial++) {
		const int count = 1 + trial % 12;
		const struct lp_nnls problem = random_problem(count, &seed);
		const struct lp_nnls other = random_problem(count, &seed);
		double x[LP_NNLS_MAX], improved[LP_NNLS_MAX];

		lp_nnls_solve(&problem, x);
		lp_nnls_solve(&other, improved);
		lp_nnls_improve(&problem, improved);
		for (int i = 0; i < count && count <= ROWS; i++)
			assert_float_equal(improved[i], x[i], 1e-6);
		for (int i = 0; i < count; i++)
			assert_true(improved[i] >= 0.0);
	}
}

static void test_not_positive_definite(void **state)
{
	const struct lp_nnls problem = {.count = 2,
					.normal = {{1.0, 2.0}, {2.0, 1.0}},
					.right = {1.0, 1.0}};
	double x[LP_NNLS_MAX];

	(void)state;
	lp_nnls_solve(&problem, x);
	assert_true(isfinite(x[0]) && isfinite(x[1]) && x[0] >= 0.0 && x[1] >= 0.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_optimality),
		cmocka_unit_test(test_units_do_not_matter),
		cmocka_unit_test(test_covariance),
		cmocka_unit_test(test_improving_a_solution),
		cmocka_unit_test(test_not_positive_definite),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
