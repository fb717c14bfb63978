/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/web_client.h"

#include <errno.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/macros.h"
#include "drivers/publisher/peer.h"
#include "drivers/publisher/websocket/server.h"
#include "include/publisher.h"

/* How often what clients have sent is counted. */
#define METER_NS (100 * LP_NS_PER_MS)
/* A client that closes, and sends more than so much, is cut off. */
#define LINGER_BYTES (64 << 10)

static void add_client(struct lp_web_client *client)
{
	struct lp_web_clients *self = client->owner;

	client->next = self->first;
	if (client->next)
		client->next->previous = client;
	self->first = client;
}

void lp_web_client_remove(struct lp_web_client *client)
{
	if (client->previous)
		client->previous->next = client->next;
	else
		client->owner->first = client->next;
	if (client->next)
		client->next->previous = client->previous;
	lp_place_give(&client->place);
	lp_send_queue_clear(&client->queue);
	free(client);
}

void lp_web_client_close(struct lp_web_client *client, const char *reason)
{
	const struct lp_publisher_host *host = &client->owner->publisher->host;

	if (client->closing)
		return;
	client->closing = true;
	if (client->announced)
		host->disconnected(host->context, client->user);
	client->announced = false;
	lp_session_close(client->session, reason);
	lp_place_leave(&client->place);
}

/* Nothing is said to it, for no WebSocket is open. */
static void kill_client(struct lp_web_client *client)
{
	client->closing = true;
	lp_place_give(&client->place);
	if (client->session)
		lp_session_kill(client->session);
}

/* Another needs the place of this one. */
static void on_evicted(struct lp_place *place)
{
	struct lp_web_client *client = LP_CONTAINER_OF(place, struct lp_web_client, place);
	const struct lp_publisher_host *host = &client->owner->publisher->host;

	if (!client->announced) {
		kill_client(client);
		return;
	}
	host->unreadable(host->context, client->user, -EUSERS, LP_NO_MORE_PLACES);
	lp_web_client_close(client, "another client needs the place");
}

bool lp_web_client_charge(struct lp_web_client *client, int64_t cost_ns)
{
	const struct lp_publisher_host *host = &client->owner->publisher->host;

	if (client->closing || lp_place_charge(&client->place, cost_ns))
		return true;
	if (!client->announced) {
		kill_client(client);
		return false;
	}
	host->unreadable(host->context, client->user, -EDQUOT, LP_ALLOWANCE_SPENT);
	lp_web_client_close(client, "too much");
	return false;
}

/* Pings, pongs and empty fragments never come to us, so that bytes are counted. */
static void on_meter(struct lp_timer *timer)
{
	const struct lp_web_clients *self = LP_CONTAINER_OF(timer, struct lp_web_clients, meter);

	for (struct lp_web_client *client = self->first; client; client = client->next) {
		uint64_t received, more;

		if (!client->session || !client->place.places)
			continue;
		received = lp_session_received_bytes(client->session);
		more = received - client->received_bytes;
		if (client->closing && more > LINGER_BYTES) {
			kill_client(client);
		} else if (!client->closing) {
			client->received_bytes = received;
			(void)lp_web_client_charge(client, (int64_t)more * LP_COST_BYTE_NS);
		}
	}
}

int lp_web_client_add(struct lp_web_clients *clients, int fd, bool is_tls,
		      struct lp_web_client **added)
{
	struct lp_web_client *client = calloc(1, sizeof(*client));
	struct lp_peer peer;
	int ret;

	if (!client)
		return -ENOMEM;
	lp_peer_read(fd, &peer);
	ret = lp_place_take(clients->publisher->host.places, &client->place, &peer,
			    LP_COST_CONNECTION_NS + (is_tls ? LP_COST_TLS_NS : 0), on_evicted);
	if (ret < 0) {
		free(client);
		return ret;
	}
	client->owner = clients;
	add_client(client);
	lp_place_wait(&client->place);
	*added = client;
	return 0;
}

/* ---------------------------------------------------------------- all of them */

void lp_web_clients_init(struct lp_web_clients *clients, struct lp_publisher *publisher)
{
	*clients = (struct lp_web_clients){.publisher = publisher};
	lp_timer_init(publisher->host.loop, &clients->meter, on_meter);
}

void lp_web_clients_start(struct lp_web_clients *clients)
{
	lp_timer_set(&clients->meter, METER_NS, METER_NS);
}

bool lp_web_clients_pending(const struct lp_web_clients *clients)
{
	for (const struct lp_web_client *client = clients->first; client; client = client->next) {
		if (!lp_send_queue_is_empty(&client->queue))
			return true;
	}
	return false;
}

void lp_web_clients_finish(struct lp_web_clients *clients)
{
	lp_timer_stop(&clients->meter);
}
