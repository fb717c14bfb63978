/* SPDX-License-Identifier: Apache-2.0 */
/* The least that suffices for what an app draws. */
#include "serve/drawn/drawn.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "light/send/model.h"
#include "lp_test.h"
#include "serve/drawn/drawn_light.h"
#include "serve/drawn/drawn_list.h"
#include "serve/drawn/drawn_map.h"
#include "serve/drawn/pace.h"

#define DIFFUSE LP_DRAWN_DIFFUSE
#define SHADOWS LP_DRAWN_SHADOWS
#define GLOSSY LP_DRAWN_GLOSSY
#define MIRRORS LP_DRAWN_MIRRORS

static struct lp_drawn_tables *tables;
static struct lp_drawn_room *room;

static int setup(void **state)
{
	(void)state;
	tables = lp_drawn_tables_create();
	room = lp_drawn_room_create();
	return tables && room ? 0 : -1;
}

static int teardown(void **state)
{
	(void)state;
	lp_drawn_tables_destroy(tables);
	lp_drawn_room_destroy(room);
	return 0;
}

/* Even light of radiance 1, and lamps that each bring less than the one before. */
static struct lp_light_estimate lit(int lamps)
{
	struct lp_light_estimate e = {.light_count = lamps, .relighting_sigma = 0.001F};
	double total[LP_SH_MAX_COUNT][3] = {{0.0}};

	for (int c = 0; c < 3; c++)
		total[0][c] = sqrt(4.0 * M_PI);
	for (int k = 0; k < lamps; k++) {
		const float a = 0.9F * (float)k, e_lamp = 3.0F / (float)((k + 1) * (k + 1));

		e.lights[k] = (struct lp_light){.id = (uint32_t)k + 1,
						.direction = {0.6F * cosf(a), 0.8F, 0.6F * sinf(a)},
						.irradiance = {e_lamp, e_lamp, e_lamp},
						.angular_radius_deg = 2.0F};
		lp_sh_add_lamp(LP_SH_MAX_ORDER, e.lights[k].direction, e.lights[k].irradiance, 0.0,
			       1.0, total);
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e.sh_total[i][c] = (float)total[i][c];
	lp_model_predict((const double(*)[3])total, &e);
	return e;
}

static struct lp_drawn draws(float diffuse, float shadows, float glossy, float mirrors)
{
	return (struct lp_drawn){{diffuse, shadows, glossy, mirrors}};
}

/* ---------------------------------------------------------------- errors of models */

static void test_all_lamps_leave_nothing_out(void **state)
{
	const struct lp_light_estimate e = lit(3);
	struct lp_drawn_models models;

	(void)state;
	lp_drawn_predict(tables, &e, false, &models);
	for (int t = 0; t < LP_DRAWN_BY_MODEL; t++) {
		assert_float_equal(models.left_out[t][0][3], 0.0F, 0.003);
		for (int k = 0; k < 3; k++)
			assert_true(models.left_out[t][0][k] > models.left_out[t][0][k + 1]);
	}
}

/* Light on matt things is what lp_model_predict() says of it. */
static void test_diffuse_is_the_known_prediction(void **state)
{
	struct lp_light_estimate e = lit(2);
	struct lp_drawn_models models;

	(void)state;
	lp_drawn_predict(tables, &e, false, &models);
	for (int k = 0; k <= 2; k++)
		for (int l = 0; l <= LP_MAX_SH_ORDER; l++) {
			float shadow = 0.0F;

			for (int j = k; j < 2; j++)
				shadow += lp_facing_share(&e, j);
			assert_float_equal(models.left_out[DIFFUSE][l][k],
					   e.predicted_error[l][k] - LP_SHADOW_SHARE * shadow,
					   1e-4);
		}
}

/* The table loses the shadow of a lamp that is only in SH of order 0: by hand, a lamp straight up
 * of irradiance E, whose light order 0 spreads evenly. */
static void test_a_shadow_that_is_lost(void **state)
{
	struct lp_light_estimate e = lit(1);
	struct lp_drawn_models models;

	(void)state;
	lp_drawn_predict(tables, &e, false, &models);
	/* of 3.14 + 2.4 the lamp brings 2.4; a fifth of the table is in its shadow or lit wrongly
	 */
	assert_true(models.left_out[SHADOWS][0][0] > 0.15F);
	assert_true(models.left_out[SHADOWS][0][0] < 0.45F);
	assert_true(models.left_out[SHADOWS][4][0] < models.left_out[SHADOWS][0][0]);
}

/* ---------------------------------------------------------------- what suffices */

static void test_the_light_uses_up_part_of_the_tolerance(void **state)
{
	struct lp_drawn_models models = {.screen_slope = 0.2F};
	const struct lp_drawn asked = draws(0.05F, 0.0F, 0.05F, 0.0F);
	float share[LP_MAX_SH_ORDER + 1][LP_MAX_LIGHTS + 1];

	(void)state;
	models.left_out[DIFFUSE][1][2] = 0.04F;
	models.left_out[SHADOWS][1][2] = 0.9F; /* is not drawn */
	models.left_out[GLOSSY][1][2] = 0.1F;
	lp_drawn_shares(&models, &asked, 0.0F, true, share);
	assert_float_equal(share[1][2], 0.8F, 1e-5);
	lp_drawn_shares(&models, &asked, 0.015F, true, share);
	assert_float_equal(share[1][2], 1.0F, 1e-4); /* 3, 4, 5 */
	lp_drawn_shares(&models, &asked, 0.0F, false, share);
	assert_float_equal(share[1][2], 2.0F, 1e-5);
	/* light that is known much worse than asked: what is asked may be left out, and no more */
	lp_drawn_shares(&models, &asked, 0.5F, true, share);
	assert_float_equal(share[1][2], 0.8F, 1e-5);
	lp_drawn_shares(&models, &asked, NAN, true, share);
	assert_float_equal(share[1][2], 0.8F, 1e-5);
}

static const struct lp_drawn_maps maps = {.size = 64,
					  .glossy = {0.008F, 0.002F, 0.0005F},
					  .mirrors = {0.1F, 0.02F, 0.005F},
					  .glossy_slope = 0.2F,
					  .mirror_slope = 0.2F};

static int choose(struct lp_drawn_map_choice *choice, const struct lp_drawn_maps *known,
		  struct lp_drawn asked, float model_share, int most, double t_s)
{
	return lp_drawn_choose_map(choice, known, &asked, 0.001F, model_share, most,
				   (int64_t)(t_s * 1e9));
}

static void test_the_least_map_that_suffices(void **state)
{
	const struct lp_drawn_maps unknown = {0};
	struct lp_drawn_map_choice choice = {0};

	(void)state;
	assert_int_equal(choose(&choice, &unknown, draws(0, 0, 0, 0.05F), 0, 64, 1.0), 64);
	choice = (struct lp_drawn_map_choice){0};
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.05F), 0, 64, 1.0), 32);
	/* more is asked for: at once; less: after a while */
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.01F), 0, 64, 1.1), 64);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.05F), 0, 64, 1.2), 64);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.05F), 0, 64, 3.0), 64);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.05F), 0, 64, 3.3), 32);
	/* never more than allowed, and the best of that where none suffices */
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.001F), 0, 16, 3.4), 16);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.001F), 0, 64, 3.5), 64);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0, 0.001F), 0, 0, 3.6), 0);
	assert_int_equal(choose(&choice, &maps, draws(0.1F, 0.1F, 0, 0), 9, 64, 3.7), 0);
}

static void test_glossy_things_without_a_map(void **state)
{
	struct lp_drawn_map_choice choice = {0};

	(void)state;
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0.02F, 0), 0.7F, 64, 1.0), 0);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0.02F, 0), 1.2F, 64, 1.1), 16);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0.02F, 0), 0.9F, 64, 9.0), 16);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0.02F, 0), 0.7F, 64, 9.1), 16);
	assert_int_equal(choose(&choice, &maps, draws(0, 0, 0.02F, 0), 0.7F, 64, 11.2), 0);
}

static void test_what_is_stated(void **state)
{
	const float left_out[] = {0.03F, 0.0F, 0.02F};
	const struct lp_drawn asked = draws(0.01F, 0, 0.1F, 0.1F);
	struct lp_drawn stated = lp_drawn_stated(left_out, 0.25F, &maps, &asked, 0.02F, 32);

	(void)state;
	assert_float_equal(stated.of[DIFFUSE], 0.05F, 1e-6);
	assert_true(isnan(stated.of[SHADOWS]));
	assert_float_equal(stated.of[GLOSSY], hypotf(0.002F, 0.008F), 1e-6);
	assert_float_equal(stated.of[MIRRORS], hypotf(0.02F, 0.008F), 1e-6);
	/* without a map: by the model, and of mirrors nothing is known */
	stated = lp_drawn_stated(left_out, 0.25F, &maps, &asked, 0.02F, 0);
	assert_float_equal(stated.of[GLOSSY], hypotf(0.02F, 0.01F), 1e-6);
	assert_float_equal(stated.of[MIRRORS], 1.0F, 1e-6);
	/* nobody knows how well the light is known */
	stated = lp_drawn_stated(left_out, 0.25F, &maps, &asked, NAN, 0);
	assert_true(isnan(stated.of[DIFFUSE]));
	assert_false(isnan(lp_drawn_of_map(&maps, 64, 0.02F).of[MIRRORS]));
	assert_true(isnan(lp_drawn_of_map(&maps, 64, NAN).of[MIRRORS]));
}

/* ---------------------------------------------------------------- lists */

static struct lp_drawn_packet list(struct lp_drawn_state *state, struct lp_light_estimate *estimate,
				   struct lp_drawn asked, bool raw,
				   struct lp_light_estimate *listed)
{
	const struct lp_drawn_wish wish = {.on = true, .raw = raw, .tolerance = asked};
	const struct lp_listing_limits limits = {.sh_order = 4,
						 .lights = 8,
						 .areas = true,
						 .tolerance = 1.0F};
	struct lp_drawn_packet packet;

	lp_drawn_room_forget(room);
	estimate->t_capture_ns += LP_NS_PER_S / 10;
	lp_drawn_list(room, estimate, &wish, &limits, state, listed, &packet);
	return packet;
}

static void test_a_packet_is_the_least_that_suffices(void **state)
{
	struct lp_light_estimate e = lit(4), listed;

	(void)state;
	for (int raw = 0; raw < 2; raw++) {
		struct lp_drawn_state fresh = {0};
		struct lp_drawn_packet packet =
			list(&fresh, &e, draws(0.3F, 0, 0, 0), raw, &listed);

		assert_true(listed.light_count <= 1);
		assert_true(packet.stated.of[DIFFUSE] <= 0.3F);
		fresh = (struct lp_drawn_state){0};
		packet = list(&fresh, &e, draws(0, 0.01F, 0, 0), raw, &listed);
		assert_true(listed.light_count >= 3);
		assert_true(packet.stated.of[SHADOWS] <= 0.01F);
		fresh = (struct lp_drawn_state){0};
		packet = list(&fresh, &e, draws(0, 0, 0, 0), raw, &listed); /* nothing is drawn */
		assert_int_equal(listed.light_count, 0);
		assert_int_equal(packet.sh_order, 0);
	}
}

/* A strong window stands before a weak lamp, though the estimate lists lamps first. */
static void test_a_window_comes_before_weaker_lamps(void **state)
{
	struct lp_light_estimate e = lit(2), listed;
	struct lp_drawn_state fresh = {0};

	(void)state;
	e.area_count = 1;
	e.lights[1] = e.lights[0];
	e.lights[1].id = 7;
	e.lights[1].flags = LP_LIGHT_EXTENDED;
	e.lights[1].half_angle_deg[0] = e.lights[1].half_angle_deg[1] = 12.0F;
	e.lights[1].angular_radius_deg = 12.0F;
	e.lights[1].axis[0] = 0.8F;
	e.lights[1].axis[1] = -0.6F;
	for (int c = 0; c < 3; c++)
		e.lights[0].irradiance[c] *= 0.2F;
	list(&fresh, &e, draws(0, 0.01F, 0, 0), false, &listed);
	assert_true(listed.light_count >= 1);
	assert_int_equal(listed.lights[0].id, 7);
}

/* ---------------------------------------------------------------- maps */

static void test_maps_are_measured_on_themselves(void **state)
{
	struct lp_cube_grid *grids[LP_DRAWN_SIZES];
	struct lp_drawn_maps found;

	(void)state;
	for (int k = 0; k < LP_DRAWN_SIZES; k++)
		assert_int_equal(lp_cube_grid_create(16 << k, &grids[k]), 0);
	struct lp_drawn_mirrors *mirrors = lp_drawn_mirrors_create(64, grids);

	assert_non_null(mirrors);
	float *plane = lp_drawn_mirrors_luminance(mirrors, 64);

	for (int k = 0; k < LP_DRAWN_SIZES; k++)
		memset(lp_drawn_mirrors_lamps(mirrors, 16 << k), 0,
		       (size_t)grids[k]->texels * sizeof(float));

	for (int i = 0; i < grids[2]->texels; i++) { /* smooth, with edges of a few degrees */
		float to[3];

		lp_cube_direction(64, i, to);
		plane[i] = 1.0F + 0.8F * tanhf(20.0F * sinf(3.0F * to[0]) * cosf(4.0F * to[1]));
	}
	lp_drawn_measure(mirrors, 64, &found);
	assert_int_equal(found.size, 64);
	assert_true(found.mirrors[2] > 0.0F && found.mirrors[2] < 0.02F);
	for (int k = 0; k < 2; k++) {
		assert_true(found.mirrors[k] > found.mirrors[k + 1]);
		assert_true(found.glossy[k] > found.glossy[k + 1]);
		assert_true(found.glossy[k] < found.mirrors[k]);
	}
	memset(plane, 0, (size_t)grids[2]->texels * sizeof(float)); /* a black room */
	lp_drawn_measure(mirrors, 64, &found);
	assert_int_equal(found.size, 0);
	lp_drawn_mirrors_destroy(mirrors);
	for (int k = 0; k < LP_DRAWN_SIZES; k++)
		lp_cube_grid_destroy(grids[k]);
}

static void test_a_map_when_the_light_has_changed(void **state)
{
	const struct lp_drawn asked = draws(0.001F, 0, 0, 0.05F);
	struct lp_light_estimate e = lit(1);
	struct lp_drawn_pace pace = {0};

	(void)state;
	assert_true(lp_drawn_pace_is_due(&pace, &e, &asked, LP_NS_PER_S));
	lp_drawn_pace_note(&pace, &e, LP_NS_PER_S);
	assert_false(lp_drawn_pace_is_due(&pace, &e, &asked, LP_NS_PER_S + 1));
	for (int c = 0; c < 3; c++)
		e.sh_total[3][c] += 0.04F * e.sh_total[0][c];
	assert_false(lp_drawn_pace_is_due(&pace, &e, &asked, LP_NS_PER_S + 1));
	for (int c = 0; c < 3; c++)
		e.sh_total[3][c] += 0.04F * e.sh_total[0][c];
	assert_true(lp_drawn_pace_is_due(&pace, &e, &asked, LP_NS_PER_S + 1));
	e = lit(1);
	assert_true(lp_drawn_pace_is_due(&pace, &e, &asked, 2 * LP_NS_PER_S));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_all_lamps_leave_nothing_out),
		cmocka_unit_test(test_diffuse_is_the_known_prediction),
		cmocka_unit_test(test_a_shadow_that_is_lost),
		cmocka_unit_test(test_the_light_uses_up_part_of_the_tolerance),
		cmocka_unit_test(test_the_least_map_that_suffices),
		cmocka_unit_test(test_glossy_things_without_a_map),
		cmocka_unit_test(test_what_is_stated),
		cmocka_unit_test(test_a_packet_is_the_least_that_suffices),
		cmocka_unit_test(test_a_window_comes_before_weaker_lamps),
		cmocka_unit_test(test_maps_are_measured_on_themselves),
		cmocka_unit_test(test_a_map_when_the_light_has_changed),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
