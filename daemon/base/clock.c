/* SPDX-License-Identifier: Apache-2.0 */
#include "base/clock.h"

#include <time.h>

static int64_t read_clock(clockid_t id)
{
	struct timespec now;

	(void)clock_gettime(id, &now); /* cannot fail for the clocks used here */
	return now.tv_sec * LP_NS_PER_S + now.tv_nsec;
}

int64_t lp_clock_ns(void)
{
	return read_clock(CLOCK_MONOTONIC);
}

int64_t lp_clock_unix_ns(int64_t monotonic_ns)
{
	return read_clock(CLOCK_REALTIME) - (read_clock(CLOCK_MONOTONIC) - monotonic_ns);
}

int64_t lp_clock_cpu_ns(void)
{
	return read_clock(CLOCK_PROCESS_CPUTIME_ID);
}
