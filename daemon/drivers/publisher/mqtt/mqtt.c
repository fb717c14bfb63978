/* SPDX-License-Identifier: Apache-2.0 */
/* mqtt:HOST[:PORT]/TOPIC and mqtts: — the newest message of each kind to a broker, which keeps it
 * for whoever comes. One client, which cannot ask for anything. */
#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "base/uri.h"
#include "drivers/link/bus_thread.h"
#include "drivers/publisher/framing.h"
#include "drivers/publisher/mqtt/options.h"
#include "drivers/publisher/mqtt/session.h"
#include "include/packet.h"
#include "include/publisher.h"

/* A broker that has not answered by then is told as a fault. */
#define PATIENCE_NS (5 * LP_NS_PER_S)
#define LET_GO_MS 1000

/* The newest message of a kind stays here: a broker that comes back may have forgotten it. */
struct slot {
	struct lp_packet *packet; /* NULL: none yet */
	bool is_due;
};

struct mqtt_publisher {
	struct lp_publisher base;
	char *object; /* the URI; names it in messages */
	struct lp_mqtt_options options;
	struct lp_bus_thread *thread; /* NULL: not started */
	struct lp_watch watch;
	struct lp_timer patience;
	struct slot slots[LP_MQTT_TOPICS];
	uint32_t connection;
	bool is_connected, is_sending, has_failed, was_announced;
	char waits[2][200]; /* base.waits_for, and the one before */
	int newest_wait;    /* of them */
	void *user;
};

static struct mqtt_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct mqtt_publisher *)publisher;
}

/* ---------------------------------------------------------------- sending */

/* Hand a message to the thread; its socket has room for the one that may be under way. */
static void hand_over(struct mqtt_publisher *self, int topic)
{
	const size_t header_bytes = offsetof(struct lp_mqtt_message, data);
	struct lp_mqtt_message header = {.connection = self->connection, .topic = (uint32_t)topic};
	struct lp_packet *packet = self->slots[topic].packet;
	size_t offset = 0, size = 0;
	struct iovec parts[2] = {{&header, header_bytes}};

	self->slots[topic].is_due = false;
	if (packet && lp_framing_next(packet->data, packet->size_bytes, LP_PACKET_MAX_BYTES,
				      &offset, &size) == 1)
		parts[1] = (struct iovec){packet->data + offset, size};
	const struct msghdr message = {.msg_iov = parts, .msg_iovlen = LP_COUNT(parts)};

	self->is_sending = sendmsg(self->watch.fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT) > 0;
}

static void send_next(struct mqtt_publisher *self)
{
	for (int i = 0; i < LP_MQTT_TOPICS && self->is_connected && !self->is_sending; i++) {
		if (self->slots[i].is_due)
			hand_over(self, i);
	}
}

static int topic_of(const struct lp_packet *packet)
{
	for (int i = 0; i < LP_MQTT_TOPICS; i++) {
		if (packet->name && strcmp(packet->name, lp_mqtt_topics[i]) == 0)
			return i;
	}
	return -1; /* an answer to a request: nobody has asked */
}

static void mqtt_send(struct lp_publisher *publisher, struct lp_client *client,
		      struct lp_packet *packet)
{
	struct mqtt_publisher *self = self_of(publisher);
	const int topic = topic_of(packet);
	struct slot *slot;

	(void)client;
	if (topic < 0)
		return;
	slot = &self->slots[topic];
	if (slot->is_due && slot->packet)
		publisher->host.superseded(publisher->host.context, self->user);
	lp_packet_hold(packet);
	lp_packet_drop(slot->packet);
	*slot = (struct slot){.packet = packet, .is_due = true};
	send_next(self);
}

/* Of a broker that is away nothing is awaited, once that is known. */
static bool mqtt_pending(const struct lp_publisher *publisher)
{
	const struct mqtt_publisher *self = self_of(publisher);
	bool is_due = self->is_sending;

	for (int i = 0; i < LP_MQTT_TOPICS; i++)
		is_due |= self->slots[i].is_due;
	return is_due && !self->has_failed;
}

/* ---------------------------------------------------------------- what the thread tells */

static void wait_for_broker(struct mqtt_publisher *self, const char *stage, const char *why)
{
	char *text = self->waits[!self->newest_wait];
	const int shown = (int)strcspn(self->object, "?");

	(void)snprintf(text, sizeof(self->waits[0]), "%.*s: %s: %s", shown, self->object, stage,
		       why);
	if (self->base.waits_for && strcmp(self->base.waits_for, text) == 0)
		return;
	self->base.waits_for = text;
	self->newest_wait = !self->newest_wait;
	lp_warning(self->object, stage, "%s; trying again", why);
}

static void begin(struct mqtt_publisher *self, uint32_t connection)
{
	lp_info(self->object, "connect", "%s", "the broker is there");
	self->connection = connection;
	self->is_connected = true;
	self->is_sending = self->has_failed = false;
	self->base.waits_for = NULL;
	lp_timer_stop(&self->patience);
	/* Also what is not there yet: the broker may have kept another start's. */
	for (int i = 0; i < LP_MQTT_TOPICS; i++)
		self->slots[i].is_due = true;
}

static void on_report(struct mqtt_publisher *self, const struct lp_mqtt_report *told)
{
	if (told->event == LP_MQTT_CONNECTED) {
		begin(self, told->connection);
	} else if (told->event == LP_MQTT_AWAY) {
		self->is_connected = self->is_sending = false;
		self->has_failed = true;
		wait_for_broker(self, told->stage, told->text);
	} else if (told->connection == self->connection) {
		self->is_sending = false;
	}
	send_next(self);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct mqtt_publisher *self = LP_CONTAINER_OF(watch, struct mqtt_publisher, watch);
	struct lp_mqtt_report told;

	(void)events;
	if (recv(watch->fd, &told, sizeof(told), MSG_DONTWAIT) == sizeof(told))
		on_report(self, &told);
}

static void on_patience(struct lp_timer *timer)
{
	struct mqtt_publisher *self = LP_CONTAINER_OF(timer, struct mqtt_publisher, patience);

	if (!self->base.waits_for && !self->is_connected)
		wait_for_broker(self, "connect",
				"no answer yet — is the address right, is the network up?");
}

/* ---------------------------------------------------------------- life */

static int mqtt_start(struct lp_publisher *publisher)
{
	struct mqtt_publisher *self = self_of(publisher);
	int ret = lp_mqtt_session_start(&self->options, &self->thread);

	if (ret == 0)
		ret = lp_watch_start(publisher->host.loop, &self->watch,
				     lp_bus_thread_fd(self->thread), LP_READABLE, on_ready);
	if (ret < 0) {
		lp_error(self->object, "start", "%s", lp_strerror(ret));
		return ret;
	}
	lp_timer_set(&self->patience, PATIENCE_NS, 0);
	/* Its place is taken now: no crowd of other clients keeps the broker out. */
	self->was_announced =
		publisher->host.connected(publisher->host.context, publisher,
					  (struct lp_client *)self, 0, NULL, &self->user) == 0;
	return 0;
}

static void mqtt_destroy(struct lp_publisher *publisher)
{
	struct mqtt_publisher *self = self_of(publisher);

	if (!publisher)
		return;
	if (self->was_announced)
		publisher->host.disconnected(publisher->host.context, self->user);
	lp_timer_stop(&self->patience);
	lp_watch_stop(&self->watch);
	lp_bus_thread_destroy(self->thread, LET_GO_MS);
	for (int i = 0; i < LP_MQTT_TOPICS; i++)
		lp_packet_drop(self->slots[i].packet);
	free(self->object);
	free(self);
}

/* Everything that the user can have written wrongly shows here. */
static int read_uri(struct mqtt_publisher *self, const struct lp_uri *uri)
{
	int ret = lp_mqtt_options_read(&self->options, uri);

	if (ret == 0 && !self->options.is_tls)
		ret = lp_mqtt_check_open(&self->options.broker, uri->text,
					 self->base.host.insecure_lan);
	self->base.is_insecure = ret > 0;
	return ret < 0 ? ret : 0;
}

static int create(const struct lp_publisher_ops *ops, bool is_tls, const struct lp_uri *uri,
		  const struct lp_publisher_host *host, struct lp_publisher **publisher)
{
	struct mqtt_publisher *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self)
		return ret;
	self->base = (struct lp_publisher){.ops = ops, .host = *host, .wish = &self->options.wish};
	self->options.is_tls = is_tls;
	self->watch.fd = -1;
	lp_timer_init(host->loop, &self->patience, on_patience);
	self->object = strdup(uri->text);
	if (self->object)
		ret = read_uri(self, uri);
	if (ret < 0) {
		mqtt_destroy(&self->base);
		return ret;
	}
	*publisher = &self->base;
	return 0;
}

const struct lp_publisher_ops lp_publisher_mqtt_ops;
const struct lp_publisher_ops lp_publisher_mqtts_ops;

static int mqtt_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
		       struct lp_publisher **publisher)
{
	return create(&lp_publisher_mqtt_ops, false, uri, host, publisher);
}

static int mqtts_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
			struct lp_publisher **publisher)
{
	return create(&lp_publisher_mqtts_ops, true, uri, host, publisher);
}

const struct lp_publisher_ops lp_publisher_mqtt_ops = {
	.info = {.scheme = "mqtt",
		 .form = "HOST[:PORT]/TOPIC",
		 .help = "the newest messages to an MQTT broker, which keeps them for all who ask\n"
			 "Beyond loopback it is unencrypted: with --insecure-lan only.",
		 .params = &lp_mqtt_params},
	.create = mqtt_create,
	.start = mqtt_start,
	.send = mqtt_send,
	.pending = mqtt_pending,
	.destroy = mqtt_destroy,
};

const struct lp_publisher_ops lp_publisher_mqtts_ops = {
	.info = {.scheme = "mqtts",
		 .form = "HOST[:PORT]/TOPIC",
		 .help = "the same with TLS",
		 .params = &lp_mqtts_params},
	.create = mqtts_create,
	.start = mqtt_start,
	.send = mqtt_send,
	.pending = mqtt_pending,
	.destroy = mqtt_destroy,
};
