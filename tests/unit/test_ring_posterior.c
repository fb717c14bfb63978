/* SPDX-License-Identifier: Apache-2.0 */
/* The posterior of hidden light against integrals over a grid. */
#include "light/clipped/ring_posterior.h"

#include <math.h>

#include "lp_test.h"

#define STEPS 4000

/* One part at a known scale: mean and sigma by integration over x. */
static void integrate(double precision, double right, double bound, double *mean, double *sigma)
{
	const double most = 3.0 * fmax(right / precision, 0.0) + 12.0 / sqrt(precision);
	double sums[3] = {0.0};

	for (int i = 0; i < STEPS; i++) {
		const double x = most * (i + 0.5) / STEPS;
		const double p = exp(-precision * x * x / 2.0 + right * x -
				     fmax(right, 0.0) * fmax(right, 0.0) / precision / 2.0) /
				 (x + bound);

		sums[0] += p;
		sums[1] += p * x;
		sums[2] += p * x * x;
	}
	*mean = sums[1] / sums[0];
	*sigma = sqrt(sums[2] / sums[0] - *mean * *mean);
}

static struct lp_nnls one_part(double sigma, double value)
{
	struct lp_nnls normal = {.count = 2};

	normal.normal[0][0] = 1e12; /* the scale is 1 */
	normal.right[0] = 1e12;
	normal.normal[1][1] = 1.0 / (sigma * sigma);
	normal.right[1] = value / (sigma * sigma);
	return normal;
}

/* Strong light, light that noise could be, none, and readings that are too low. */
static void test_one_part_is_as_by_integration(void **state)
{
	const double values[] = {100.0, 10.0, 3.0, 0.0, -20.0};
	const double bound[LP_NNLS_MAX] = {0.0, 0.5};

	(void)state;
	for (int i = 0; i < 5; i++) {
		const struct lp_nnls normal = one_part(4.0, values[i]);
		struct lp_ring_posterior found;
		double mean, sigma;

		integrate(normal.normal[1][1], normal.right[1], bound[1], &mean, &sigma);
		lp_ring_posterior(&normal, bound, &found);
		assert_float_equal(found.mean[1], mean, 0.02 * sigma);
		assert_float_equal(sqrt(found.covariance[1][1]), sigma, 0.02 * sigma);
		assert_float_equal(found.scale, 1.0, 1e-3);
	}
}

/* Two parts that look alike: the sum is known, and each one hardly. */
static void test_parts_that_look_alike(void **state)
{
	const double bound[LP_NNLS_MAX] = {0.0, 1.0, 1.0};
	struct lp_nnls normal = one_part(3.0, 100.0);
	struct lp_ring_posterior found;
	double sum = 0.0;

	(void)state;
	normal.count = 3;
	normal.right[2] = normal.right[1];
	normal.normal[2][2] = normal.normal[1][1] * (1.0 + 1e-6);
	normal.normal[1][2] = normal.normal[2][1] = normal.normal[1][1];
	lp_ring_posterior(&normal, bound, &found);
	assert_float_equal(found.mean[1] + found.mean[2], 100.0, 3.0);
	for (int i = 1; i < 3; i++) {
		assert_true(sqrt(found.covariance[i][i]) > 15.0);
		for (int j = 1; j < 3; j++)
			sum += found.covariance[i][j];
	}
	assert_true(sqrt(sum) < 4.5);
}

/* A scale of which nothing but a product is known: light and scale share what is read. */
static void test_a_scale_of_which_nothing_is_known_is_positive(void **state)
{
	const double bound[LP_NNLS_MAX] = {0.3, 0.1};
	struct lp_nnls normal = {.count = 2};
	struct lp_ring_posterior found;

	(void)state;
	/* scale + x = 1 +- 0.01 */
	for (int i = 0; i < 2; i++) {
		normal.right[i] = 1e4;
		for (int j = 0; j < 2; j++)
			normal.normal[i][j] = 1e4 + (i == j) * 1e-3;
	}
	lp_ring_posterior(&normal, bound, &found);
	assert_true(found.scale > 0.2 && found.scale < 0.9);
	assert_true(found.scale_sigma > 0.15 && found.scale_sigma < 0.5);
	assert_true(found.mean[1] > 0.0);
}

/* Input that differs a little gives a result that differs a little. */
static void test_the_result_is_smooth(void **state)
{
	const double bound[LP_NNLS_MAX] = {0.0, 0.5};
	const struct lp_nnls normal = one_part(4.0, 10.0), near = one_part(4.0, 10.01);
	struct lp_ring_posterior a, b;

	(void)state;
	lp_ring_posterior(&normal, bound, &a);
	lp_ring_posterior(&near, bound, &b);
	assert_float_equal(b.mean[1], a.mean[1], 0.05);
	assert_true(b.mean[1] > a.mean[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_one_part_is_as_by_integration),
		cmocka_unit_test(test_parts_that_look_alike),
		cmocka_unit_test(test_a_scale_of_which_nothing_is_known_is_positive),
		cmocka_unit_test(test_the_result_is_smooth),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
