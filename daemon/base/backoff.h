/* SPDX-License-Identifier: Apache-2.0 */
/* How long to wait before the next attempt: each time twice as long, up to a limit. */
#ifndef LP_BASE_BACKOFF_H
#define LP_BASE_BACKOFF_H

#include <stdint.h>

struct lp_backoff {
	int64_t first_ns, longest_ns;
	int64_t next_ns; /* 0: the next wait is the first */
};

/* How long to wait now. The call after this one returns twice as much, up to longest_ns. */
static inline int64_t lp_backoff_next_ns(struct lp_backoff *backoff)
{
	const int64_t wait_ns = backoff->next_ns ? backoff->next_ns : backoff->first_ns;

	backoff->next_ns = wait_ns > backoff->longest_ns / 2 ? backoff->longest_ns : 2 * wait_ns;
	return wait_ns;
}

/* An attempt succeeded: begin with first_ns again. */
static inline void lp_backoff_reset(struct lp_backoff *backoff)
{
	backoff->next_ns = 0;
}

#endif
