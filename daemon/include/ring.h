/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The ring of light sensors. One back end = one file drivers/ring/<scheme>.c with one
 * `const struct lp_ring_ops`, registered by one line in app/backends.c. Contract as in source.h.
 */
#ifndef LP_RING_H
#define LP_RING_H

#include <stdint.h>

#include "include/backend.h"

struct lp_connections;
struct lp_loop;
struct lp_ring;
struct lp_ring_sample;
struct lp_uri;

/* Callbacks into the application, all on the loop thread. */
struct lp_ring_host {
	void *context;
	struct lp_loop *loop; /* outlives the ring */
	void (*sample)(void *context, const struct lp_ring_sample *sample);
	/* As in rotator.h. */
	void (*fault)(void *context, const char *id, const char *text);
	struct lp_connections *connections; /* shared with other roles; outlives the ring */
};

struct lp_ring_ops {
	struct lp_backend info;
	int (*create)(const struct lp_uri *uri, const struct lp_ring_host *host,
		      struct lp_ring **ring);
	int (*start)(struct lp_ring *ring);
	void (*destroy)(struct lp_ring *ring); /* accepts NULL */
};

/* Base of every back end: embed it as the first member. */
struct lp_ring {
	const struct lp_ring_ops *ops;
	struct lp_ring_host host;
};

#endif
