/* SPDX-License-Identifier: Apache-2.0 */
/* Which reading of the ring belongs to a frame. */
#include "light/ring/ring_history.h"

#include "lp_test.h"

#define MS ((int64_t)1000000)

static void test_the_nearest(void **state)
{
	struct lp_ring_history history = {0};
	struct lp_ring_sample found;

	(void)state;
	assert_false(lp_ring_history_at(&history, 1000 * MS, 100 * MS, &found));
	for (int i = 0; i < 3 * LP_RING_HISTORY; i++) {
		const struct lp_ring_sample sample = {.t_ns = (1000 + 10 * i) * MS,
						      .sequence = (uint32_t)i};

		lp_ring_history_add(&history, &sample);
	}
	const int64_t last_ns = (1000 + 10 * (3 * LP_RING_HISTORY - 1)) * MS;

	assert_true(lp_ring_history_at(&history, last_ns - 53 * MS, 100 * MS, &found));
	assert_int_equal(found.t_ns, last_ns - 50 * MS);
	/* later than the newest: the newest, if it is not too far off */
	assert_true(lp_ring_history_at(&history, last_ns + 25 * MS, 100 * MS, &found));
	assert_int_equal(found.t_ns, last_ns);
	assert_false(lp_ring_history_at(&history, last_ns + 115 * MS, 100 * MS, &found));
	/* older than what is kept */
	assert_false(lp_ring_history_at(&history, last_ns - 900 * MS, 100 * MS, &found));
}

static void test_a_reading_without_a_time(void **state)
{
	const struct lp_ring_sample sample = {.illuminance_lux = {7.0F}};
	struct lp_ring_history history = {0};
	struct lp_ring_sample found;

	(void)state;
	lp_ring_history_add(&history, &sample);
	assert_true(lp_ring_history_at(&history, 123456 * MS, 1, &found));
	assert_float_equal(found.illuminance_lux[0], 7.0F, 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_nearest),
		cmocka_unit_test(test_a_reading_without_a_time),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
