/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/model.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

/* Random ambient light in the bands up to 8 and lamps on top. */
static struct lp_light_estimate random_estimate(int lights, double total[LP_SH_MAX_COUNT][3])
{
	struct lp_light_estimate e = {.light_count = lights};

	for (int i = 0; i < LP_SH_MAX_COUNT; i++)
		for (int c = 0; c < 3; c++)
			total[i][c] = i ? (rand() / (double)RAND_MAX - 0.5) / (1 + i) : 5.0;
	for (int k = 0; k < lights; k++) {
		const float a = 0.7F * (float)k;

		e.lights[k] = (struct lp_light){.direction = {cosf(a) * 0.6F, 0.8F, sinf(a) * 0.6F},
						.irradiance = {3.0F / (float)(k + 1), 2.0F, 1.0F}};
		lp_sh_add_lamp(LP_SH_MAX_ORDER, e.lights[k].direction, e.lights[k].irradiance, 0.0,
			       1.0, total);
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e.sh_total[i][c] = (float)total[i][c];
	return e;
}

/* E(AMBIENT) + sum of lights' own projection = E(TOTAL), for any choice of order and lights. */
static void test_the_invariant(void **state)
{
	double total[LP_SH_MAX_COUNT][3];
	const struct lp_light_estimate e = random_estimate(5, total);

	(void)state;
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++)
		for (int lights = 0; lights <= 5; lights++) {
			float ambient[LP_MAX_SH_COUNT][3];
			double sum[LP_SH_MAX_COUNT][3];

			lp_model_ambient(&e, order, lights, ambient);
			for (int i = 0; i < LP_SH_COUNT(order); i++)
				for (int c = 0; c < 3; c++)
					sum[i][c] = ambient[i][c];
			for (int k = 0; k < lights; k++)
				lp_sh_add_lamp(order, e.lights[k].direction, e.lights[k].irradiance,
					       0.0, 1.0, sum);
			for (int i = 0; i < LP_SH_COUNT(order); i++)
				for (int c = 0; c < 3; c++)
					assert_float_equal(sum[i][c], e.sh_total[i][c], 1e-5);
		}
}

/* The prediction against what it predicts: RMS over many normals of what the model leaves out. */
static void test_predicted_error_is_the_real_one(void **state)
{
	double total[LP_SH_MAX_COUNT][3];
	struct lp_light_estimate e = random_estimate(3, total);
	const int normals = 4000;

	(void)state;
	lp_model_predict((const double(*)[3])total, &e);
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		double squared = 0.0, mean = 0.0;

		for (int n = 0; n < normals; n++) { /* golden spiral */
			const double y = 1.0 - 2.0 * (n + 0.5) / normals, r = sqrt(1.0 - y * y);
			const double a = 2.0 * M_PI * 0.6180339887498949 * n;
			const double d[3] = {r * cos(a), y, r * sin(a)};
			double basis[LP_SH_MAX_COUNT], all = 0.0, lost = 0.0;

			lp_sh_basis(LP_SH_MAX_ORDER, d, basis);
			for (int l = 0; l <= LP_SH_MAX_ORDER; l++)
				for (int i = l * l; i < (l + 1) * (l + 1); i++) {
					const double v =
						lp_sh_cosine(l) * basis[i] *
						(0.2126 * total[i][0] + 0.7152 * total[i][1] +
						 0.0722 * total[i][2]);

					all += v;
					lost += l > order ? v : 0.0;
				}
			squared += lost * lost / normals;
			mean += all / normals;
		}
		const float shadows =
			lp_facing_share(&e, 0) + lp_facing_share(&e, 1) + lp_facing_share(&e, 2);
		assert_float_equal(e.predicted_error[order][0],
				   sqrt(squared) / mean + LP_SHADOW_SHARE * shadows, 1e-3);
	}
}

static void test_smallest_model_under_the_tolerance(void **state)
{
	double total[LP_SH_MAX_COUNT][3];
	struct lp_light_estimate e = random_estimate(3, total);
	int order, lights, loose_order, loose_lights;

	(void)state;
	lp_model_predict((const double(*)[3])total, &e);
	lp_model_choose(&e, 4, 8, 0.0F, &order, &lights);
	assert_int_equal(order, 4);
	assert_int_equal(lights, 3);
	for (float tolerance = 0.001F; tolerance < 1.0F; tolerance *= 1.5F) {
		lp_model_choose(&e, 4, 8, tolerance, &order, &lights);
		if (e.predicted_error[order][lights] > tolerance) /* none is good enough */
			assert_true(order == 4 && lights == 3);
		for (int l = 0; l <= order; l++) /* nothing smaller would do */
			for (int k = 0; k <= lights; k++)
				if (l != order || k != lights)
					assert_true(e.predicted_error[l][k] > tolerance);
	}
	lp_model_choose(&e, 4, 8, 100.0F, &loose_order, &loose_lights);
	assert_int_equal(loose_order, 0);
	assert_int_equal(loose_lights, 0);
}

/* A surface that faces up, in the dark but for two lamps: each has the share that it brings. With
 * an even sky of irradiance pi L the rest is the sky's. What shines from below brings nothing
 * there. */
static void test_shadow_strengths_on_a_surface_that_faces_up(void **state)
{
	struct lp_light_estimate e = {
		.light_count = 3,
		.lights = {{.direction = {0.6F, 0.8F, 0.0F}, .irradiance = {5.0F, 5.0F, 5.0F}},
			   {.direction = {0.0F, 0.5F, -0.8660254F},
			    .irradiance = {4.0F, 4.0F, 4.0F}},
			   {.direction = {0.0F, -1.0F, 0.0F}, .irradiance = {9.0F, 9.0F, 9.0F}}}};
	const float sky[] = {0.0F, 1.0F, 100.0F};

	(void)state;
	assert_true(isnan(lp_shadow_strength(&e.lights[0], 0.0F)));
	for (size_t s = 0; s < LP_COUNT(sky); s++) {
		const float rest = (float)M_PI * sky[s], sum = 5.0F * 0.8F + 4.0F * 0.5F + rest;
		double sh[LP_MAX_SH_COUNT][3] = {{0.0}};

		for (int c = 0; c < 3; c++)
			sh[0][c] = sky[s] * sqrt(4.0 * M_PI);
		for (int k = 0; k < e.light_count; k++)
			lp_sh_add_lamp(LP_MAX_SH_ORDER, e.lights[k].direction,
				       e.lights[k].irradiance, 0.0, 1.0, sh);
		for (int i = 0; i < LP_MAX_SH_COUNT; i++)
			for (int c = 0; c < 3; c++)
				e.sh_total[i][c] = (float)sh[i][c];
		const float upward = lp_upward_irradiance(&e);

		assert_float_equal(upward, sum, 1e-4F * sum);
		assert_float_equal(lp_shadow_strength(&e.lights[0], upward), 4.0F / sum, 1e-4F);
		assert_float_equal(lp_shadow_strength(&e.lights[1], upward), 2.0F / sum, 1e-4F);
		assert_true(lp_shadow_strength(&e.lights[2], upward) == 0.0F);
	}
}

/* SH that swing below zero up there do not make shares of more than all light. */
static void test_shadow_strengths_add_up_to_1_at_most(void **state)
{
	double total[LP_SH_MAX_COUNT][3];
	struct lp_light_estimate e = random_estimate(4, total);
	float sum = 0.0F;

	(void)state;
	for (int c = 0; c < 3; c++)
		e.sh_total[0][c] = 0.0F;
	const float upward = lp_upward_irradiance(&e);

	for (int k = 0; k < e.light_count; k++)
		sum += lp_shadow_strength(&e.lights[k], upward);
	assert_float_equal(sum, 1.0F, 1e-5F);
	e.sh_total[6][1] = NAN;
	assert_true(isnan(lp_shadow_strength(&e.lights[0], lp_upward_irradiance(&e))));
}

/* An even sky needs one number. */
static void test_overcast(void **state)
{
	double total[LP_SH_MAX_COUNT][3] = {{3.0, 3.0, 3.0}};
	struct lp_light_estimate e = {.sh_total = {{3.0F, 3.0F, 3.0F}}};
	int order, lights;

	(void)state;
	lp_model_predict((const double(*)[3])total, &e);
	lp_model_choose(&e, 4, 8, 0.001F, &order, &lights);
	assert_int_equal(order, 0);
	assert_int_equal(lights, 0);
	total[0][0] = total[0][1] = total[0][2] = 0.0; /* black: no division by nothing */
	lp_model_predict((const double(*)[3])total, &e);
	assert_float_equal(e.predicted_error[0][0], 0.0, 0.0);
}

/* An even light that is half as strong, and one from another side. */
static void test_distance(void **state)
{
	const struct lp_light_estimate even = {.sh_total = {{2.0F, 2.0F, 2.0F}}},
				       half = {.sh_total = {{1.0F, 1.0F, 1.0F}}}, black = {0};
	struct lp_light_estimate sided = even;

	(void)state;
	/* band 1: 2 pi/3 for each normal, against pi/2 L00 on average over sqrt(4 pi) normals */
	sided.sh_total[1][0] = sided.sh_total[1][1] = sided.sh_total[1][2] = 1.0F;
	assert_float_equal(lp_model_distance(&even, &even), 0.0, 0.0);
	assert_float_equal(lp_model_distance(&even, &half), 0.5, 1e-6);
	assert_float_equal(lp_model_distance(&even, &sided), 1.0 / 3.0, 1e-6);
	assert_float_equal(lp_model_distance(&black, &even), 0.0, 0.0);
}

/* A wall keeps its place against a lamp that is turned with it; turned back, all is as before. */
static void test_the_room_turns_with_the_light(void **state)
{
	const struct lp_rotation turn = lp_rotation_of_vector((const double[]){0.3, -0.7, 0.2});
	const struct lp_rotation back = lp_rotation_inverse(&turn), still = lp_rotation_identity();
	struct lp_light_estimate e = {.light_count = 1,
				      .room = {.known = true,
					       .walls_m = {1, 2, 3, 4, 5, 6},
					       .xyzw = {0, 0.6F, 0, 0.8F}}};
	const struct lp_estimate_room before = e.room;
	const struct lp_rotation box = lp_rotation_of_quaternion((const double[]){0, 0.6, 0, 0.8});

	(void)state;
	for (int a = 0; a < 3; a++) /* a lamp at the middle of the wall at +x */
		e.lights[0].direction[a] = (float)box.m[a][0];
	lp_model_turn(&e, &still, 0.0F);
	assert_memory_equal(&e.room, &before, sizeof(before));
	lp_model_turn(&e, &turn, 0.0F);
	const struct lp_rotation there = lp_rotation_of_quaternion(
		(const double[]){e.room.xyzw[0], e.room.xyzw[1], e.room.xyzw[2], e.room.xyzw[3]});

	assert_true(fabsf(e.room.xyzw[0]) > 0.01F);
	for (int a = 0; a < 3; a++)
		assert_float_equal(there.m[a][0], e.lights[0].direction[a], 1e-6);
	assert_memory_equal(e.room.walls_m, before.walls_m, sizeof(before.walls_m));
	lp_model_turn(&e, &back, 0.0F);
	for (int i = 0; i < 4; i++)
		assert_float_equal(e.room.xyzw[i], before.xyzw[i], 1e-6);
	e.room = (struct lp_estimate_room){0}; /* nothing is made of nothing */
	lp_model_turn(&e, &turn, 0.0F);
	assert_true(e.room.xyzw[3] == 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_invariant),
		cmocka_unit_test(test_predicted_error_is_the_real_one),
		cmocka_unit_test(test_smallest_model_under_the_tolerance),
		cmocka_unit_test(test_shadow_strengths_on_a_surface_that_faces_up),
		cmocka_unit_test(test_shadow_strengths_add_up_to_1_at_most),
		cmocka_unit_test(test_overcast),
		cmocka_unit_test(test_distance),
		cmocka_unit_test(test_the_room_turns_with_the_light),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
