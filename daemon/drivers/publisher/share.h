/* SPDX-License-Identifier: Apache-2.0 */
/* How many of the clients one publisher may have, and how many of those one peer. */
#ifndef LP_PUBLISHER_SHARE_H
#define LP_PUBLISHER_SHARE_H

#include <stddef.h>

struct lp_params;

/* Keys of a publisher's URI, which begin its options; and how much of it is taken (places.h). */
struct lp_share {
	int clients;  /* 0: as many as there are places (places.h) */
	int per_peer; /* 0: a share of --max-clients */
	int taken;
};

extern const struct lp_params lp_share_params;

/* Replace zeros. Half of all is enough for one address or user, or eight where half would be less.
 */
void lp_share_complete(struct lp_share *share, int max_clients);

/* Why a client that has just come is not taken, with the next step, in `text`; NULL: it may stay.
 * `same`: clients of the same `peer` ("address"), of all publishers. */
const char *lp_share_refusal(const struct lp_share *share, const char *scheme, int same,
			     const char *peer, char *text, size_t size_bytes);

#endif
