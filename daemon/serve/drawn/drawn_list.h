/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lights and SH order of a packet for subscriptions that say what they draw. The errors of an
 * estimate are predicted once for all of them. Loop thread.
 */
#ifndef LP_SERVE_DRAWN_DRAWN_LIST_H
#define LP_SERVE_DRAWN_DRAWN_LIST_H

#include "light/send/listing.h"
#include "serve/drawn/drawn.h"

struct lp_drawn_room;

/* What one kind of subscription wants. */
struct lp_drawn_wish {
	bool on; /* else this is an ordinary subscription, and nothing else here counts */
	bool raw, key_allowed;
	int most_map; /* texels; 0: maps are off */
	struct lp_drawn tolerance;
};

/* What has been decided for it. Zeroed: nothing yet. */
struct lp_drawn_state {
	struct lp_listing listing;
	struct lp_drawn_map_choice map;
	bool started, key;
	int64_t other_since_ns; /* since when KEY had better come or go; 0: it had not */
};

/* Of a packet. */
struct lp_drawn_packet {
	int sh_order;
	bool key;
	int map_size;
	struct lp_drawn stated;
};

/* NULL: out of memory. */
struct lp_drawn_room *lp_drawn_room_create(void);
void lp_drawn_room_destroy(struct lp_drawn_room *room); /* accepts NULL */

/* The present estimate is another one. */
void lp_drawn_room_forget(struct lp_drawn_room *room);

/* What maps leave out, as it was measured last. */
void lp_drawn_room_set_maps(struct lp_drawn_room *room, const struct lp_drawn_maps *maps);
const struct lp_drawn_maps *lp_drawn_room_maps(const struct lp_drawn_room *room);

bool lp_drawn_wishes_are_same(const struct lp_drawn_wish *a, const struct lp_drawn_wish *b);

/* Decide for the present estimate: `listed` becomes a copy of it with the lights of the list. */
void lp_drawn_list(struct lp_drawn_room *room, const struct lp_light_estimate *estimate,
		   const struct lp_drawn_wish *wish, const struct lp_listing_limits *limits,
		   struct lp_drawn_state *state, struct lp_light_estimate *listed,
		   struct lp_drawn_packet *packet);

#endif
