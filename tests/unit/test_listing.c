/* SPDX-License-Identifier: Apache-2.0 */
/* Lists of lamps with memory: nothing pops, and AMBIENT + lights = TOTAL. */
#include "light/send/listing.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "light/send/model.h"
#include "lp_test.h"

#define FRAME_NS 33333333LL

static struct lp_light lamp(uint32_t id, float strength)
{
	const float a = (float)id;

	return (struct lp_light){.id = id,
				 .direction = {sinf(a), 0.0F, -cosf(a)},
				 .irradiance = {strength, strength, strength}};
}

/* Lamps 1 .. count of the given strengths, strongest first; id 0: not there. */
static struct lp_light_estimate at(int n, const float *strengths, int count)
{
	struct lp_light_estimate e = {.t_capture_ns = n * FRAME_NS};

	e.sh_total[0][0] = e.sh_total[0][1] = e.sh_total[0][2] = 5.0F;
	for (int k = 0; k < count; k++) {
		const struct lp_light light = lamp(1 + (uint32_t)k, strengths[k]);
		int place = e.light_count;

		if (!(strengths[k] > 0.0F))
			continue;
		for (; place > 0 && e.lights[place - 1].irradiance[0] < strengths[k]; place--)
			e.lights[place] = e.lights[place - 1];
		e.lights[place] = light;
		e.light_count++;
	}
	for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
		for (int k = 0; k <= LP_MAX_LIGHTS; k++)
			e.predicted_error[l][k] = 0.5F / (float)(1 + l + k);
	return e;
}

static float share_of(const struct lp_light_estimate *listed, uint32_t id, float strength)
{
	for (int k = 0; k < listed->light_count; k++)
		if (listed->lights[k].id == id)
			return listed->lights[k].irradiance[0] / strength;
	return 0.0F;
}

static const struct lp_listing_limits four = {.sh_order = 2, .lights = 4};

/* Five lamps of nearly equal strength in noise: the first four stay. */
static void test_noise_moves_nothing(void **state)
{
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;

	(void)state;
	srand(1);
	for (int n = 0; n < 3000; n++) {
		float strengths[6];

		for (int k = 0; k < 6; k++)
			strengths[k] =
				1.0F - 0.02F * (float)k + 0.2F * (float)rand() / (float)RAND_MAX;
		const struct lp_light_estimate e = at(n, strengths, 6);
		uint32_t ids = 0;

		assert_int_equal(lp_listing_update(&listing, &e, &four, &listed), 2);
		assert_int_equal(listed.light_count, 4);
		assert_true(listed.flags & LP_ESTIMATE_MORE_LIGHTS);
		for (int k = 0; k < 4; k++)
			ids |= 1U << listed.lights[k].id;
		static uint32_t first;

		if (n == 0)
			first = ids;
		assert_int_equal(ids, first);
	}
}

/* A subscriber without reflections: the next lamps take their places, and one that turns out to be
 * a reflection fades. */
static void test_reflections_are_left_out(void **state)
{
	const struct lp_listing_limits limits = {.sh_order = 2,
						 .lights = 2,
						 .leave_out_reflections = true};
	const float strengths[] = {5.0F, 4.0F, 3.0F, 2.0F};
	const float most = 1.2F * (float)FRAME_NS / 1e9F / LP_LISTING_FADE_S;
	struct lp_listing listing = {0};
	struct lp_light_estimate listed, others;
	float before = 1.0F;

	(void)state;
	for (int n = 0; n < 100; n++) {
		struct lp_light_estimate e = at(n, strengths, 4);

		e.lights[1].flags = LP_LIGHT_REFLECTION;
		if (n >= 20)
			e.lights[0].flags = LP_LIGHT_REFLECTION;
		lp_listing_update(&listing, &e, &limits, &listed);
		assert_true(listed.flags & LP_ESTIMATE_MORE_LIGHTS);
		float share = 0.0F;

		for (int k = 0; k < listed.light_count; k++) {
			assert_int_not_equal(listed.lights[k].id, 2);
			if (listed.lights[k].id == 1)
				share = listed.lights[k].irradiance[1] / 5.0F;
		}
		assert_true(fabsf(share - before) < most || n == 0);
		before = share;
		if (n < 20)
			assert_true(share == 1.0F);
	}
	assert_true(before == 0.0F);
	assert_int_equal(listed.light_count, 2);

	struct lp_light_estimate e = at(0, strengths, 4);

	e.lights[1].flags = LP_LIGHT_REFLECTION;
	for (int k = 0; k <= LP_MAX_LIGHTS; k++)
		e.predicted_error[2][k] = 0.9F - 0.1F * (float)k;
	lp_leave_out_reflections(&e, &others);
	assert_int_equal(others.light_count, 3);
	assert_int_equal(others.lights[1].id, 3);
	assert_true(others.predicted_error[2][1] == e.predicted_error[2][1]);
	assert_true(others.predicted_error[2][3] == e.predicted_error[2][1]); /* no better */
	assert_memory_equal(others.sh_total, e.sh_total, sizeof(e.sh_total));
}

/* A lamp that outshines one of the list for long enough takes its place: one fades, then the other
 * comes, and no packet moves more light than its time allows. */
static void test_a_stronger_lamp_takes_over(void **state)
{
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;
	float before = 1.0F, weak = 1.0F, strong = 0.0F;
	const float most = 1.2F * (float)FRAME_NS / 1e9F / LP_LISTING_FADE_S;

	(void)state;
	for (int n = 0; n < 200; n++) {
		const float strengths[] = {4.0F, 3.0F, 2.0F, 1.0F, n < 20 ? 0.5F : 1.6F};
		const struct lp_light_estimate e = at(n, strengths, 5);

		lp_listing_update(&listing, &e, &four, &listed);
		assert_true(listed.light_count <= 4);
		const float weak_now = share_of(&listed, 4, 1.0F);
		const float strong_now = share_of(&listed, 5, strengths[4]);

		assert_true(fabsf(weak_now - weak) <= most && fabsf(strong_now - strong) <= most);
		weak = weak_now;
		strong = strong_now;
		if (n < 25) /* it has not cost enough yet */
			assert_float_equal(weak, before, 0.0F);
	}
	assert_float_equal(weak, 0.0F, 0.0F);
	assert_float_equal(strong, 1.0F, 0.0F);
}

/* The sooner, the more light is left out: the product is the same. */
static void test_the_stronger_takes_over_sooner(void **state)
{
	static const struct {
		float strength;
		int least, most; /* frames */
	} cases[] = {{1.55F, 18, 21}, {3.0F, 4, 7}};

	(void)state;
	for (size_t c = 0; c < sizeof(cases) / sizeof(*cases); c++) {
		struct lp_listing listing = {0};
		struct lp_light_estimate listed;
		int left = -1;

		for (int n = 0; n < 600 && left < 0; n++) {
			const float strengths[] = {8.0F, 7.0F, 6.0F, 1.0F,
						   n < 300 ? 0.5F : cases[c].strength};
			const struct lp_light_estimate e = at(n, strengths, 5);

			lp_listing_update(&listing, &e, &four, &listed);
			if (share_of(&listed, 4, 1.0F) < 1.0F)
				left = n - 300;
		}
		assert_in_range(left, cases[c].least, cases[c].most);
	}
}

/* Several lamps outshine the weakest ones, as after the first frames, before the exposures fit: all
 * have taken over when cost and fading are past, not one after the other. */
static void test_several_take_over_at_once(void **state)
{
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;

	(void)state;
	for (int n = 0; n < 30; n++) {
		const float later = n < 2 ? 0.1F : 6.0F;
		const float strengths[] = {4.0F,  3.0F,		2.0F,	      1.0F,
					   later, later + 1.0F, later + 2.0F, 1.2F};
		const struct lp_light_estimate e = at(n, strengths, 8);

		lp_listing_update(&listing, &e, &four, &listed);
	}
	assert_int_equal(listed.light_count, 4);
	assert_float_equal(share_of(&listed, 1, 4.0F), 1.0F, 0.0F);
	for (uint32_t id = 5; id <= 7; id++)
		assert_true(share_of(&listed, id, 1.0F + (float)id) > 0.0F);
}

/* Whether the light with this id is in the list. */
static bool lists(const struct lp_light_estimate *listed, uint32_t id)
{
	return share_of(listed, id, 1.0F) > 0.0F;
}

/* A lamp that comes to a free place is listed at once. */
static void test_a_free_place_is_taken_at_once(void **state)
{
	static const float strengths[] = {4.0F, 3.0F};
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;

	(void)state;
	for (int n = 0; n < 300; n++) {
		const struct lp_light_estimate e = at(n, strengths, n < 200 ? 1 : 2);

		lp_listing_update(&listing, &e, &four, &listed);
		assert_int_equal(lists(&listed, 2), n >= 200);
	}
}

/* The place of a lamp that is lost is kept for it, until it has cost too much to leave out the next
 * one: the sooner, the stronger that is. */
static void test_a_lost_lamp_keeps_its_place(void **state)
{
	static const struct {
		float next;	 /* the fifth lamp's strength */
		int least, most; /* frames until it takes the place */
	} cases[] = {{0.05F, 102, 110}, {0.45F, 10, 13}, {0.9F, 4, 7}};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++)
		for (int comes_back = 0; comes_back < 2; comes_back++) {
			const int back = comes_back ? 300 + cases[i].least - 1 : 10000;
			struct lp_listing listing = {0};
			struct lp_light_estimate listed;
			int taken = -1;

			for (int n = 0; n < 600; n++) {
				const bool lost = n >= 300 && n < back;
				const float strengths[] = {4.0F, 3.0F, 2.0F, lost ? 0.0F : 1.0F,
							   cases[i].next};
				const struct lp_light_estimate e = at(n, strengths, 5);

				lp_listing_update(&listing, &e, &four, &listed);
				if (taken < 0 && lists(&listed, 5))
					taken = n - 300;
			}
			assert_int_equal(lists(&listed, 4), comes_back);
			if (comes_back)
				assert_int_equal(taken, -1);
			else
				assert_in_range(taken, cases[i].least, cases[i].most);
		}
}

/* What is not in the list is in AMBIENT, to the last share. */
static void test_shares_add_up(void **state)
{
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;

	(void)state;
	srand(2);
	for (int n = 0; n < 500; n++) {
		float strengths[7];

		for (int k = 0; k < 7; k++) /* coming and going, of any strength */
			strengths[k] =
				(n / 10 + k) % 5 ? 0.2F * (float)(1 + (n / 40 + 3 * k) % 7) : 0.0F;
		const struct lp_light_estimate e = at(n, strengths, 7);
		const struct lp_listing_limits limits = {.sh_order = 2, .lights = n / 100 + 1};
		const int order = lp_listing_update(&listing, &e, &limits, &listed);
		double sum[LP_MAX_SH_COUNT][3] = {{0}};
		float ambient[LP_MAX_SH_COUNT][3];

		lp_model_ambient(&listed, order, listed.light_count, ambient);
		for (int k = 0; k < listed.light_count; k++) {
			assert_true(k == 0 || listed.lights[k].irradiance[0] <=
						      listed.lights[k - 1].irradiance[0]);
			lp_sh_add_lamp(order, listed.lights[k].direction,
				       listed.lights[k].irradiance, 0.0, 1.0, sum);
		}
		for (int i = 0; i < LP_SH_COUNT(order); i++)
			assert_float_equal(ambient[i][1] + sum[i][1], e.sh_total[i][1], 1e-5);
	}
}

/* On the edge of its tolerance a subscription is not sent another model in every packet. */
static void test_models_do_not_flicker(void **state)
{
	const struct lp_listing_limits limits = {.sh_order = 4, .lights = 4, .tolerance = 0.1F};
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;
	int order = -1, changes = 0;

	(void)state;
	srand(3);
	for (int n = 0; n < 600; n++) {
		const float strengths[] = {4.0F, 3.0F, 2.0F, 1.0F};
		struct lp_light_estimate e = at(n, strengths, 4);
		const float noise = 0.95F + 0.1F * (float)rand() / (float)RAND_MAX;

		for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
			for (int k = 0; k <= LP_MAX_LIGHTS; k++)
				e.predicted_error[l][k] *= noise;
		const int now = lp_listing_update(&listing, &e, &limits, &listed);

		changes += now != order;
		order = now;
		assert_true(listed.predicted_error[order][listed.light_count] < 0.12F);
	}
	assert_true(changes <= 3);
	/* but what no longer does is left at once */
	const float strengths[] = {4.0F, 3.0F, 2.0F, 1.0F};
	struct lp_light_estimate e = at(600, strengths, 4);

	for (int l = 0; l < 4; l++)
		for (int k = 0; k <= LP_MAX_LIGHTS; k++)
			e.predicted_error[l][k] = 0.5F;
	assert_int_equal(lp_listing_update(&listing, &e, &limits, &listed), 4);
}

/* No lamp, no light allowed, time that stands still or goes back: no harm. */
static void test_edges(void **state)
{
	struct lp_listing listing = {0};
	struct lp_light_estimate listed;
	const struct lp_listing_limits none = {.sh_order = 0, .lights = 0};
	const float strengths[] = {4.0F, 3.0F};

	(void)state;
	for (int n = 0; n < 4; n++) {
		const struct lp_light_estimate e = at(n % 2 ? 5 : -5, strengths, n < 2 ? 0 : 2);

		lp_listing_update(&listing, &e, n == 3 ? &none : &four, &listed);
		assert_true(listed.light_count <= 2);
		for (int k = 0; k < listed.light_count; k++)
			assert_true(listed.lights[k].irradiance[0] > 0.0F);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_noise_moves_nothing),
		cmocka_unit_test(test_reflections_are_left_out),
		cmocka_unit_test(test_a_stronger_lamp_takes_over),
		cmocka_unit_test(test_the_stronger_takes_over_sooner),
		cmocka_unit_test(test_several_take_over_at_once),
		cmocka_unit_test(test_a_free_place_is_taken_at_once),
		cmocka_unit_test(test_a_lost_lamp_keeps_its_place),
		cmocka_unit_test(test_shares_add_up),
		cmocka_unit_test(test_models_do_not_flicker),
		cmocka_unit_test(test_edges),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
