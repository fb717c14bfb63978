/* SPDX-License-Identifier: Apache-2.0 */
/* Accepts connections on listening sockets. Loop thread. */
#ifndef LP_PUBLISHER_ACCEPTOR_H
#define LP_PUBLISHER_ACCEPTOR_H

#include <stdbool.h>

#include "base/loop.h"
#include "drivers/publisher/listen.h"

struct lp_acceptor;

struct lp_listener {
	struct lp_acceptor *owner;
	struct lp_watch watch;
};

/* Embed it. It stays at its address while it is started. */
struct lp_acceptor {
	const char *object; /* names it in messages; borrowed */
	/* One more connection, which does not block. After 0 the descriptor belongs to the callee;
	 * after -errno, which is logged here unless it is -EUSERS, it is closed. */
	int (*accepted)(struct lp_acceptor *acceptor, int fd);
	struct lp_listener listeners[LP_LISTEN_MAX];
	int count;
	int spare_fd; /* given up for a moment to turn clients away when descriptors run out */
};

/* Nothing is watched yet. */
void lp_acceptor_init(struct lp_acceptor *acceptor, const char *object,
		      int (*accepted)(struct lp_acceptor *acceptor, int fd));

/* Accept on `count` listening sockets, which it takes over in any case. 0 or -errno, logged. */
int lp_acceptor_start(struct lp_acceptor *acceptor, struct lp_loop *loop, const int *fds,
		      int count);

/* Close the listening sockets. */
void lp_acceptor_finish(struct lp_acceptor *acceptor);

/* Of a connection: a small send buffer, so that a slow client gets the newest, not seconds of old;
 * of TCP also keep-alive, so that a peer that has gone is noticed. */
void lp_connection_set_options(int fd, bool is_tcp);

#endif
