/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Who may be connected: one account for all publishers and for all phases of a connection, by peer
 * (an address, the first 64 bits of an IPv6 address, or a user of this machine) and in sum.
 *
 * - Places of clients: --max-clients. An eighth of them is for trusted peers alone: local ones, and
 *   those with the token. When all places are taken, the peer that has most makes room for one that
 *   has clearly fewer.
 * - Handshakes under way and connections that close have places of their own, and the peer that has
 *   most loses its oldest to whoever comes.
 * - Each peer has an allowance of the loop's time, for its connections and all that they send. Who
 *   has used it up is turned away until it has grown again.
 *
 * Loop thread.
 */
#ifndef LP_PUBLISHER_PLACES_H
#define LP_PUBLISHER_PLACES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "drivers/publisher/peer.h"

struct lp_guest; /* a peer, and what it has */
struct lp_places;
struct lp_share;

#define LP_PLACES_NEW 128    /* handshakes, and pages that load */
#define LP_PLACES_LEAVING 64 /* refused, or sent away, and not closed yet */

/* What a client is told that has to go. */
#define LP_NO_MORE_PLACES                                                              \
	"all places are taken, and this address has most of them; another client got " \
	"this one — close connections that are not needed"
#define LP_ALLOWANCE_SPENT                                                \
	"this address has connected, or sent, far more than an app does " \
	"— send a pose per picture, and a subscription only when it changes"

enum lp_place_phase { LP_PLACE_NEW, LP_PLACE_CLIENT, LP_PLACE_LEAVING, LP_PLACE_PHASES };

/* What things cost, in time of the loop. */
#define LP_COST_CONNECTION_NS (200 * INT64_C(1000))
#define LP_COST_TLS_NS (1500 * INT64_C(1000))
#define LP_COST_REQUEST_NS (20 * INT64_C(1000))
#define LP_COST_PAGE_NS (300 * INT64_C(1000))
#define LP_COST_BYTE_NS INT64_C(25)	/* received: it may be a frame of six bytes */
#define LP_COST_PAGE_BYTE_NS INT64_C(2) /* sent of a page's file, over TLS */

/* Of one connection; embed it. Zero-initialised has none. */
struct lp_place {
	struct lp_places *places; /* NULL: it has none */
	struct lp_guest *guest;
	struct lp_share *share; /* of a client's publisher */
	/* Another needs the place: close, a client after it has been told why. */
	void (*evict)(struct lp_place *place);
	enum lp_place_phase phase;
	bool trusted;
	struct lp_place *older, *newer; /* in its phase */
	int64_t second_ns, used_ns;	/* of the allowance, in the second that began then */
};

/* NULL: out of memory. */
struct lp_places *lp_places_create(int max_clients);

/* All places must have been given back. Accepts NULL. */
void lp_places_destroy(struct lp_places *places);

/*
 * A connection has come, which costs so much; it is new, and needs no more than a moment. 0, or
 * -EUSERS: its peer has used up its allowance: close it.
 */
int lp_place_take(struct lp_places *places, struct lp_place *place, const struct lp_peer *peer,
		  int64_t cost_ns, void (*evict)(struct lp_place *place));

/* It goes on being new: a handshake. Another may be evicted for it. */
void lp_place_wait(struct lp_place *place);

/* It is to be a client. NULL; or why it may not, with the next step, in `text`: then it leaves. */
const char *lp_place_admit(struct lp_place *place, struct lp_share *share, const char *scheme,
			   char *text, size_t size_bytes);

/* It is a client no more, and will close. Another that leaves may be evicted for it. */
void lp_place_leave(struct lp_place *place);

/* It is closed. Does nothing when it has no place. */
void lp_place_give(struct lp_place *place);

/* It has made the loop do this. False: its peer has used up its allowance, and this connection has
 * its part in that: end it. */
bool lp_place_charge(struct lp_place *place, int64_t cost_ns);

/* Its token is right, or wrong: after some wrong ones no token of its peer counts for a while,
 * longer each time. Whether this one does. */
bool lp_place_token(struct lp_place *place, bool is_right);

/* No token of its peer counts now. */
bool lp_place_is_barred(const struct lp_place *place);

#endif
