/* SPDX-License-Identifier: Apache-2.0 */
/* Time: int64 nanoseconds of CLOCK_MONOTONIC everywhere inside; Unix time only on the wire. */
#ifndef LP_BASE_CLOCK_H
#define LP_BASE_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define LP_NS_PER_S INT64_C(1000000000)
#define LP_NS_PER_MS INT64_C(1000000)
#define LP_NS_PER_US INT64_C(1000)

int64_t lp_clock_ns(void);

/*
 * Simulated time, for tests: from now on lp_clock_ns() is `t_ns` (not 0) until the next call, and
 * Unix time is LP_SIMULATED_UNIX_NS later. There is no way back. One thread sets it, any may read.
 */
#define LP_SIMULATED_UNIX_NS (INT64_C(1700000000) * LP_NS_PER_S)
void lp_clock_simulate(int64_t t_ns);
bool lp_clock_is_simulated(void);

/* Unix time of a CLOCK_MONOTONIC instant by both clocks as they stand now: a step of the wall clock
 * shows in the next packet and in nothing else. */
int64_t lp_clock_unix_ns(int64_t monotonic_ns);

/* For how long the machine has been suspended since it was started; CLOCK_MONOTONIC stands still
 * meanwhile. Comes from two clocks, which are read one after the other: good to a millisecond. */
int64_t lp_clock_suspended_ns(void);

/* Processor time of the whole process. */
int64_t lp_clock_cpu_ns(void);

#endif
