/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/mqtt/session.h"

#include <errno.h>
#include <mosquitto.h>
#include <openssl/crypto.h>
#include <poll.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/macros.h"
#include "base/text.h"
#include "drivers/link/bus_thread.h"
#include "drivers/publisher/mqtt/reasons.h"

/* The broker tells the last will when it has heard nothing for one and a half of these. */
#define KEEPALIVE_S 10
#define TURN_MS 500
#define CONNACK_TURNS 20 /* an answer of the broker takes no longer */
#define LEAVE_MS 500	 /* how long the farewell may take */
#define RETRY_FIRST_NS (250 * LP_NS_PER_MS)
#define RETRY_LONGEST_NS (10 * LP_NS_PER_S)
/* A connection that lasts longer was a good one: the next attempt comes soon. */
#define GOOD_NS RETRY_LONGEST_NS
#define ONLINE "online"
#define OFFLINE "offline"

const char *const lp_mqtt_topics[LP_MQTT_TOPICS] = {
	[LP_MQTT_HELLO] = "hello",
	[LP_MQTT_ESTIMATE] = "estimate",
	[LP_MQTT_HEALTH] = "health",
};

struct session {
	struct lp_mqtt_options options;
	char id[24];	/* at most 23 bytes are sure to be taken */
	int fd;		/* the thread's end of the pair */
	bool is_ending; /* the loop has closed its end */
	uint32_t connection;

	struct mosquitto *broker;
	bool is_open;	 /* the broker has answered */
	bool is_sending; /* a message is on its way, and not reported yet */
	struct lp_mqtt_failure failure;
	struct lp_mqtt_message message;
};

/* ---------------------------------------------------------------- the loop's side */

static void report(const struct session *self, struct lp_mqtt_report *told)
{
	told->connection = self->connection;
	(void)send(self->fd, told, sizeof(*told), MSG_NOSIGNAL | MSG_DONTWAIT);
}

static void report_away(struct session *self, const char *stage, const char *text)
{
	struct lp_mqtt_report told = {.event = LP_MQTT_AWAY, .stage = stage};

	lp_text_copy(told.text, sizeof(told.text), text);
	report(self, &told);
}

static void publish(struct session *self, const char *topic, const void *data, size_t size_bytes)
{
	char name[LP_MQTT_TOPIC_BYTES + 16];

	(void)snprintf(name, sizeof(name), "%s/%s", self->options.topic, topic);
	/* What fails shows in the loop of the library. */
	(void)mosquitto_publish(self->broker, NULL, name, (int)size_bytes, data, 0, true);
}

/* A message that waits, if any does, into `message`. Its size without the header; -1: none. */
static ssize_t take_message(struct session *self)
{
	const size_t header = offsetof(struct lp_mqtt_message, data);
	const ssize_t size = recv(self->fd, &self->message, sizeof(self->message), MSG_DONTWAIT);

	if (size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR))
		self->is_ending = true;
	return size < (ssize_t)header ? -1 : size - (ssize_t)header;
}

static void pass_on(struct session *self)
{
	const ssize_t size = take_message(self);

	if (size < 0 || self->message.connection != self->connection ||
	    self->message.topic >= LP_MQTT_TOPICS)
		return;
	publish(self, lp_mqtt_topics[self->message.topic], self->message.data, (size_t)size);
	self->is_sending = true;
}

/* ---------------------------------------------------------------- calls of the library */

static void on_connected(struct mosquitto *broker, void *context, int refusal)
{
	struct session *self = context;
	struct lp_mqtt_report told = {.event = LP_MQTT_CONNECTED};

	(void)broker;
	self->failure.refusal = refusal;
	if (refusal)
		return;
	self->is_open = self->failure.was_connected = true;
	self->connection++;
	publish(self, "state", ONLINE, strlen(ONLINE));
	report(self, &told);
}

static void on_log(struct mosquitto *broker, void *context, int level, const char *text)
{
	struct session *self = context;

	(void)broker, (void)level;
	if (strstr(text, "certificate verify failed"))
		self->failure.is_untrusted = true;
	if (strstr(text, "host name verification failed"))
		self->failure.is_other_name = true;
}

/* Nothing is subscribed to, so nothing may come: a broker does not steer the probe, nor fill it. */
static void on_message(struct mosquitto *broker, void *context,
		       const struct mosquitto_message *message)
{
	((struct session *)context)->failure.is_unasked = true;
	(void)message;
	(void)mosquitto_disconnect(broker);
}

/* ---------------------------------------------------------------- one connection */

static int set_login(struct session *self, char *why, size_t size_bytes)
{
	struct lp_mqtt_login login;
	int ret;

	self->failure.has_login = *self->options.login;
	if (!self->failure.has_login)
		return 0;
	ret = lp_mqtt_login_read(self->options.login, &login, why, size_bytes);
	if (ret == 0 && mosquitto_username_pw_set(self->broker, login.user, login.password) != 0)
		ret = -ENOMEM;
	explicit_bzero(&login, sizeof(login));
	return ret;
}

static int set_tls(struct session *self)
{
	const char *ca = *self->options.ca ? self->options.ca : NULL;

	if (!self->options.is_tls)
		return 0;
	if (!ca)
		return mosquitto_int_option(self->broker, MOSQ_OPT_TLS_USE_OS_CERTS, 1);
	return mosquitto_tls_set(self->broker, ca, NULL, NULL, NULL, NULL);
}

/* False: reported. */
static bool prepare(struct session *self)
{
	char will[LP_MQTT_TOPIC_BYTES + 16], why[1200] = "out of memory";

	self->failure = (struct lp_mqtt_failure){.is_tls = self->options.is_tls};
	self->is_open = self->is_sending = false;
	self->broker = mosquitto_new(self->id, true, self);
	if (!self->broker) {
		report_away(self, "connect", why);
		return false;
	}
	mosquitto_connect_callback_set(self->broker, on_connected);
	mosquitto_log_callback_set(self->broker, on_log);
	mosquitto_message_callback_set(self->broker, on_message);
	(void)mosquitto_int_option(self->broker, MOSQ_OPT_TCP_NODELAY, 1);
	(void)snprintf(will, sizeof(will), "%s/state", self->options.topic);
	(void)mosquitto_will_set(self->broker, will, (int)strlen(OFFLINE), OFFLINE, 0, true);
	if (set_login(self, why, sizeof(why)) < 0) {
		report_away(self, "login", why);
		return false;
	}
	if (set_tls(self) != MOSQ_ERR_SUCCESS) {
		report_away(self, "ca", "the file holds no certificate — name one in PEM");
		return false;
	}
	return true;
}

/* One turn of the library's loop, after poll(). */
static int turn(struct session *self, int events)
{
	int code = MOSQ_ERR_SUCCESS;

	if (events & (POLLIN | POLLHUP | POLLERR))
		code = mosquitto_loop_read(self->broker, 1);
	if (code == MOSQ_ERR_SUCCESS && events & POLLOUT)
		code = mosquitto_loop_write(self->broker, 1);
	if (code == MOSQ_ERR_SUCCESS)
		code = mosquitto_loop_misc(self->broker);
	if (code == MOSQ_ERR_SUCCESS && self->is_sending && !mosquitto_want_write(self->broker)) {
		self->is_sending = false;
		report(self, &(struct lp_mqtt_report){.event = LP_MQTT_SENT});
	}
	return code;
}

/* Until the connection is lost, or the loop wants no more. Why it was lost. */
static int serve(struct session *self)
{
	int code = MOSQ_ERR_SUCCESS;

	for (int turns = 0; code == MOSQ_ERR_SUCCESS; turns += !self->is_open) {
		const bool writes = mosquitto_want_write(self->broker);
		struct pollfd fds[] = {
			{.fd = self->fd, .events = self->is_open && self->is_sending ? 0 : POLLIN},
			{.fd = mosquitto_socket(self->broker),
			 .events = (short)(POLLIN | (writes ? POLLOUT : 0))},
		};

		(void)poll(fds, LP_COUNT(fds), TURN_MS);
		if (fds[0].revents)
			pass_on(self);
		if (self->is_ending)
			return MOSQ_ERR_SUCCESS;
		code = turn(self, fds[1].revents);
		if (!self->is_open && turns > CONNACK_TURNS)
			code = MOSQ_ERR_KEEPALIVE;
	}
	return code;
}

/* The probe goes as it should: the broker is told, and keeps the last will to itself. */
static void leave(struct session *self)
{
	if (!self->is_open)
		return;
	publish(self, "state", OFFLINE, strlen(OFFLINE));
	for (int waited_ms = 0; waited_ms < LEAVE_MS && mosquitto_want_write(self->broker);
	     waited_ms += 10) {
		struct pollfd writable = {.fd = mosquitto_socket(self->broker), .events = POLLOUT};

		(void)poll(&writable, 1, 10);
		if (mosquitto_loop_write(self->broker, 1) != MOSQ_ERR_SUCCESS)
			return;
	}
	(void)mosquitto_disconnect(self->broker);
}

static void connect_once(struct session *self)
{
	struct lp_mqtt_failure *failure = &self->failure;
	char text[160];

	if (!prepare(self))
		return;
	errno = 0;
	failure->code =
		mosquitto_connect(self->broker, self->options.broker.host,
				  (int)strtol(self->options.broker.port, NULL, 10), KEEPALIVE_S);
	if (failure->code == MOSQ_ERR_SUCCESS)
		failure->code = serve(self);
	failure->number = errno;
	if (self->is_ending) {
		leave(self);
		return;
	}
	const char *stage = lp_mqtt_reason(failure, text, sizeof(text));

	report_away(self, stage, text);
}

/* ---------------------------------------------------------------- the thread */

/* Wait before the next attempt, unless the loop wants no more. What it sends meanwhile is old. */
static void wait_for(struct session *self, int64_t wait_ns)
{
	struct pollfd hung_up = {.fd = self->fd, .events = POLLRDHUP};

	(void)poll(&hung_up, 1, (int)(wait_ns / LP_NS_PER_MS));
	while (!self->is_ending && take_message(self) >= 0) {
	}
}

static void run(void *context, int fd)
{
	struct session *self = context;
	struct lp_backoff backoff = {.first_ns = RETRY_FIRST_NS, .longest_ns = RETRY_LONGEST_NS};

	self->fd = fd;
	while (!self->is_ending) {
		const int64_t start_ns = lp_clock_ns();

		connect_once(self);
		mosquitto_destroy(self->broker);
		self->broker = NULL;
		if (self->failure.was_connected && lp_clock_ns() - start_ns > GOOD_NS)
			lp_backoff_reset(&backoff);
		if (!self->is_ending)
			wait_for(self, lp_backoff_next_ns(&backoff));
	}
	OPENSSL_thread_stop(); /* what it has of this thread; the process may end before the thread
				*/
}

static void finish(void *context)
{
	free(context);
	(void)mosquitto_lib_cleanup();
}

/* Of this start alone: a broker ends the connection of another client of the same id. */
static int make_id(struct session *self)
{
	uint8_t random[6];
	size_t used = (size_t)snprintf(self->id, sizeof(self->id), "lightprobe-");

	if (getrandom(random, sizeof(random), GRND_NONBLOCK) != sizeof(random))
		return -EAGAIN;
	for (size_t i = 0; i < sizeof(random); i++)
		used += (size_t)snprintf(self->id + used, sizeof(self->id) - used, "%02x",
					 random[i]);
	return 0;
}

int lp_mqtt_session_start(const struct lp_mqtt_options *options, struct lp_bus_thread **thread)
{
	struct session *self = calloc(1, sizeof(*self));
	const struct lp_bus_job job = {.context = self, .run = run, .finish = finish};
	int ret;

	if (!self)
		return -ENOMEM;
	self->options = *options;
	(void)mosquitto_lib_init(); /* counts its calls */
	ret = make_id(self);
	if (ret == 0)
		ret = lp_bus_thread_start(&job, thread);
	if (ret < 0)
		finish(self);
	return ret;
}
