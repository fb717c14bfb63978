/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Between one stream of estimates and many clients, each with a subscription of its own. Clients
 * that want the same get the same packet, encoded once. All calls on the loop thread.
 */
#ifndef LP_SERVE_HUB_H
#define LP_SERVE_HUB_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/estimates.h"
#include "include/publisher.h"
#include "serve/codec/codec.h"

struct lp_health;
struct lp_hub;
struct lp_orientation_sample;
struct lp_polarization_grid;

struct lp_hub_options {
	struct lp_hello hello;
	/* What a client gets before it subscribes. */
	struct lp_subscription initial;
	uint32_t ttl_ms;
	bool lasts; /* an estimate does not become stale: it is that of a set */
	int max_clients;
	bool insecure_lan;	  /* publishers may be open to the network without encryption */
	struct lp_health *health; /* counted into; borrowed */
	struct lp_loop *loop;	  /* the publishers'; outlives them */
	void *context;
	/* A client's head pose, mapped onto our clock; results as lp_orientation_pose() has them.
	 * And: it has left. NULL: poses are not used. */
	int (*pose)(void *context, const void *client, const struct lp_orientation_sample *sample);
	void (*left)(void *context, const void *client);
	/* As lp_instruments_sweep(). NULL: there is no wheel. */
	int (*sweep)(void *context, uint64_t *done_at, const char **reason);
	/* Cameras for stills are to take a set; how many do, or -errno with the reason. */
	int (*stills)(void *context, const char **reason);
	/* A publisher cannot go on (publisher.h). */
	void (*failed)(void *context, int failure);
};

int lp_hub_create(const struct lp_hub_options *options, struct lp_hub **hub);

/* The callbacks to give to every publisher. */
struct lp_publisher_host lp_hub_publisher_host(struct lp_hub *hub);

/*
 * Send the estimates to every client that is due, and keep them for those to come. `computed` says
 * what they hold. The hub counts them: `sequence` is its own.
 */
void lp_hub_publish(struct lp_hub *hub, const struct lp_estimates *estimates,
		    const struct lp_demand *computed);

/* A picture that lp_hub_demand() asked for: send it to all who wait for one. */
void lp_hub_publish_polarization(struct lp_hub *hub, const struct lp_polarization_grid *grid);

/* Health messages that are due, and the last estimate marked stale when frames stay away; call it
 * several times a second. */
void lp_hub_tick(struct lp_hub *hub);

/* The preset in force has changed: tell all clients. `name`: static storage. */
void lp_hub_preset(struct lp_hub *hub, const char *name);

/* What cameras do to their pictures has changed: tell all clients. `on`: LP_PROCESSING_BIT() of
 * each. */
void lp_hub_processing(struct lp_hub *hub, uint32_t on);

/* A publisher is open to the network without encryption: clients are told from now on. */
void lp_hub_set_insecure(struct lp_hub *hub);

/* The most that any client asks for. */
struct lp_demand lp_hub_demand(const struct lp_hub *hub);

/* Accepts NULL. Publishers must be destroyed before. */
void lp_hub_destroy(struct lp_hub *hub);

#endif
