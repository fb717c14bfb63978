/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A client's clock on ours, from when its messages arrive and when ours arrived there. Each
 * direction's fastest transfer of the last 16 s counts: the others waited somewhere. Both together
 * tell the offset within half of the fastest round trip, as NTP does (RFC 5905); messages of one
 * direction alone tell it as if the fastest had taken no time. Pure logic; zeroed is a new one.
 */
#ifndef LP_SERVE_POSES_CLIENT_CLOCK_H
#define LP_SERVE_POSES_CLIENT_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define LP_CLOCK_BUCKETS 8

/* The smallest of the differences of the last seconds. */
struct lp_least_delay {
	bool used;
	int64_t newest; /* number of the newest bucket */
	int64_t least_ns[LP_CLOCK_BUCKETS];
};

struct lp_client_clock {
	bool pinged; /* messages count that were made for it, and no others */
	struct lp_least_delay here, there;
};

/* A message with the client's time `theirs_ns` has arrived; `is_ping`: it was sent at once, and for
 * this purpose. Times within 2e18 ns of 0. */
void lp_client_clock_heard(struct lp_client_clock *clock, int64_t theirs_ns, int64_t now_ns,
			   bool is_ping);

/* What we sent at sent_ns was there at `theirs_ns`, as we learn now. */
void lp_client_clock_answered(struct lp_client_clock *clock, int64_t sent_ns, int64_t theirs_ns,
			      int64_t now_ns);

/* Our time at `theirs_ns`, and 1 sigma of the offset. Only after a message was heard. */
int64_t lp_client_clock_ours_ns(const struct lp_client_clock *clock, int64_t theirs_ns,
				int64_t *sigma_ns);

#endif
