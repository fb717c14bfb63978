/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A publisher of packets: moves bytes to and from clients and knows nothing of their meaning.
 * One back end = one file drivers/publisher/<scheme>.c, registered in app/backends.c.
 *
 * Contract as in source.h: ops and callbacks on the loop thread. A client is
 * named by a handle that the publisher gives out and that is never used again after disconnected().
 */
#ifndef LP_PUBLISHER_H
#define LP_PUBLISHER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/backend.h"

struct lp_loop;
struct lp_packet;
struct lp_places;
struct lp_publisher;
struct lp_uri;
struct lp_wish;
struct lp_client; /* owned by the publisher */

/* Longest request a client may send; a Subscription needs about 30 bytes. */
#define LP_REQUEST_MAX_BYTES 256

/* Callbacks into the application, all on the loop thread. */
struct lp_publisher_host {
	void *context;
	struct lp_loop *loop;	  /* outlives the publisher */
	int max_clients;	  /* of all publishers together */
	struct lp_places *places; /* likewise (drivers/publisher/places.h); outlives them */
	bool insecure_lan;	  /* the user accepts the network without encryption */
	/* May call send() at once. *user is the application's own pointer for this client.
	 * `refusal`: why the publisher will not have it, next step included; NULL: it may stay.
	 * `code` of it: -EACCES, its token is missing or wrong; else -EUSERS. A negative result
	 * refuses it: what was sent goes out, the connection closes, nothing more is heard. */
	int (*connected)(void *context, struct lp_publisher *publisher, struct lp_client *client,
			 int code, const char *refusal, void **user);
	/* One whole request without its length prefix; valid during the call.
	 * A negative result makes the publisher close the connection once its queue is sent. */
	int (*request)(void *context, void *user, const uint8_t *data, size_t size_bytes);
	/* All requests that had come together have been handed over. */
	void (*requests_done)(void *context, void *user);
	/* What the client sends has no readable length (-EMSGSIZE), or is too much (-EDQUOT), or
	 * another needs its place (-EUSERS); may call send(), then the connection closes. */
	void (*unreadable)(void *context, void *user, int code, const char *reason);
	void (*disconnected)(void *context, void *user);
	/* A packet was given up for a newer one before it was sent. */
	void (*superseded)(void *context, void *user);
	/* This publisher cannot go on, and the daemon ends; -EPIPE: because the only client there
	 * can ever be has gone, which is no fault. */
	void (*failed)(void *context, struct lp_publisher *publisher, int failure);
};

struct lp_publisher_ops {
	struct lp_backend info;
	int (*create)(const struct lp_uri *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher);
	int (*start)(struct lp_publisher *publisher);
	/* Holds its own reference to `packet` while it needs it. Never blocks, never calls the
	 * host. */
	void (*send)(struct lp_publisher *publisher, struct lp_client *client,
		     struct lp_packet *packet);
	/* Bytes of a packet still wait for a client that may take them. */
	bool (*pending)(const struct lp_publisher *publisher);
	void (*destroy)(struct lp_publisher *publisher);
};

/* Base of every back end: embed it as the first member. */
struct lp_publisher {
	const struct lp_publisher_ops *ops;
	/* Set by create(): open to the network without encryption; when clients no longer accept
	 * its certificate, by Unix time (0: it has none). */
	bool is_insecure;
	int64_t t_expires_unix_ns;
	/* Why it serves nobody, next step included; NULL: it does. May change, and then is another
	 * pointer. The text stays until the publisher is destroyed, or the pointer has changed
	 * twice.
	 */
	const char *waits_for;
	/* Set by create(): what its clients get, who cannot ask. NULL: they may ask. */
	const struct lp_wish *wish;
	struct lp_publisher_host host;
};

#endif
