/* SPDX-License-Identifier: Apache-2.0 */
/* What a hub is made of: for the files hub*.c alone. */
#ifndef LP_SERVE_HUB_STATE_H
#define LP_SERVE_HUB_STATE_H

#include "serve/drawn/pace.h"
#include "serve/hub.h"
#include "serve/packets.h"
#include "serve/poses/pose_sender.h"
#include "serve/reflection_maps.h"

/* The estimate that a client was sent last. */
struct lp_hub_sent {
	int64_t t_ns; /* when; 0: none has been, by this subscription */
	uint32_t number;
	struct lp_variant variant;
	struct lp_light_estimate estimate;
};

struct lp_hub_client {
	struct lp_publisher *publisher;
	struct lp_client *handle;
	struct lp_subscription subscription;
	int64_t due_ns;			      /* earliest next estimate */
	struct lp_hub_sent sent;	      /* only of a client that wants nothing but news */
	int64_t reflection_due_ns;	      /* likewise, of reflection maps */
	struct lp_drawn_pace reflection_pace; /* of a client that says what it draws */
	int64_t health_due_ns;
	int64_t second_ns;    /* begin of the second in which requests are counted */
	int requests, poses;  /* in that second */
	bool pose_error_told; /* in that second */
	bool poses_refused;   /* another client's are used: its world is not this one's */
	struct lp_pose_sender sender;
	bool clock_is_wrong; /* its newest pose's time cannot be */
	bool unknown_told;   /* that it asks for what this daemon does not know */
	bool no_reflection_told;
	bool subscribed; /* it has a new subscription, not answered yet */
	int64_t answered_ns;
	bool wants_polarization_map;
	int index; /* in hub->clients */
};

struct lp_hub {
	struct lp_hub_options options;
	struct lp_places *places;
	struct lp_packets *packets;
	struct lp_reflection_maps *reflections; /* NULL: they are off */
	int reflection_first;			/* client whose turn it is first */
	int64_t reflection_late_ns; /* when one had to wait for the next frame; 0: lately none */
	struct lp_pool *client_pool;
	struct lp_hub_client **clients; /* [client_count] */
	int client_count;

	bool has_last;
	struct lp_estimates last;
	struct lp_demand last_computed;
	int64_t last_ns;  /* when it came */
	int64_t stale_ns; /* when it was last repeated; 0: it is fresh */
	uint32_t sequence;
	int64_t polarization_map_ns; /* when the last one was sent; 0: none yet */
};

/* Send and drop `packet`, which may be NULL. */
void lp_hub_send_last(struct lp_hub *hub, struct lp_hub_client *client, struct lp_packet *packet);

void lp_hub_send_error(struct lp_hub *hub, struct lp_hub_client *client, int code,
		       const char *text);

/* Send the last estimate to a client that has subscribed anew; too soon after such an answer it
 * waits for the next tick. Its schedule begins here. */
void lp_hub_answer_subscription(struct lp_hub *hub, struct lp_hub_client *client, int64_t now_ns);

/* hub_news.c: whether the last estimate says to a client nothing that the one before did not, and
 * none is due all the same; `wanted`: its subscription. And: it is sent. */
bool lp_hub_has_no_news(struct lp_hub *hub, const struct lp_hub_client *client,
			const struct lp_subscription *wanted, int64_t now_ns);
void lp_hub_note_sent(struct lp_hub *hub, struct lp_hub_client *client,
		      const struct lp_subscription *wanted);

/* hub_requests.c: what a publisher calls (include/publisher.h); `context`: the hub, `user`: the
 * client. Of several subscriptions that came together the newest is answered. */
int lp_hub_on_request(void *context, void *user, const uint8_t *data, size_t size_bytes);
void lp_hub_on_requests_done(void *context, void *user);
void lp_hub_on_unreadable(void *context, void *user, int code, const char *reason);

/* Times of this client's poses cannot be, or are right (`text` NULL), or it leaves. The fault is
 * told as long as it is so of any client. */
void lp_hub_clock_fault(struct lp_hub *hub, struct lp_hub_client *client, const char *text);

/* An error, also in the log; the connection stays. */
void lp_hub_refuse_request(struct lp_hub *hub, struct lp_hub_client *client, int code,
			   const char *what, const char *reason);

/* hub_polarization.c: requests that concern the polarizer, granted or refused. */
void lp_hub_want_polarization(struct lp_hub *hub, struct lp_hub_client *client);
void lp_hub_start_sweep(struct lp_hub *hub, struct lp_hub_client *client);
bool lp_hub_polarization_is_due(const struct lp_hub *hub);

#endif
