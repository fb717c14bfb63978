/* SPDX-License-Identifier: Apache-2.0 */
/* Rotations of directions and of spherical harmonics. */
#include "light/math/rotation.h"

#include <math.h>
#include <stdlib.h>

#include "light/math/sh.h"
#include "lp_test.h"

static double uniform(void)
{
	return 2.0 * rand() / RAND_MAX - 1.0;
}

static void random_vector(double most_rad, double vector[3])
{
	double length;

	do {
		for (int a = 0; a < 3; a++)
			vector[a] = uniform();
		length =
			sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
	} while (length > 1.0 || length < 0.1);
	const double angle = most_rad * fabs(uniform());

	for (int a = 0; a < 3; a++)
		vector[a] *= angle / length;
}

static double apart(const struct lp_rotation *a, const struct lp_rotation *b)
{
	double most = 0.0;

	for (int i = 0; i < 9; i++)
		most = fmax(most, fabs(a->m[i / 3][i % 3] - b->m[i / 3][i % 3]));
	return most;
}

static void test_a_quarter_turn(void **state)
{
	const struct lp_rotation turn =
		lp_rotation_of_vector((const double[]){0.0, M_PI / 2.0, 0.0});
	double to[3];

	(void)state;
	lp_rotate(&turn, (const double[]){0.0, 0.0, -1.0}, to); /* about +Y, -Z goes to -X */
	assert_float_equal(to[0], -1.0, 1e-15);
	assert_float_equal(to[1], 0.0, 1e-15);
	assert_float_equal(to[2], 0.0, 1e-15);
}

/* Tiny ones, and those of almost half a turn, too. */
static void test_vectors_come_back(void **state)
{
	const double most[] = {1e-9, 1e-3, 1.0, M_PI - 1e-6};

	(void)state;
	srand(1);
	for (int n = 0; n < 4000; n++) {
		double vector[3], back[3];

		random_vector(most[n % 4], vector);
		const struct lp_rotation turn = lp_rotation_of_vector(vector);

		lp_rotation_vector(&turn, back);
		for (int a = 0; a < 3; a++)
			assert_float_equal(back[a], vector[a], 1e-8);
	}
}

static void test_products_and_inverses(void **state)
{
	struct lp_rotation far = lp_rotation_identity();

	(void)state;
	srand(2);
	for (int n = 0; n < 100000; n++) { /* rounding does not add up */
		double vector[3];

		random_vector(0.2, vector);
		const struct lp_rotation turn = lp_rotation_of_vector(vector);

		far = lp_rotation_product(&far, &turn);
	}
	const struct lp_rotation back = lp_rotation_inverse(&far);
	const struct lp_rotation none = lp_rotation_product(&back, &far);
	const struct lp_rotation identity = lp_rotation_identity();

	assert_true(apart(&none, &identity) < 1e-14);
	assert_true(lp_rotation_is_identity(&identity));
	assert_false(lp_rotation_is_identity(&far));
}

/* The light of lamps turned is the turned light of the lamps. */
static void test_spherical_harmonics_turn_with_lamps(void **state)
{
	(void)state;
	srand(3);
	for (int order = 0; order <= LP_SH_MAX_ORDER; order++)
		for (int n = 0; n < 20; n++) {
			double before[LP_SH_MAX_COUNT][3] = {{0}},
			       after[LP_SH_MAX_COUNT][3] = {{0}};
			float sh[LP_SH_MAX_COUNT][3];
			double vector[3];

			random_vector(M_PI, vector);
			const struct lp_rotation turn = lp_rotation_of_vector(vector);

			for (int k = 0; k < 5; k++) {
				double axis[3];

				random_vector(M_PI, axis);
				const struct lp_rotation to = lp_rotation_of_vector(axis);
				float d[3] = {(float)to.m[0][0], (float)to.m[1][0],
					      (float)to.m[2][0]};
				const float light[3] = {1.0F + (float)k, 2.0F, 3.0F};

				lp_sh_add_lamp(order, d, light, 0.1, 1.0, before);
				lp_rotate_direction(&turn, d);
				lp_sh_add_lamp(order, d, light, 0.1, 1.0, after);
			}
			for (int i = 0; i < (order + 1) * (order + 1); i++)
				for (int c = 0; c < 3; c++)
					sh[i][c] = (float)before[i][c];
			lp_sh_rotate(&turn, order, sh);
			for (int i = 0; i < (order + 1) * (order + 1); i++)
				for (int c = 0; c < 3; c++)
					assert_float_equal(sh[i][c], after[i][c], 2e-5);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_quarter_turn),
		cmocka_unit_test(test_vectors_come_back),
		cmocka_unit_test(test_products_and_inverses),
		cmocka_unit_test(test_spherical_harmonics_turn_with_lamps),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
