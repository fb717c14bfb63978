/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/sh.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

static void random_direction(double d[3])
{
	double length = 0.0;

	do {
		length = 0.0;
		for (int a = 0; a < 3; a++) {
			d[a] = 2.0 * rand() / RAND_MAX - 1.0;
			length += d[a] * d[a];
		}
	} while (length < 0.01 || length > 1.0);
	for (int a = 0; a < 3; a++)
		d[a] /= sqrt(length);
}

/* The closed forms of docs/users/conventions.md. */
static void test_basis_is_the_convention(void **state)
{
	(void)state;
	for (int n = 0; n < 100; n++) {
		double d[3], y[LP_SH_MAX_COUNT];

		random_direction(d);
		const double expected[9] = {.28209479177387814,
					    .48860251190291992 * d[1],
					    .48860251190291992 * d[2],
					    .48860251190291992 * d[0],
					    1.0925484305920792 * d[0] * d[1],
					    1.0925484305920792 * d[1] * d[2],
					    .31539156525252005 * (3 * d[2] * d[2] - 1),
					    1.0925484305920792 * d[0] * d[2],
					    .54627421529603959 * (d[0] * d[0] - d[1] * d[1])};
		lp_sh_basis(8, d, y);
		for (int i = 0; i < 9; i++)
			assert_float_equal(y[i], expected[i], 1e-12);
	}
}

/* Sum over m of Y_lm(a) Y_lm(b) = (2 l + 1) / 4 pi P_l(a . b): ties all orders down, at the poles
 * too. */
static void test_addition_theorem(void **state)
{
	(void)state;
	for (int n = 0; n < 200; n++) {
		double a[3] = {0.0, 0.0, 1.0}, b[3], ya[LP_SH_MAX_COUNT], yb[LP_SH_MAX_COUNT];
		double previous = 1.0, legendre, dot;

		if (n > 1)
			random_direction(a);
		random_direction(b);
		lp_sh_basis(8, a, ya);
		lp_sh_basis(8, b, yb);
		dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
		legendre = dot;
		for (int l = 1; l <= 8; l++) {
			double sum = 0.0;

			for (int i = l * l; i < (l + 1) * (l + 1); i++)
				sum += ya[i] * yb[i];
			assert_float_equal(sum, (2 * l + 1) / (4.0 * M_PI) * legendre, 1e-12);
			const double next = ((2 * l + 1) * dot * legendre - l * previous) / (l + 1);
			previous = legendre;
			legendre = next;
		}
	}
}

static void test_cosine_factors(void **state)
{
	const double expected[9] = {M_PI, 2 * M_PI / 3, M_PI / 4, 0,	      -M_PI / 24,
				    0,	  M_PI / 64,	0,	  -M_PI / 128};

	(void)state;
	for (int l = 0; l <= 8; l++)
		assert_float_equal(lp_sh_cosine(l), expected[l], 1e-12);
}

/* Band factor of a disc against the definition, by quadrature: mean of P_l over the disc. */
static void test_disc_factors(void **state)
{
	const double radii[] = {1e-6, 1e-4, 1e-3, 2e-3, 0.01, 0.3, 1.5};

	(void)state;
	for (unsigned int r = 0; r < LP_COUNT(radii); r++)
		for (int l = 0; l <= 8; l++) {
			const int steps = 4000;
			double mean = 0.0;

			for (int k = 0; k < steps; k++) {
				const double c = 1.0 - (1.0 - cos(radii[r])) * (k + 0.5) / steps;
				double previous = 1.0, legendre = l ? c : 1.0;

				for (int j = 1; j < l; j++) {
					const double next =
						((2 * j + 1) * c * legendre - j * previous) /
						(j + 1);
					previous = legendre;
					legendre = next;
				}
				mean += legendre / steps;
			}
			assert_float_equal(lp_sh_disc(l, radii[r]), mean, 1e-6);
		}
}

/* A unit light left in an order-2 SH gives 1.0625 on the surface that faces it
 * (docs/users/conventions.md). */
static void test_lamp_left_in_order_2(void **state)
{
	const float direction[3] = {0.0F, 1.0F, 0.0F}, unit[3] = {1.0F, 1.0F, 1.0F};
	const float down[3] = {0.0F, -1.0F, 0.0F};
	double sh[LP_SH_MAX_COUNT][3] = {{0.0}};
	float coefficients[9][3], facing[3];

	(void)state;
	lp_sh_add_lamp(2, direction, unit, 0.0, 1.0, sh);
	for (int i = 0; i < 9; i++)
		for (int c = 0; c < 3; c++)
			coefficients[i][c] = (float)sh[i][c];
	lp_sh_irradiance(2, (const float(*)[3])coefficients, direction, facing);
	assert_float_equal(facing[0], 1.0625, 1e-5);
	lp_sh_irradiance(2, (const float(*)[3])coefficients, down, facing);
	assert_float_equal(facing[0], 0.0625, 1e-5);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_basis_is_the_convention),
		cmocka_unit_test(test_addition_theorem),
		cmocka_unit_test(test_cosine_factors),
		cmocka_unit_test(test_disc_factors),
		cmocka_unit_test(test_lamp_left_in_order_2),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
