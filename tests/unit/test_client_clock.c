/* SPDX-License-Identifier: Apache-2.0 */
/* The offset between two clocks, from messages that take their time. */
#include "serve/poses/client_clock.h"

#include <stdlib.h>

#include "base/clock.h"
#include "lp_test.h"

#define MS LP_NS_PER_MS

static struct lp_client_clock watched;
static int64_t now_ns, offset_ns; /* ours, and theirs less ours */

static int setup(void **state)
{
	(void)state;
	srand(1);
	watched = (struct lp_client_clock){0};
	now_ns = 1000 * LP_NS_PER_S;
	offset_ns = -777 * LP_NS_PER_S;
	return 0;
}

/* A ping that takes here_ns to us, answered at once; the answer takes there_ns, and the client says
 * with its next ping when it came. */
static void ping(int64_t here_ns, int64_t there_ns)
{
	lp_client_clock_heard(&watched, now_ns - here_ns + offset_ns, now_ns, true);
	lp_client_clock_answered(&watched, now_ns, now_ns + there_ns + offset_ns,
				 now_ns + LP_NS_PER_S);
	now_ns += LP_NS_PER_S;
}

static int64_t error_ns(int64_t *sigma_ns)
{
	return lp_client_clock_ours_ns(&watched, now_ns + offset_ns, sigma_ns) - now_ns;
}

/* The fastest of many counts, and the error is within what is stated. */
static void test_both_directions(void **state)
{
	int64_t sigma_ns;

	(void)state;
	for (int n = 0; n < 20; n++)
		ping((1 + rand() % 40) * MS, (2 + rand() % 40) * MS);
	assert_true(llabs(error_ns(&sigma_ns)) < 6 * MS);
	assert_true(llabs(error_ns(&sigma_ns)) < 2 * sigma_ns);
	ping(1 * MS, 2 * MS);
	assert_int_equal(error_ns(&sigma_ns), -MS / 2);
	assert_in_range(sigma_ns, MS / 2, 2 * MS);
}

static void test_one_direction_alone(void **state)
{
	int64_t sigma_ns;

	(void)state;
	for (int n = 0; n < 100; n++, now_ns += 10 * MS)
		lp_client_clock_heard(&watched, now_ns - (3 + n % 20) * MS + offset_ns, now_ns,
				      false);
	assert_int_equal(error_ns(&sigma_ns), 3 * MS);
	assert_int_equal(sigma_ns, 10 * MS);
}

/* Poses are not pings: once there are pings, they do not count for the clock. */
static void test_poses_do_not_disturb_pings(void **state)
{
	int64_t sigma_ns;

	(void)state;
	lp_client_clock_heard(&watched, now_ns + 500 * MS + offset_ns, now_ns, false);
	ping(2 * MS, 2 * MS);
	lp_client_clock_heard(&watched, now_ns + 500 * MS + offset_ns, now_ns, false);
	assert_int_equal(error_ns(&sigma_ns), 0);
}

/* A clock that is set, or a machine that slept: the next ping or two find it. */
static void test_a_clock_that_is_set(void **state)
{
	const int64_t steps_ns[] = {3600 * LP_NS_PER_S, -3600 * LP_NS_PER_S, 50 * MS, -50 * MS};
	int64_t sigma_ns;

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(steps_ns); k++) {
		for (int n = 0; n < 5; n++)
			ping(2 * MS, 2 * MS);
		offset_ns += steps_ns[k];
		for (int n = 0; n < 3; n++)
			ping(2 * MS, 2 * MS);
		assert_int_equal(error_ns(&sigma_ns), 0);
		assert_in_range(sigma_ns, MS, 2 * MS);
	}
}

/* 100 parts in a million for a minute: what is old does not count. */
static void test_drift(void **state)
{
	int64_t sigma_ns;

	(void)state;
	for (int n = 0; n < 60; n++) {
		ping(2 * MS, 2 * MS);
		offset_ns += 100 * LP_NS_PER_US;
	}
	assert_true(llabs(error_ns(&sigma_ns)) < 2 * MS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_both_directions, setup),
		cmocka_unit_test_setup(test_one_direction_alone, setup),
		cmocka_unit_test_setup(test_poses_do_not_disturb_pings, setup),
		cmocka_unit_test_setup(test_a_clock_that_is_set, setup),
		cmocka_unit_test_setup(test_drift, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
