/* SPDX-License-Identifier: Apache-2.0 */
#include "base/clock.h"

#include <stdatomic.h>
#include <time.h>

static atomic_int_fast64_t simulated_ns; /* 0: time is the system's */

static int64_t read_clock(clockid_t id)
{
	struct timespec now;

	(void)clock_gettime(id, &now); /* cannot fail for the clocks used here */
	return now.tv_sec * LP_NS_PER_S + now.tv_nsec;
}

int64_t lp_clock_ns(void)
{
	const int64_t now_ns = atomic_load_explicit(&simulated_ns, memory_order_relaxed);

	return now_ns ? now_ns : read_clock(CLOCK_MONOTONIC);
}

void lp_clock_simulate(int64_t t_ns)
{
	atomic_store(&simulated_ns, t_ns);
}

bool lp_clock_is_simulated(void)
{
	return atomic_load_explicit(&simulated_ns, memory_order_relaxed) != 0;
}

int64_t lp_clock_unix_ns(int64_t monotonic_ns)
{
	if (lp_clock_is_simulated())
		return monotonic_ns + LP_SIMULATED_UNIX_NS;
	return read_clock(CLOCK_REALTIME) - (read_clock(CLOCK_MONOTONIC) - monotonic_ns);
}

int64_t lp_clock_suspended_ns(void)
{
	const int64_t monotonic_ns = read_clock(CLOCK_MONOTONIC);

	return lp_clock_is_simulated() ? 0 : read_clock(CLOCK_BOOTTIME) - monotonic_ns;
}

int64_t lp_clock_cpu_ns(void)
{
	return read_clock(CLOCK_PROCESS_CPUTIME_ID);
}
