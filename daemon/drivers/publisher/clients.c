/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/clients.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "drivers/publisher/framing.h"
#include "drivers/publisher/places.h"
#include "drivers/publisher/queue.h"
#include "include/packet.h"
#include "include/publisher.h"

/* A closing client may take so long to read its last packet. */
#define LINGER_NS (2 * LP_NS_PER_S)
/* What it still sends is read to make room, so that the last packet is not lost; but not more. */
#define LINGER_BYTES (64 << 10)

struct lp_client {
	struct lp_clients *owner;
	struct lp_client *next, *previous;
	struct lp_watch watch;
	void *user;
	bool announced;	      /* the host knows it: it will hear disconnected() */
	int64_t closing_ns;   /* nothing more is taken from it or queued for it; 0: open */
	size_t ignored_bytes; /* since it closes */
	struct lp_place place;
	struct lp_send_queue queue;
	size_t input_bytes;
	uint8_t input[LP_LENGTH_MAX_BYTES + LP_REQUEST_MAX_BYTES];
};

static const struct lp_publisher_host *host_of(const struct lp_clients *clients)
{
	return &clients->publisher->host;
}

/* ---------------------------------------------------------------- closing */

static void close_client(struct lp_client *client)
{
	struct lp_clients *self = client->owner;
	const int fd = client->watch.fd;

	if (client->announced)
		host_of(self)->disconnected(host_of(self)->context, client->user);
	lp_place_give(&client->place);
	lp_watch_stop(&client->watch);
	close(fd);
	lp_send_queue_clear(&client->queue);
	if (client->previous)
		client->previous->next = client->next;
	else
		self->first = client->next;
	if (client->next)
		client->next->previous = client->previous;
	free(client);
}

/* All is sent: say so, then wait for the client to close, or its last packet might be lost. */
static void shut_when_sent(struct lp_client *client)
{
	if (client->closing_ns && lp_send_queue_is_empty(&client->queue))
		(void)shutdown(client->watch.fd, SHUT_WR);
}

static void begin_closing(struct lp_client *client)
{
	struct lp_clients *self = client->owner;

	if (client->closing_ns)
		return;
	client->closing_ns = lp_clock_ns();
	if (!self->reaping)
		lp_timer_set(&self->reaper, LINGER_NS / 2, LINGER_NS / 2);
	self->reaping = true;
	if (client->announced)
		host_of(self)->disconnected(host_of(self)->context, client->user);
	client->announced = false;
	shut_when_sent(client);
	lp_place_leave(&client->place);
}

/* Another needs the place of this one. */
static void on_evicted(struct lp_place *place)
{
	struct lp_client *client = LP_CONTAINER_OF(place, struct lp_client, place);
	const struct lp_publisher_host *host = host_of(client->owner);

	if (client->closing_ns) {
		close_client(client);
		return;
	}
	host->unreadable(host->context, client->user, -EUSERS, LP_NO_MORE_PLACES);
	begin_closing(client);
}

static void on_reap(struct lp_timer *timer)
{
	struct lp_clients *self = LP_CONTAINER_OF(timer, struct lp_clients, reaper);
	const int64_t now_ns = lp_clock_ns();
	struct lp_client *next;
	int closing = 0;

	for (struct lp_client *client = self->first; client; client = next) {
		next = client->next;
		if (!client->closing_ns)
			continue;
		closing++;
		if (now_ns - client->closing_ns >= LINGER_NS)
			close_client(client);
	}
	self->reaping = closing > 0;
	if (!self->reaping)
		lp_timer_stop(timer);
}

/* ---------------------------------------------------------------- sending */

/* A closing client that sends without end is not read any more. */
static void watch_for(struct lp_client *client, bool writable)
{
	const unsigned int read = client->ignored_bytes > LINGER_BYTES ? LP_HANGUP : LP_READABLE;

	lp_watch_change(&client->watch, writable ? LP_WRITABLE | (read & LP_READABLE) : read);
}

/* Never closes: the host may be in the middle of its list. The loop reports the hang-up. */
static void flush(struct lp_client *client)
{
	const int ret = lp_send_queue_flush(&client->queue, client->watch.fd);

	if (ret < 0) {
		lp_send_queue_clear(&client->queue);
		(void)shutdown(client->watch.fd, SHUT_RDWR);
	}
	watch_for(client, ret > 0);
	shut_when_sent(client);
}

void lp_client_send(struct lp_client *client, struct lp_packet *packet)
{
	const struct lp_publisher_host *host = host_of(client->owner);
	const bool waits = client->watch.events & LP_WRITABLE;

	if (client->closing_ns)
		return;
	if (lp_send_queue_put(&client->queue, packet))
		host->superseded(host->context, client->user);
	if (!waits)
		flush(client);
}

/* ---------------------------------------------------------------- receiving */

static const char *unreadable_reason(int ret)
{
	return ret == -EMSGSIZE ? "longer than a request may be (256 bytes)"
				: "does not begin with its length as a varint";
}

/* Hand over every whole request. False: the client is to be closed. */
static bool take_requests(struct lp_client *client)
{
	const struct lp_publisher_host *host = host_of(client->owner);
	size_t used = 0, offset, size;
	int ret;

	for (;;) {
		ret = lp_framing_next(client->input + used, client->input_bytes - used,
				      LP_REQUEST_MAX_BYTES, &offset, &size);
		if (ret != 1)
			break;
		if (!lp_place_charge(&client->place, LP_COST_REQUEST_NS)) {
			host->unreadable(host->context, client->user, -EDQUOT, LP_ALLOWANCE_SPENT);
			return false;
		}
		ret = host->request(host->context, client->user, client->input + used + offset,
				    size);
		if (ret < 0)
			return false;
		used += offset + size;
	}
	if (ret < 0) {
		host->unreadable(host->context, client->user, -EMSGSIZE, unreadable_reason(ret));
		return false;
	}
	host->requests_done(host->context, client->user);
	client->input_bytes -= used;
	memmove(client->input, client->input + used, client->input_bytes);
	return true;
}

/* One read: a client that talks without end gets no more than its turn. */
static void receive(struct lp_client *client)
{
	const ssize_t got = read(client->watch.fd, client->input + client->input_bytes,
				 sizeof(client->input) - client->input_bytes);

	if (got < 0 && (errno == EAGAIN || errno == EINTR))
		return;
	if (got <= 0) {
		close_client(client);
		return;
	}
	if (client->closing_ns) {
		client->ignored_bytes += (size_t)got;
		watch_for(client, client->watch.events & LP_WRITABLE);
		return;
	}
	client->input_bytes += (size_t)got;
	if (!take_requests(client)) {
		client->input_bytes = 0;
		begin_closing(client);
	}
}

static void on_client_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_client *client = LP_CONTAINER_OF(watch, struct lp_client, watch);

	if (events & LP_HANGUP) {
		close_client(client);
		return;
	}
	if (events & LP_WRITABLE)
		flush(client);
	if (events & LP_READABLE)
		receive(client);
}

/* ---------------------------------------------------------------- all of them */

void lp_clients_init(struct lp_clients *clients, struct lp_publisher *publisher)
{
	*clients = (struct lp_clients){.publisher = publisher};
	lp_timer_init(publisher->host.loop, &clients->reaper, on_reap);
}

void lp_clients_finish(struct lp_clients *clients)
{
	struct lp_client *next;

	for (struct lp_client *client = clients->first; client; client = next) {
		next = client->next;
		close_client(client);
	}
	lp_timer_stop(&clients->reaper);
}

int lp_clients_add(struct lp_clients *clients, int fd, const struct lp_peer *peer,
		   struct lp_share *share)
{
	struct lp_client *client = calloc(1, sizeof(*client));
	const struct lp_publisher_host *host = host_of(clients);
	int ret = client ? 0 : -ENOMEM;
	const char *refusal;
	char text[96];

	if (ret == 0)
		ret = lp_place_take(host->places, &client->place, peer, LP_COST_CONNECTION_NS,
				    on_evicted);
	if (ret == 0)
		ret = lp_watch_start(host->loop, &client->watch, fd, LP_READABLE, on_client_ready);
	if (ret < 0) {
		if (client)
			lp_place_give(&client->place);
		free(client);
		return ret;
	}
	client->owner = clients;
	client->next = clients->first;
	if (client->next)
		client->next->previous = client;
	clients->first = client;
	refusal = lp_place_admit(&client->place, share, clients->publisher->ops->info.scheme, text,
				 sizeof(text));
	if (host->connected(host->context, clients->publisher, client, -EUSERS, refusal,
			    &client->user) < 0)
		begin_closing(client);
	else
		client->announced = true;
	return 0;
}

bool lp_clients_pending(const struct lp_clients *clients)
{
	for (const struct lp_client *client = clients->first; client; client = client->next) {
		if (!lp_send_queue_is_empty(&client->queue))
			return true;
	}
	return false;
}
