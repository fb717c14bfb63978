/* SPDX-License-Identifier: Apache-2.0 */
/* Whether what is found is a lamp: lamps are believed, what comes and goes is not. */
#include "light/lamps/existence.h"

#include "lp_test.h"

#define FRAME_S (1.0F / 30.0F)

/* Something that is there for stay_s and away for away_s, in turns. */
struct fixture {
	struct lp_clutter clutter;
	struct lp_existence one;
	bool is_known;
	int phase;
};

/* One frame of it: whether it has begun to be a lamp. */
static bool comes_and_goes(struct fixture *f, float stay_s, float away_s)
{
	const int period = (int)((stay_s + away_s) / FRAME_S);
	const bool is_seen = f->phase++ % period < (int)(stay_s / FRAME_S);
	const bool was = f->is_known && lp_exists(&f->one);

	if (f->is_known) {
		lp_existence_update(&f->one, &f->clutter, is_seen, FRAME_S);
	} else if (is_seen) {
		f->one = lp_existence_found(&f->clutter);
		f->is_known = true;
	}
	if (f->is_known && lp_existence_is_over(&f->one)) {
		lp_existence_end(&f->one, &f->clutter);
		f->is_known = false;
	}
	return !was && f->is_known && lp_exists(&f->one);
}

/* Seconds until something new that stays is a lamp. */
static float wait_s(struct lp_clutter *clutter)
{
	struct lp_existence one = lp_existence_found(clutter);
	float waited_s = 0.0F;

	for (; !lp_exists(&one) && waited_s < 1000.0F; waited_s += FRAME_S)
		lp_existence_update(&one, clutter, true, FRAME_S);
	return waited_s;
}

static struct lp_clutter after(float seconds)
{
	struct lp_clutter clutter = {0};

	for (float s = 0.0F; s < seconds; s += FRAME_S)
		lp_clutter_age(&clutter, FRAME_S);
	return clutter;
}

/* All that is found in the first frames of a map are its lamps; later they wait, in a quiet scene
 * for one to four seconds. */
static void test_a_young_map_is_believed(void **state)
{
	static const float ages_s[] = {5.0F, 10.0F, 30.0F, 100.0F, 1000.0F};
	struct lp_clutter first = {0}, second = after(1.0F);

	(void)state;
	assert_float_equal(wait_s(&first), 0.0F, 0.0F);
	assert_float_equal(wait_s(&second), 0.0F, 0.0F);
	for (size_t k = 0; k < LP_COUNT(ages_s); k++) {
		struct lp_clutter later = after(ages_s[k]);
		const float waited_s = wait_s(&later);

		assert_true(waited_s > 1.0F && waited_s < 4.0F);
	}
}

/* It takes a second or two until all is found for the first time. */
static void test_how_long_a_map_is_young(void **state)
{
	struct lp_clutter young = after(1.7F), older = after(3.0F);

	(void)state;
	assert_float_equal(wait_s(&young), 0.0F, 0.0F);
	assert_true(wait_s(&older) > 0.2F);
}

static void test_light_that_came_is_beyond_doubt(void **state)
{
	struct lp_clutter clutter = after(1000.0F);
	struct lp_existence one = lp_existence_found(&clutter);

	(void)state;
	assert_false(lp_exists(&one));
	lp_existence_prove(&one);
	assert_true(lp_exists(&one) && one.was_certain);
	/* someone walks past, and it is known still; at last it has gone */
	lp_existence_update(&one, &clutter, false, 3.0F);
	assert_false(lp_existence_is_over(&one));
	lp_existence_update(&one, &clutter, false, 3.0F);
	assert_true(lp_existence_is_over(&one));
	lp_existence_end(&one, &clutter);
	assert_float_equal(clutter.lost, 0.0F, 0.0F); /* a lamp, no clutter */
}

/* Where regions come and go for ever, as in a bright sky, hardly any is taken for a lamp, while
 * what stays there at last is; and it is forgotten. */
static void test_what_comes_and_goes_is_clutter(void **state)
{
	static const struct {
		float stay_s, away_s;
	} cases[] = {{0.2F, 1.0F}, {0.5F, 2.0F}, {1.0F, 5.0F}};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		struct fixture f[4] = {{.clutter = after(1000.0F)}};
		int births = 0;

		for (int n = 0; n < 30 * 120; n++) {
			lp_clutter_age(&f[0].clutter, FRAME_S);
			for (int k = 0; k < 4; k++) {
				f[k].clutter = f[0].clutter;
				births += comes_and_goes(&f[k],
							 cases[i].stay_s * (1.0F + 0.1F * (float)k),
							 cases[i].away_s);
				f[0].clutter = f[k].clutter;
			}
		}
		assert_in_range(births, 0, 12); /* a tenth a second */
		const float wait = wait_s(&f[0].clutter);

		assert_true(wait > 1.5F * cases[i].stay_s && wait < 30.0F);
		for (int n = 0; n < 30 * 300; n++)
			lp_clutter_age(&f[0].clutter, FRAME_S);
		assert_true(wait_s(&f[0].clutter) < 2.5F);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_young_map_is_believed),
		cmocka_unit_test(test_how_long_a_map_is_young),
		cmocka_unit_test(test_light_that_came_is_beyond_doubt),
		cmocka_unit_test(test_what_comes_and_goes_is_clutter),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
