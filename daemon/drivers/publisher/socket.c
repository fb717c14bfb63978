/* SPDX-License-Identifier: Apache-2.0 */
/* tcp:HOST:PORT and unix:PATH — many clients on stream sockets, each with a bounded queue. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/publisher/framing.h"
#include "drivers/publisher/listen.h"
#include "drivers/publisher/peer.h"
#include "drivers/publisher/queue.h"
#include "include/packet.h"
#include "include/publisher.h"

#define ACCEPTS_PER_EVENT 8
#define SEND_BUFFER_BYTES (16 << 10) /* a slow client shall get the newest, not seconds of old */
#define LINGER_NS                                                                       \
	(2 * LP_NS_PER_S) /* how long a closing client may take to read its last packet \
			   */
#define KEEPALIVE_IDLE_S 10
#define KEEPALIVE_INTERVAL_S 5
#define KEEPALIVE_PROBES 3
#define UNACKNOWLEDGED_MAX_MS (120 * 1000) /* then a TCP peer counts as gone */

struct socket_publisher;

struct lp_client {
	struct socket_publisher *owner;
	struct lp_client *next, *previous;
	struct lp_watch watch;
	void *user;
	bool announced;	    /* the host knows it: it will hear disconnected() */
	int64_t closing_ns; /* nothing more is taken from it or queued for it; 0: open */
	struct lp_peer peer;
	struct lp_send_queue queue;
	size_t input_bytes;
	uint8_t input[LP_LENGTH_MAX_BYTES + LP_REQUEST_MAX_BYTES];
};

struct listener {
	struct socket_publisher *owner;
	struct lp_watch watch;
};

/* The query of the URI; 0: a share of --max-clients. */
struct options {
	mode_t mode;
	int clients, per_peer;
};

struct socket_publisher {
	struct lp_publisher base;
	char *object; /* the URI; names it in messages */
	bool is_tcp;
	struct lp_tcp_address address; /* of a TCP publisher */
	char *path;		       /* of a Unix one */
	struct options options;
	struct listener listeners[LP_LISTEN_MAX];
	int listener_count;
	struct lp_socket_file file;
	int spare_fd; /* given up for a moment to turn clients away when descriptors run out */
	struct lp_client *clients;
	struct lp_timer reaper; /* closes clients whose time to linger is over */
	bool reaping;		/* the timer runs; setting it anew would put it off */
};

static struct socket_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct socket_publisher *)publisher;
}

/* ---------------------------------------------------------------- closing */

static void close_client(struct lp_client *client)
{
	struct socket_publisher *self = client->owner;
	const int fd = client->watch.fd;

	if (client->announced)
		self->base.host.disconnected(self->base.host.context, client->user);
	lp_watch_stop(&client->watch);
	close(fd);
	lp_send_queue_clear(&client->queue);
	if (client->previous)
		client->previous->next = client->next;
	else
		self->clients = client->next;
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
	struct socket_publisher *self = client->owner;

	if (client->closing_ns)
		return;
	client->closing_ns = lp_clock_ns();
	if (!self->reaping)
		lp_timer_set(&self->reaper, LINGER_NS / 2, LINGER_NS / 2);
	self->reaping = true;
	if (client->announced)
		self->base.host.disconnected(self->base.host.context, client->user);
	client->announced = false;
	shut_when_sent(client);
}

static void on_reap(struct lp_timer *timer)
{
	struct socket_publisher *self = LP_CONTAINER_OF(timer, struct socket_publisher, reaper);
	const int64_t now_ns = lp_clock_ns();
	struct lp_client *next;
	int closing = 0;

	for (struct lp_client *client = self->clients; client; client = next) {
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

/* Never closes: the host may be in the middle of its list. The loop reports the hang-up. */
static void flush(struct lp_client *client)
{
	const int ret = lp_send_queue_flush(&client->queue, client->watch.fd);

	if (ret < 0) {
		lp_send_queue_clear(&client->queue);
		(void)shutdown(client->watch.fd, SHUT_RDWR);
	}
	lp_watch_change(&client->watch, ret > 0 ? LP_READABLE | LP_WRITABLE : LP_READABLE);
	shut_when_sent(client);
}

static void socket_send(struct lp_publisher *publisher, struct lp_client *client,
			struct lp_packet *packet)
{
	const bool waits = client->watch.events & LP_WRITABLE;

	if (client->closing_ns)
		return;
	if (lp_send_queue_put(&client->queue, packet))
		publisher->host.superseded(publisher->host.context, client->user);
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
	const struct lp_publisher_host *host = &client->owner->base.host;
	size_t used = 0, offset, size;
	int ret;

	for (;;) {
		ret = lp_framing_next(client->input + used, client->input_bytes - used,
				      LP_REQUEST_MAX_BYTES, &offset, &size);
		if (ret != 1)
			break;
		ret = host->request(host->context, client->user, client->input + used + offset,
				    size);
		if (ret < 0)
			return false;
		used += offset + size;
	}
	if (ret < 0) {
		host->unreadable(host->context, client->user, unreadable_reason(ret));
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
	if (client->closing_ns)
		return; /* read to make room, and ignored */
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

/* ---------------------------------------------------------------- accepting */

static void set_socket_options(const struct socket_publisher *self, int fd)
{
	static const struct {
		int level, name, value;
	} options[] = {
		{SOL_SOCKET, SO_SNDBUF, SEND_BUFFER_BYTES},
		{IPPROTO_TCP, TCP_NODELAY, 1},
		{SOL_SOCKET, SO_KEEPALIVE, 1},
		{IPPROTO_TCP, TCP_KEEPIDLE, KEEPALIVE_IDLE_S},
		{IPPROTO_TCP, TCP_KEEPINTVL, KEEPALIVE_INTERVAL_S},
		{IPPROTO_TCP, TCP_KEEPCNT, KEEPALIVE_PROBES},
		{IPPROTO_TCP, TCP_USER_TIMEOUT, UNACKNOWLEDGED_MAX_MS},
	};
	const size_t count = self->is_tcp ? LP_COUNT(options) : 1;

	for (size_t i = 0; i < count; i++) /* without one of them it is slower, not wrong */
		(void)setsockopt(fd, options[i].level, options[i].name, &options[i].value,
				 sizeof(options[i].value));
}

/* Why a client that has just come will not be taken; NULL: it may stay. */
static const char *refusal_of(const struct socket_publisher *self, const struct lp_peer *peer,
			      char *text, size_t size_bytes)
{
	int count = 0, same = 0;

	for (const struct lp_client *client = self->clients; client; client = client->next) {
		count++;
		same += lp_peer_is_same(&client->peer, peer);
	}
	if (count >= self->options.clients)
		(void)snprintf(text, size_bytes, "%s has %d clients — raise its ?clients=",
			       self->base.ops->info.scheme, count);
	else if (same >= self->options.per_peer)
		(void)snprintf(text, size_bytes, "%d are from the same %s — raise ?per_peer=", same,
			       self->is_tcp ? "address" : "user");
	else
		return NULL;
	return text;
}

static int add_client(struct socket_publisher *self, int fd)
{
	struct lp_client *client = calloc(1, sizeof(*client));
	const struct lp_publisher_host *host = &self->base.host;
	const char *refusal;
	char text[96];
	int ret;

	if (!client)
		return -ENOMEM;
	client->owner = self;
	ret = lp_watch_start(host->loop, &client->watch, fd, LP_READABLE, on_client_ready);
	if (ret < 0) {
		free(client);
		return ret;
	}
	set_socket_options(self, fd);
	lp_peer_read(fd, &client->peer);
	refusal = refusal_of(self, &client->peer, text, sizeof(text));
	client->next = self->clients;
	if (client->next)
		client->next->previous = client;
	self->clients = client;
	if (host->connected(host->context, &self->base, client, refusal, &client->user) < 0)
		begin_closing(client);
	else
		client->announced = true;
	return 0;
}

/* Out of descriptors: without this the connection would stay in the queue and wake us for ever. */
static void turn_away(struct socket_publisher *self, int listener_fd)
{
	int fd;

	lp_error(self->object, "accept",
		 "out of file descriptors: a client is turned away — raise LimitNOFILE");
	if (self->spare_fd >= 0)
		close(self->spare_fd);
	fd = accept4(listener_fd, NULL, NULL, SOCK_CLOEXEC);
	if (fd >= 0)
		close(fd);
	self->spare_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
}

static void on_listener_ready(struct lp_watch *watch, unsigned int events)
{
	struct socket_publisher *self = LP_CONTAINER_OF(watch, struct listener, watch)->owner;

	(void)events;
	for (int i = 0; i < ACCEPTS_PER_EVENT; i++) {
		const int fd = accept4(watch->fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
		int ret;

		if (fd < 0 && (errno == EMFILE || errno == ENFILE)) {
			turn_away(self, watch->fd);
			return;
		}
		if (fd < 0)
			return; /* none left, or it has gone again */
		ret = add_client(self, fd);
		if (ret < 0) {
			lp_error(self->object, "accept", "%s", lp_strerror(ret));
			close(fd);
		}
	}
}

/* ---------------------------------------------------------------- ops */

static bool socket_pending(const struct lp_publisher *publisher)
{
	for (const struct lp_client *client = self_of(publisher)->clients; client;
	     client = client->next) {
		if (!lp_send_queue_is_empty(&client->queue))
			return true;
	}
	return false;
}

static void socket_destroy(struct lp_publisher *publisher)
{
	struct socket_publisher *self = self_of(publisher);
	struct lp_client *next;

	if (!publisher)
		return;
	lp_socket_file_remove(&self->file); /* first: new clients see that nobody listens */
	for (int i = 0; i < self->listener_count; i++) {
		const int fd = self->listeners[i].watch.fd;

		lp_watch_stop(&self->listeners[i].watch);
		close(fd);
	}
	for (struct lp_client *client = self->clients; client; client = next) {
		next = client->next;
		close_client(client);
	}
	lp_timer_stop(&self->reaper);
	if (self->spare_fd >= 0)
		close(self->spare_fd);
	free(self->path);
	free(self->object);
	free(self);
}

/* Takes over the descriptor. */
static int add_listener(struct socket_publisher *self, int fd)
{
	struct listener *listener = &self->listeners[self->listener_count];
	const int ret = lp_watch_start(self->base.host.loop, &listener->watch, fd, LP_READABLE,
				       on_listener_ready);

	if (ret < 0) {
		close(fd);
		return ret;
	}
	listener->owner = self;
	self->listener_count++;
	return 0;
}

static int socket_start(struct lp_publisher *publisher)
{
	struct socket_publisher *self = self_of(publisher);
	int fds[LP_LISTEN_MAX], count = 1, ret = 0;

	if (self->is_tcp)
		count = lp_listen_tcp(self->object, &self->address, fds);
	else
		fds[0] = lp_listen_unix(self->object, self->path, self->options.mode, &self->file);
	if (count < 0 || fds[0] < 0)
		return count < 0 ? count : fds[0];
	for (int i = 0; i < count; i++) {
		const int added = add_listener(self, fds[i]);

		ret = added < 0 ? added : ret;
	}
	self->spare_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
	if (ret < 0)
		lp_error(self->object, "start", "%s", lp_strerror(ret));
	return ret;
}

/* Permission bits of the socket file, as chmod takes them. */
static int parse_mode(const char *text, void *field)
{
	char *end;
	const unsigned long mode = strtoul(text, &end, 8);

	if (end == text || *end || mode > 0777 || *text < '0' || *text > '7')
		return -EINVAL;
	*(mode_t *)field = (mode_t)mode;
	return 0;
}

static const struct lp_param list[] = {
	{"clients", LP_PARAM_INT, offsetof(struct options, clients), .initial = "0", .max = 4096,
	 .help = "maximum number of clients; 0: 7/8 of --max-clients for the network, all for "
		 "others"},
	{"per_peer", LP_PARAM_INT, offsetof(struct options, per_peer), .initial = "0", .max = 4096,
	 .help = "maximum from one address or user; 0: half of --max-clients, at least 8"},
};
static const struct lp_params tcp_params = LP_PARAMS(list);

static const struct lp_param unix_list[] = {
	{"mode", LP_PARAM_OWN, offsetof(struct options, mode), .initial = "660",
	 .parse = parse_mode, .expects = "permission bits in octal, like 666",
	 .help = "permissions of the socket file"},
};
static const struct lp_params unix_params = {unix_list, LP_COUNT(unix_list), &tcp_params};

/*
 * Shares of --max-clients. The network leaves an eighth to local clients, so that it cannot lock
 * them out, who have no limit but --max-clients; half of all is enough for one address or user, or
 * eight where half would be less.
 */
static void complete_options(struct socket_publisher *self)
{
	const int most = self->base.host.max_clients;
	struct options *options = &self->options;

	if (options->clients == 0)
		options->clients = self->is_tcp ? most - most / 8 : INT_MAX;
	if (options->per_peer == 0)
		options->per_peer = most / 2 > 8 ? most / 2 : 8;
}

const struct lp_publisher_ops lp_publisher_tcp_ops;
const struct lp_publisher_ops lp_publisher_unix_ops;

/* Everything that the user can have written wrongly shows here. */
static int read_uri(struct socket_publisher *self, const struct lp_uri *uri)
{
	int ret = lp_uri_read(uri, self->base.ops->info.params, &self->options);

	if (ret == 0)
		ret = self->is_tcp ? lp_tcp_address_parse(uri->text, uri->rest, &self->address)
				   : lp_socket_path_check(uri->text, uri->rest);
	return ret;
}

static int create(const struct lp_uri *uri, const struct lp_publisher_host *host, bool is_tcp,
		  struct lp_publisher **publisher)
{
	struct socket_publisher *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self)
		return ret;
	self->base = (struct lp_publisher){.ops = is_tcp ? &lp_publisher_tcp_ops
							 : &lp_publisher_unix_ops,
					   .host = *host};
	self->is_tcp = is_tcp;
	self->spare_fd = -1;
	self->object = strdup(uri->text);
	self->path = strdup(uri->rest);
	if (self->object && self->path)
		ret = read_uri(self, uri);
	if (ret < 0) {
		socket_destroy(&self->base);
		return ret;
	}
	complete_options(self);
	lp_timer_init(host->loop, &self->reaper, on_reap);
	*publisher = &self->base;
	return 0;
}

static int tcp_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher)
{
	return create(uri, host, true, publisher);
}

static int unix_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
		       struct lp_publisher **publisher)
{
	return create(uri, host, false, publisher);
}

const struct lp_publisher_ops lp_publisher_tcp_ops = {
	.info = {.scheme = "tcp",
		 .form = "HOST:PORT",
		 .help = "messages to any number of clients; IPv6 in brackets\n"
			 "0.0.0.0 or [::] opens it to the network.",
		 .params = &tcp_params},
	.create = tcp_create,
	.start = socket_start,
	.send = socket_send,
	.pending = socket_pending,
	.destroy = socket_destroy,
};

const struct lp_publisher_ops lp_publisher_unix_ops = {
	.info = {.scheme = "unix",
		 .form = "PATH",
		 .help = "messages to any number of clients of this machine, on a socket file",
		 .params = &unix_params},
	.create = unix_create,
	.start = socket_start,
	.send = socket_send,
	.pending = socket_pending,
	.destroy = socket_destroy,
};
