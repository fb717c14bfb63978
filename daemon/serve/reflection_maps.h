/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reflection maps for clients: the surroundings with the lamps that each kind of subscription has
 * in them, fitted to its coefficients, so that E(map) = E(TOTAL), or E(AMBIENT). Composed once for
 * all clients that want the same, and shared by those that number their subscriptions alike. Loop
 * thread.
 */
#ifndef LP_SERVE_REFLECTION_MAPS_H
#define LP_SERVE_REFLECTION_MAPS_H

#include "serve/codec/codec.h"
#include "serve/packets.h"

struct lp_packet;
struct lp_reflection_maps;
struct lp_surroundings;

/* Up to `most_size` texels along an edge (16, 32, 64), for so many clients. NULL: out of memory. */
struct lp_reflection_maps *lp_reflection_maps_create(int most_size, int clients);

/* Find out what each size of maps of these surroundings leaves out; the maps say it. */
const struct lp_drawn_maps *lp_reflection_maps_measure(struct lp_reflection_maps *maps,
						       const struct lp_surroundings *surroundings,
						       const struct lp_light_estimate *estimate);

/*
 * The map that goes with an estimate, made now or before; it stays ours: hold it to keep it. The
 * surroundings must be the same until the next lp_reflection_maps_forget(). NULL: cannot be sent,
 * logged.
 */
struct lp_packet *lp_reflection_maps_packet(struct lp_reflection_maps *maps,
					    const struct lp_surroundings *surroundings,
					    const struct lp_choice *choice,
					    const struct lp_reflection_wish *wish,
					    const struct lp_stamp *stamp);

/* Drop what was encoded. */
void lp_reflection_maps_forget(struct lp_reflection_maps *maps);

/* Accepts NULL. All packets must be back. */
void lp_reflection_maps_destroy(struct lp_reflection_maps *maps);

#endif
