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

#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/publisher/clients.h"
#include "drivers/publisher/listen.h"
#include "drivers/publisher/peer.h"
#include "include/publisher.h"

#define ACCEPTS_PER_EVENT 8
#define SEND_BUFFER_BYTES (16 << 10) /* a slow client shall get the newest, not seconds of old */
#define KEEPALIVE_IDLE_S 10
#define KEEPALIVE_INTERVAL_S 5
#define KEEPALIVE_PROBES 3
#define UNACKNOWLEDGED_MAX_MS (120 * 1000) /* then a TCP peer counts as gone */

struct socket_publisher;

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
	struct lp_clients clients;
};

static struct socket_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct socket_publisher *)publisher;
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
	int same;
	const int count = lp_clients_count(&self->clients, peer, &same);

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
	struct lp_peer peer;
	char text[96];

	set_socket_options(self, fd);
	lp_peer_read(fd, &peer);
	return lp_clients_add(&self->clients, fd, &peer,
			      refusal_of(self, &peer, text, sizeof(text)));
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

static void socket_send(struct lp_publisher *publisher, struct lp_client *client,
			struct lp_packet *packet)
{
	(void)publisher;
	lp_client_send(client, packet);
}

static bool socket_pending(const struct lp_publisher *publisher)
{
	return lp_clients_pending(&self_of(publisher)->clients);
}

static void socket_destroy(struct lp_publisher *publisher)
{
	struct socket_publisher *self = self_of(publisher);

	if (!publisher)
		return;
	lp_socket_file_remove(&self->file); /* first: new clients see that nobody listens */
	for (int i = 0; i < self->listener_count; i++) {
		const int fd = self->listeners[i].watch.fd;

		lp_watch_stop(&self->listeners[i].watch);
		close(fd);
	}
	lp_clients_finish(&self->clients);
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
	lp_clients_init(&self->clients, &self->base);
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
