/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Packets for clients: empty ones from a pool; and those of one estimate, encoded once for all
 * clients that want the same of it. Loop thread.
 */
#ifndef LP_SERVE_PACKETS_H
#define LP_SERVE_PACKETS_H

#include "estimate/estimates.h"
#include "light/send/listing.h"
#include "serve/codec/codec.h"

struct lp_packet;
struct lp_packets;

/* Of so many that may be held at a time, besides those of one estimate, and of so many pictures,
 * which take memory only once there are some. NULL: out of memory. */
struct lp_packets *lp_packets_create(int most_held, int most_pictures);

/* An empty one, with one reference. NULL: out of memory, logged. */
struct lp_packet *lp_packets_take(struct lp_packets *packets);

/* The same with room for a picture. */
struct lp_packet *lp_packets_take_picture(struct lp_packets *packets);

/*
 * What a client wants of the estimates, encoded now or before; `computed` says what they hold. The
 * packet stays ours: hold it to keep it. The estimates must be the same until the next
 * lp_packets_forget(). Clients that want the same share a packet if they number their subscriptions
 * alike, as most do; then the first one's stamp counts. NULL: cannot be sent, logged.
 */
struct lp_packet *lp_packets_estimate(struct lp_packets *packets,
				      const struct lp_estimates *estimates,
				      const struct lp_demand *computed,
				      const struct lp_subscription *wanted,
				      const struct lp_stamp *stamp);

/* What an estimate's packet for one client is made of, until the next lp_packets_forget(). */
struct lp_choice {
	const struct lp_light_estimate *all; /* every light that is known */
	const struct lp_light_estimate
		*listed; /* the first variant.lights of its lights are sent */
	struct lp_variant variant;
	struct lp_listing_limits limits; /* that it was chosen by */
	int map_size; /* texels of the reflection map that goes with it, as wished or as decided;
			 0: none */
};

struct lp_choice lp_packets_choose(struct lp_packets *packets, const struct lp_estimates *estimates,
				   const struct lp_demand *computed,
				   const struct lp_subscription *wanted);

/* The size of that map before an estimate is there. */
int lp_packets_map_size(struct lp_packets *packets, const struct lp_demand *computed,
			const struct lp_subscription *wanted);

/* What reflection maps leave out, measured on the newest; of size 0: nothing is known. */
void lp_packets_set_maps(struct lp_packets *packets, const struct lp_drawn_maps *maps);
const struct lp_drawn_maps *lp_packets_maps(const struct lp_packets *packets);

/* Whether they list the same lights. */
bool lp_choices_are_same(const struct lp_choice *a, const struct lp_choice *b);

/* Drop what was encoded. */
void lp_packets_forget(struct lp_packets *packets);

/* Accepts NULL. All packets must be back. */
void lp_packets_destroy(struct lp_packets *packets);

#endif
