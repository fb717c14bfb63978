/* SPDX-License-Identifier: Apache-2.0 */
/* KEY: one directional light out of smooth light, as a continuous function of it. */
#include "light/send/key.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "light/math/sh.h"
#include "lp_test.h"

static float number(float least, float most)
{
	return least + (most - least) * (float)rand() / (float)RAND_MAX;
}

/* Light as it may be: a sky, and up to three lamps of any colour. */
static void random_light(float (*sh)[3])
{
	double sum[LP_MAX_SH_COUNT][3] = {{0.0}};
	const int lamps = rand() % 4;

	for (int c = 0; c < 3; c++)
		sum[0][c] = 3.5 * (double)number(0.2F, 2.0F);
	for (int k = 0; k < lamps; k++) {
		float d[3], irradiance[3], length = 0.0F;

		for (int a = 0; a < 3; a++) {
			d[a] = number(-1.0F, 1.0F);
			length += d[a] * d[a];
			irradiance[a] = number(0.0F, 4.0F);
		}
		for (int a = 0; a < 3; a++)
			d[a] /= sqrtf(length);
		lp_sh_add_lamp(LP_MAX_SH_ORDER, d, irradiance, 0.3, 1.0, sum);
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = (float)sum[i][c];
}

static float flux_change(const struct lp_light *a, const struct lp_light *b)
{
	float sum = 0.0F;

	for (int axis = 0; axis < 3; axis++)
		for (int c = 0; c < 3; c++) {
			const float change = a->direction[axis] * a->irradiance[c] -
					     b->direction[axis] * b->irradiance[c];

			sum += change * change;
		}
	return sqrtf(sum);
}

/* What KEY does to a surface is E d: it moves by no more than a fixed multiple of a change of the
 * SH, wherever the light comes from. */
static void test_a_small_change_of_light_is_a_small_change_of_key(void **state)
{
	float sh[LP_MAX_SH_COUNT][3], other[LP_MAX_SH_COUNT][3];

	(void)state;
	srand(5);
	for (int n = 0; n < 20000; n++) {
		const float size = powf(10.0F, number(-5.0F, -1.0F));
		float change = 0.0F;

		random_light(sh);
		for (int i = 1; i < 4 && n % 3 == 0; i++) /* from nearly nowhere */
			for (int c = 0; c < 3; c++)
				sh[i][c] *= size;
		memcpy(other, sh, sizeof(other));
		for (int i = 0; i < 4; i++)
			for (int c = 0; c < 3; c++) {
				const float d = size * number(-1.0F, 1.0F);

				other[i][c] += d;
				change += d * d;
			}
		const struct lp_light a = lp_key_light((const float(*)[3])sh);
		const struct lp_light b = lp_key_light((const float(*)[3])other);

		assert_true(flux_change(&a, &b) <= 25.0F * sqrtf(change) + 1e-5F);
	}
}

static void test_key_and_the_rest_are_the_whole(void **state)
{
	float sh[LP_MAX_SH_COUNT][3], rest[LP_MAX_SH_COUNT][3];

	(void)state;
	srand(6);
	for (int n = 0; n < 200; n++) {
		random_light(sh);
		const struct lp_light key = lp_key_light((const float(*)[3])sh);

		for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
			double sum[LP_MAX_SH_COUNT][3] = {{0.0}};

			memcpy(rest, sh, sizeof(rest));
			lp_key_remove(order, &key, rest);
			lp_sh_add_lamp(order, key.direction, key.irradiance, 0.0, 1.0, sum);
			for (int i = 0; i < LP_SH_COUNT(order); i++)
				for (int c = 0; c < 3; c++)
					assert_float_equal(rest[i][c] + sum[i][c], sh[i][c], 1e-5);
			assert_true(lp_luminance(rest[0]) >= 0.0F);
		}
	}
}

static void test_key_points_at_the_only_lamp(void **state)
{
	const float direction[3] = {0.6F, 0.0F, -0.8F}, irradiance[3] = {3.0F, 2.0F, 1.0F};
	double sum[4][3] = {{0.0}};
	float sh[4][3];

	(void)state;
	lp_sh_add_lamp(1, direction, irradiance, 0.0, 1.0, sum);
	for (int i = 0; i < 4; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = (float)sum[i][c];
	const struct lp_light key = lp_key_light((const float(*)[3])sh);

	for (int a = 0; a < 3; a++) {
		assert_float_equal(key.direction[a], direction[a], 1e-5);
		assert_float_equal(key.irradiance[a] / irradiance[a], LP_KEY_SHARE, 0.06);
	}
	assert_float_equal(key.irradiance[0] / key.irradiance[2], 3.0, 1e-4);
}

static void test_light_from_everywhere_has_no_key(void **state)
{
	float sh[4][3] = {{1.0F, 1.0F, 1.0F}};

	(void)state;
	for (int k = 0; k < 2; k++) {
		const struct lp_light key = lp_key_light((const float(*)[3])sh);

		for (int c = 0; c < 3; c++)
			assert_float_equal(key.irradiance[c], 0.0, 0.0);
		assert_float_equal(key.direction[1], 1.0, 0.0);
		memset(sh, 0, sizeof(sh)); /* darkness */
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_small_change_of_light_is_a_small_change_of_key),
		cmocka_unit_test(test_key_and_the_rest_are_the_whole),
		cmocka_unit_test(test_key_points_at_the_only_lamp),
		cmocka_unit_test(test_light_from_everywhere_has_no_key),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
