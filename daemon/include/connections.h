/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Connections that back ends of several roles share: the wheel and the ring may sit on one
 * microcontroller. The application owns the list and knows nothing of its entries; drivers find and
 * add their own by name. Loop thread.
 */
#ifndef LP_CONNECTIONS_H
#define LP_CONNECTIONS_H

/* Base of every shared connection: embed it as the first member. */
struct lp_connection {
	struct lp_connection *next;
	const char *name; /* carrier and device; owned by the connection */
};

struct lp_connections {
	struct lp_connection *first;
};

#endif
