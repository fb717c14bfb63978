/* SPDX-License-Identifier: Apache-2.0 */
/* Lamps that flicker, and lamps that only change. */
#include "light/lamps/flicker.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define NOISE 0.02F
#define SHORT 1e4F /* scale of an exposure of 100 us */

static float noise(void)
{
	return NOISE * 3.46F * ((float)rand() / (float)RAND_MAX - 0.5F);
}

static void add(struct lp_flicker *f, float strength)
{
	const struct lp_lamp_strength one = {strength * (1.0F + noise()), NOISE, SHORT, false};

	lp_flicker_add(f, &one);
}

/* At 100 Hz and 30 frames a second; taken in every n-th frame. */
static float flickering(int n, float depth)
{
	return 1.0F + depth * cosf(2.0F * (float)M_PI * (float)(n % 3) / 3.0F + 0.4F);
}

static void test_steady_lamps_do_not(void **state)
{
	struct lp_flicker f = {.flickers = false};

	(void)state;
	srand(1);
	for (int n = 0; n < 10000; n++) {
		add(&f, 5.0F);
		assert_false(f.flickers);
	}
	assert_float_equal(f.mean, 5.0F, 0.05F);
}

/* Off and on again is no flicker, nor is a lamp that is dimmed slowly. */
static void test_changes_are_none(void **state)
{
	struct lp_flicker f = {.flickers = false};

	(void)state;
	for (int n = 0; n < 400; n++) {
		add(&f, n / 20 % 2 ? 5.0F : 2.0F);
		assert_false(f.flickers);
	}
	for (int n = 0; n < 400; n++) {
		add(&f, 5.0F + 3.0F * sinf((float)n * 0.05F));
		assert_false(f.flickers);
	}
}

static void test_the_mean_of_all_phases_is_reported(void **state)
{
	(void)state;
	for (int pairs = 0; pairs < 2; pairs++) {
		struct lp_flicker f = {.flickers = false};

		for (int n = 0; n < 60; n++) {
			/* in each frame; or twice in every four */
			const int frame = pairs ? n / 2 * 4 + n % 2 : n;

			add(&f, 4.0F * flickering(frame, 0.5F));
			if (n < 12)
				continue;
			assert_true(f.flickers);
			assert_float_equal(f.mean, 4.0F, 5.0F * f.sigma * 4.0F);
			if (n >= 24)
				assert_float_equal(f.mean, 4.0F, 0.2F);
		}
		assert_true(f.sigma < 0.04F);
		assert_float_equal(f.depth, 0.35F, 0.03F);
	}
}

/* A lamp that flickers and is dimmed to a half is its new mean soon. */
static void test_a_change_is_adopted_while_it_flickers(void **state)
{
	struct lp_flicker f = {.flickers = false};

	(void)state;
	for (int n = 0; n < 48; n++)
		add(&f, 4.0F * flickering(n, 0.5F));
	for (int n = 0; n < 12; n++)
		add(&f, 2.0F * flickering(n, 0.5F));
	assert_float_equal(f.mean, 2.0F, 0.15F);
	assert_true(f.flickers);
	for (int n = 0; n < 24; n++)
		add(&f, 2.0F); /* and then it does not flicker any more */
	for (int n = 0; n < 40 && f.flickers; n++)
		add(&f, 2.0F);
	assert_false(f.flickers);
}

/* Bright phases clip, and longer exposures clip more of them: the first make the mean a lower
 * bound, the others do not count. */
static void test_bounds(void **state)
{
	struct lp_flicker f = {.flickers = false};

	(void)state;
	for (int n = 0; n < 48; n++) {
		const float strength = flickering(n, 0.5F);
		const struct lp_lamp_strength brief = {fminf(strength, 1.2F), NOISE, SHORT,
						       strength > 1.2F};
		const struct lp_lamp_strength longer = {fminf(strength, 0.7F), NOISE, SHORT / 4.0F,
							strength > 0.7F};

		lp_flicker_add(&f, &brief);
		lp_flicker_add(&f, &longer);
	}
	assert_true(f.flickers);
	assert_true(lp_flicker_clips(&f));
	assert_true(f.mean > 0.85F && f.mean < 0.95F);
	assert_float_equal(f.scale, SHORT, 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_steady_lamps_do_not),
		cmocka_unit_test(test_changes_are_none),
		cmocka_unit_test(test_the_mean_of_all_phases_is_reported),
		cmocka_unit_test(test_a_change_is_adopted_while_it_flickers),
		cmocka_unit_test(test_bounds),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
