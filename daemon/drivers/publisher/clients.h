/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The connected clients of a publisher on stream sockets: each has a bounded queue of what goes to
 * it, and its requests are cut out of what comes. Loop thread.
 */
#ifndef LP_PUBLISHER_CLIENTS_H
#define LP_PUBLISHER_CLIENTS_H

#include <stdbool.h>

#include "base/loop.h"
#include "drivers/publisher/peer.h"

struct lp_client; /* as in include/publisher.h */
struct lp_packet;
struct lp_publisher;
struct lp_share;

struct lp_clients {
	struct lp_publisher *publisher; /* its host hears of them */
	struct lp_client *first;
	struct lp_timer reaper; /* closes clients whose time to linger is over */
	bool reaping;		/* the timer runs; setting it anew would put it off */
};

void lp_clients_init(struct lp_clients *clients, struct lp_publisher *publisher);

/* Close all of them. */
void lp_clients_finish(struct lp_clients *clients);

/* One more, on a socket that does not block, which it takes over after 0 only. The host hears of
 * it, refused or not. -errno: not logged. */
int lp_clients_add(struct lp_clients *clients, int fd, const struct lp_peer *peer,
		   struct lp_share *share);

/* Send or queue. Never closes, never calls the host but for superseded(). */
void lp_client_send(struct lp_client *client, struct lp_packet *packet);

/* Bytes wait for a client. */
bool lp_clients_pending(const struct lp_clients *clients);

#endif
