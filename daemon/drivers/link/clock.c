/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/link/clock.h"

#include <math.h>
#include <stdlib.h>

#define SLOWEST_NS INT64_C(20000000)
#define SKEW_PRIOR 0.005 /* 1 sigma: ceramic resonators are within 0.5 % */
#define UNIFORM 0.57735	 /* standard deviation of a uniform distribution over +-1 */
/* An exchange that leaves no more than so many sigmas for what was known contradicts it. */
#define STEP_SIGMAS 4

static int64_t unwrap(const struct lp_link_clock *clock, uint32_t device_us)
{
	const int newest = (clock->at + LP_CLOCK_EXCHANGES - 1) % LP_CLOCK_EXCHANGES;
	const int64_t near_us = clock->count ? clock->exchanges[newest].device_us : device_us;

	return near_us + (int32_t)(device_us - (uint32_t)near_us);
}

/*
 * Weighted least squares of host minus device time over device time, with a prior on the skew, so
 * that two exchanges close together say nothing absurd. Around the newest exchange, for precision.
 */
static void fit(struct lp_link_clock *clock)
{
	const int newest = (clock->at + LP_CLOCK_EXCHANGES - 1) % LP_CLOCK_EXCHANGES;
	double w0 = 0, wx = 0, wxx = 0, wy = 0, wxy = 0;

	clock->device_origin_us = clock->exchanges[newest].device_us;
	clock->host_origin_ns = clock->exchanges[newest].host_ns;
	clock->half_ns = SLOWEST_NS;
	for (int i = 0; i < clock->count; i++) {
		const double x =
			1e3 * (double)(clock->exchanges[i].device_us - clock->device_origin_us);
		const double y = (double)(clock->exchanges[i].host_ns - clock->host_origin_ns) - x;
		const double sigma = UNIFORM * (double)clock->exchanges[i].half_ns + 1000;
		const double w = 1 / (sigma * sigma);

		w0 += w;
		wx += w * x;
		wxx += w * x * x;
		wy += w * y;
		wxy += w * x * y;
		if (clock->exchanges[i].half_ns < clock->half_ns)
			clock->half_ns = clock->exchanges[i].half_ns;
	}
	wxx += 1 / (SKEW_PRIOR * SKEW_PRIOR);
	const double determinant = w0 * wxx - wx * wx;
	const double offset = (wxx * wy - wx * wxy) / determinant;

	clock->skew = (w0 * wxy - wx * wy) / determinant;
	clock->host_origin_ns += llrint(offset);
	clock->origin_sigma_ns = sqrt(wxx / determinant);
	clock->skew_sigma = sqrt(w0 / determinant);
}

/* Whether one of the clocks has been set, or stood still, since the exchanges before: the truth
 * lies within this one for certain. */
static bool has_stepped(const struct lp_link_clock *clock, uint32_t device_us, int64_t middle_ns,
			int64_t half_ns)
{
	int64_t expected_ns, sigma_ns;

	return lp_link_clock_at(clock, device_us, &expected_ns, &sigma_ns) &&
	       llabs(expected_ns - middle_ns) > half_ns + STEP_SIGMAS * sigma_ns;
}

bool lp_link_clock_add(struct lp_link_clock *clock, int64_t sent_ns, int64_t received_ns,
		       uint32_t device_us, uint32_t turnaround_us)
{
	const int64_t width_ns = received_ns - sent_ns - 1000 * (int64_t)turnaround_us;

	if (width_ns < 0 || width_ns > 2 * SLOWEST_NS)
		return false;
	if (has_stepped(clock, device_us, sent_ns + width_ns / 2, width_ns / 2))
		*clock = (struct lp_link_clock){0};
	const int64_t unwrapped_us = unwrap(clock, device_us);

	clock->exchanges[clock->at].device_us = unwrapped_us;
	clock->exchanges[clock->at].host_ns = sent_ns + width_ns / 2;
	clock->exchanges[clock->at].half_ns = width_ns / 2;
	clock->at = (clock->at + 1) % LP_CLOCK_EXCHANGES;
	if (clock->count < LP_CLOCK_EXCHANGES)
		clock->count++;
	fit(clock);
	return true;
}

bool lp_link_clock_at(const struct lp_link_clock *clock, uint32_t device_us, int64_t *host_ns,
		      int64_t *sigma_ns)
{
	if (clock->count == 0)
		return false;
	const double x = 1e3 * (double)(unwrap(clock, device_us) - clock->device_origin_us);
	/* Unequal delays do not average out: the narrowest interval stays. */
	const double sigma = clock->origin_sigma_ns + clock->skew_sigma * fabs(x) +
			     UNIFORM * (double)clock->half_ns;

	*host_ns = clock->host_origin_ns + llrint(x * (1 + clock->skew));
	*sigma_ns = llrint(sigma);
	return true;
}
