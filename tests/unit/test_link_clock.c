/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <stdlib.h>

#include "base/clock.h"
#include "drivers/link/clock.h"

/* A microcontroller whose clock is off and drifts, behind a line that takes its time. */
struct world {
	int64_t boot_ns;
	double rate; /* of its clock */
	unsigned random;
};

static uint32_t device_us(const struct world *world, int64_t t_ns)
{
	return (uint32_t)(int64_t)((double)(t_ns - world->boot_ns) * world->rate / 1e3);
}

static int64_t delay_ns(struct world *world, int64_t longest_ns)
{
	world->random = world->random * 1103515245 + 12345;
	return (int64_t)(world->random >> 16 & 0x7fff) * longest_ns / 0x7fff;
}

static bool exchange(struct lp_link_clock *clock, struct world *world, int64_t t_ns)
{
	const int64_t there_ns = 200000 + delay_ns(world, 3000000);
	const int64_t turnaround_ns = 100000 + delay_ns(world, 500000);
	const int64_t back_ns = 300000 + delay_ns(world, 9000000);

	return lp_link_clock_add(clock, t_ns, t_ns + there_ns + turnaround_ns + back_ns,
				 device_us(world, t_ns + there_ns),
				 (uint32_t)(turnaround_ns / 1000));
}

/* Off by how many sigma, for a moment. */
static double off(const struct lp_link_clock *clock, const struct world *world, int64_t t_ns,
		  int64_t *sigma_ns)
{
	int64_t host_ns;

	assert_true(lp_link_clock_at(clock, device_us(world, t_ns), &host_ns, sigma_ns));
	return (double)llabs(host_ns - t_ns) / (double)*sigma_ns;
}

static void test_offset_and_skew_are_found(void **state)
{
	static const double rates[] = {1, 1.005, 0.995, 1.00005};

	(void)state;
	for (size_t r = 0; r < LP_COUNT(rates); r++) {
		/* The device's clock wraps round after a few exchanges. */
		struct world world = {.boot_ns = INT64_C(7000000000000) - INT64_C(4290000000000),
				      .rate = rates[r],
				      .random = (unsigned)r};
		struct lp_link_clock clock = {0};
		int64_t t_ns = INT64_C(7000000000000), sigma_ns = 0;

		for (int i = 0; i < 60; i++, t_ns += LP_NS_PER_S / (i < 16 ? 10 : 1)) {
			assert_true(exchange(&clock, &world, t_ns));
			assert_true(off(&clock, &world, t_ns + LP_NS_PER_S, &sigma_ns) < 3);
			assert_true(off(&clock, &world, t_ns - 2 * LP_NS_PER_S, &sigma_ns) < 3);
		}
		print_message("rate %.5f: skew found %.6f, sigma %d us\n", rates[r], clock.skew,
			      (int)(sigma_ns / 1000));
		assert_true(sigma_ns < 2 * LP_NS_PER_MS);
		assert_true(clock.skew * world.rate + world.rate - 1 < 1e-4);
		assert_true(clock.skew * world.rate + world.rate - 1 > -1e-4);
	}
}

static void test_what_cannot_be_is_left_out(void **state)
{
	struct lp_link_clock clock = {0};
	int64_t host_ns, sigma_ns;

	(void)state;
	assert_false(lp_link_clock_at(&clock, 0, &host_ns, &sigma_ns));
	assert_false(lp_link_clock_add(&clock, 1000000, 1500000, 7, 501)); /* longer than it took */
	assert_false(lp_link_clock_add(&clock, 0, INT64_C(41000000), 7, 0)); /* too slow */
	assert_int_equal(clock.count, 0);
	assert_true(lp_link_clock_add(&clock, 1000000, 1500000, 7, 400));
	assert_true(lp_link_clock_at(&clock, 7, &host_ns, &sigma_ns));
	assert_int_equal(host_ns, 1050000);
	assert_true(sigma_ns >= 28000); /* anywhere within 100 us */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_offset_and_skew_are_found),
		cmocka_unit_test(test_what_cannot_be_is_left_out),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
