/* SPDX-License-Identifier: Apache-2.0 */
/* How many of the clients one publisher may have, and how many of those one peer. */
#ifndef LP_PUBLISHER_SHARE_H
#define LP_PUBLISHER_SHARE_H

#include <stdbool.h>
#include <stddef.h>

struct lp_params;

/* Keys of a publisher's URI; 0: a share of --max-clients. Options begin with it. */
struct lp_share {
	int clients, per_peer;
};

extern const struct lp_params lp_share_params;

/*
 * Replace zeros. The network leaves an eighth of --max-clients to local clients, so that it cannot
 * lock them out; local clients have no limit but --max-clients. Half of all is enough for one
 * address or user, or eight where half would be less.
 */
void lp_share_complete(struct lp_share *share, int max_clients, bool is_network);

/* Why a client that has just come is not taken, with the next step, in `text`; NULL: it may stay.
 * `count`: clients of this publisher; `same`: those of the same `peer` ("address"). */
const char *lp_share_refusal(const struct lp_share *share, const char *scheme, int count, int same,
			     const char *peer, char *text, size_t size_bytes);

#endif
