/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/poses/client_clock.h"

#include <math.h>

#include "base/clock.h"

#define BUCKET_NS (2 * LP_NS_PER_S)
/* Of a network that nobody has measured. */
#define ONE_WAY_SIGMA_NS (10 * LP_NS_PER_MS)
#define LEAST_SIGMA_NS (100 * LP_NS_PER_US)

static void note(struct lp_least_delay *delay, int64_t delay_ns, int64_t now_ns)
{
	const int64_t bucket = now_ns / BUCKET_NS;

	if (!delay->used || bucket - delay->newest >= LP_CLOCK_BUCKETS)
		for (int k = 0; k < LP_CLOCK_BUCKETS; k++)
			delay->least_ns[k] = INT64_MAX;
	else
		for (int64_t k = delay->newest + 1; k <= bucket; k++)
			delay->least_ns[k % LP_CLOCK_BUCKETS] = INT64_MAX;
	delay->used = true;
	delay->newest = bucket;
	int64_t *const least_ns = &delay->least_ns[bucket % LP_CLOCK_BUCKETS];

	if (delay_ns < *least_ns)
		*least_ns = delay_ns;
}

static int64_t least(const struct lp_least_delay *delay)
{
	int64_t least_ns = INT64_MAX;

	for (int k = 0; k < LP_CLOCK_BUCKETS; k++)
		if (delay->least_ns[k] < least_ns)
			least_ns = delay->least_ns[k];
	return least_ns;
}

/* A round trip that took less than no time: one of the clocks was set meanwhile. */
static void forget_before_a_step(struct lp_client_clock *clock)
{
	if (clock->here.used && clock->there.used && least(&clock->here) + least(&clock->there) < 0)
		clock->here.used = clock->there.used = false;
}

void lp_client_clock_heard(struct lp_client_clock *clock, int64_t theirs_ns, int64_t now_ns,
			   bool is_ping)
{
	if (is_ping && !clock->pinged) {
		clock->pinged = true;
		clock->here.used = false;
	} else if (clock->pinged && !is_ping) {
		return;
	}
	note(&clock->here, now_ns - theirs_ns, now_ns);
	forget_before_a_step(clock);
	if (!clock->here.used)
		note(&clock->here, now_ns - theirs_ns, now_ns);
}

void lp_client_clock_answered(struct lp_client_clock *clock, int64_t sent_ns, int64_t theirs_ns,
			      int64_t now_ns)
{
	note(&clock->there, theirs_ns - sent_ns, now_ns);
}

int64_t lp_client_clock_ours_ns(const struct lp_client_clock *clock, int64_t theirs_ns,
				int64_t *sigma_ns)
{
	const int64_t here_ns = least(&clock->here);
	const int64_t there_ns = clock->there.used ? least(&clock->there) : INT64_MAX;

	if (there_ns == INT64_MAX || here_ns + there_ns < 0) {
		*sigma_ns = ONE_WAY_SIGMA_NS;
		return theirs_ns + here_ns;
	}
	/* the offset is evenly likely within half of the round trip */
	*sigma_ns = (int64_t)((double)(here_ns + there_ns) / (2.0 * sqrt(3.0))) + LEAST_SIGMA_NS;
	return theirs_ns + (here_ns - there_ns) / 2;
}
