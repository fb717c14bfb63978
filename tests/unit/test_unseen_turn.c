/* SPDX-License-Identifier: Apache-2.0 */
/* When a frame is looked at closely, and what it means when it would not show a turn. */
#include "light/turn/unseen_turn.h"

#include <math.h>

#include "lp_test.h"

#define FRAME_S (1.0 / 30.0)
#define DEG (M_PI / 180.0)

/* Frames whose pictures tell a turn about x and z well, and about y with sigma_deg. */
static int look(struct lp_unseen_turn *unseen, double sigma_deg, int frames)
{
	const double sigma = sigma_deg * DEG;
	const double information[3][3] = {{1e6, 0, 0}, {0, 1 / (sigma * sigma), 0}, {0, 0, 1e6}};
	int looks = 0;

	for (int n = 0; n < frames; n++)
		if (lp_unseen_turn_is_due(unseen, FRAME_S)) {
			lp_unseen_turn_looked(unseen, information, FRAME_S);
			looks++;
		}
	return looks;
}

static void test_a_picture_that_would_show_it_is_looked_at_now_and_then(void **state)
{
	struct lp_unseen_turn unseen = {0};

	(void)state;
	assert_int_equal(look(&unseen, 0.1, 1), 1); /* the first one */
	assert_in_range(look(&unseen, 0.1, 300), 18, 21);
	assert_true(unseen.rate_rad_s == 0.0);
}

static void test_a_picture_that_would_not_is_looked_at_every_time(void **state)
{
	struct lp_unseen_turn unseen = {0};

	(void)state;
	assert_int_equal(look(&unseen, 4.0, 25), 25);
	assert_true(unseen.rate_rad_s == 0.0); /* the exposures to come may show it */
	assert_int_equal(look(&unseen, 4.0, 25), 25);
	/* a turn of four sigmas in the time that the map remembers */
	assert_float_equal(unseen.rate_rad_s / DEG, 4 * 4.0 / 0.3, 0.5);
	look(&unseen, INFINITY, 1);
	assert_float_equal(unseen.rate_rad_s / DEG, 60.0, 0.01);
}

static void test_one_exposure_of_a_bracket_is_enough(void **state)
{
	struct lp_unseen_turn unseen = {0};

	(void)state;
	for (int n = 0; n < 100; n++) {
		look(&unseen, INFINITY, 2);
		look(&unseen, 0.1, 1);
		assert_true(unseen.rate_rad_s == 0.0);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_picture_that_would_show_it_is_looked_at_now_and_then),
		cmocka_unit_test(test_a_picture_that_would_not_is_looked_at_every_time),
		cmocka_unit_test(test_one_exposure_of_a_bracket_is_enough),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
