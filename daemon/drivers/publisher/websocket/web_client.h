/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The connections of a WebSocket server: the place that each has (places.h), what it costs, what
 * waits to be sent, and how it ends. Loop thread.
 */
#ifndef LP_WEBSOCKET_WEB_CLIENT_H
#define LP_WEBSOCKET_WEB_CLIENT_H

#include <stdbool.h>
#include <stdint.h>

#include "base/loop.h"
#include "drivers/publisher/places.h"
#include "drivers/publisher/queue.h"

struct lp_publisher;
struct lp_session;
struct lp_web_client;

struct lp_web_clients {
	struct lp_publisher *publisher; /* its host hears of them */
	struct lp_web_client *first;
	struct lp_timer meter;
};

/* One connection; the host's struct lp_client once it is a WebSocket. */
struct lp_web_client {
	struct lp_web_clients *owner;
	struct lp_web_client *next, *previous;
	struct lp_session *session; /* set when the server has it */
	struct lp_place place;
	uint64_t received_bytes; /* that are charged */
	struct lp_send_queue queue;
	void *user;
	bool has_token; /* or needs none */
	bool announced; /* the host will hear disconnected() */
	bool closing;	/* nothing more is queued for it */
};

void lp_web_clients_init(struct lp_web_clients *clients, struct lp_publisher *publisher);
void lp_web_clients_start(struct lp_web_clients *clients);
bool lp_web_clients_pending(const struct lp_web_clients *clients);
/* The server must have closed all sessions. */
void lp_web_clients_finish(struct lp_web_clients *clients);

/* A connection has come, which is no WebSocket yet. 0; -ENOMEM; -EUSERS: it is to be closed. */
int lp_web_client_add(struct lp_web_clients *clients, int fd, bool is_tls,
		      struct lp_web_client **added);
void lp_web_client_remove(struct lp_web_client *client);

/* Of a WebSocket: what is queued goes out, then it ends. The host hears disconnected(). */
void lp_web_client_close(struct lp_web_client *client, const char *reason);

/* It has made the loop do this. False: it has done too much, and ends. */
bool lp_web_client_charge(struct lp_web_client *client, int64_t cost_ns);

#endif
