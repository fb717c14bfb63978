/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include "base/backoff.h"

static void test_waits_double_up_to_the_longest(void **state)
{
	static const int64_t expected_ns[] = {100, 200, 400, 800, 1000, 1000};
	struct lp_backoff backoff = {.first_ns = 100, .longest_ns = 1000};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(expected_ns); i++)
		assert_int_equal(lp_backoff_next_ns(&backoff), expected_ns[i]);
	lp_backoff_reset(&backoff);
	assert_int_equal(lp_backoff_next_ns(&backoff), 100);
	assert_int_equal(lp_backoff_next_ns(&backoff), 200);
}

static void test_the_longest_is_never_passed(void **state)
{
	struct lp_backoff backoff = {.first_ns = INT64_MAX / 2 + 1, .longest_ns = INT64_MAX};

	(void)state;
	(void)lp_backoff_next_ns(&backoff);
	assert_int_equal(lp_backoff_next_ns(&backoff), INT64_MAX);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_waits_double_up_to_the_longest),
		cmocka_unit_test(test_the_longest_is_never_passed),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
