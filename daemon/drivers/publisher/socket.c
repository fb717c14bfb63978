/* SPDX-License-Identifier: Apache-2.0 */
/* tcp:HOST:PORT and unix:PATH — many clients on stream sockets, each with a bounded queue. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/publisher/acceptor.h"
#include "drivers/publisher/clients.h"
#include "drivers/publisher/listen.h"
#include "drivers/publisher/peer.h"
#include "drivers/publisher/share.h"
#include "include/publisher.h"

/* The query of the URI. */
struct options {
	struct lp_share share;
	mode_t mode;
};

struct socket_publisher {
	struct lp_publisher base;
	char *object; /* the URI; names it in messages */
	bool is_tcp;
	struct lp_tcp_address address; /* of a TCP publisher */
	char *path;		       /* of a Unix one */
	struct options options;
	struct lp_acceptor acceptor;
	struct lp_socket_file file;
	struct lp_clients clients;
};

static struct socket_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct socket_publisher *)publisher;
}

/* ---------------------------------------------------------------- accepting */

static int on_accepted(struct lp_acceptor *acceptor, int fd)
{
	struct socket_publisher *self =
		LP_CONTAINER_OF(acceptor, struct socket_publisher, acceptor);
	struct lp_peer peer;

	lp_connection_set_options(fd, self->is_tcp);
	lp_peer_read(fd, &peer);
	return lp_clients_add(&self->clients, fd, &peer, &self->options.share);
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
	lp_acceptor_finish(&self->acceptor);
	lp_clients_finish(&self->clients);
	free(self->path);
	free(self->object);
	free(self);
}

static int socket_start(struct lp_publisher *publisher)
{
	struct socket_publisher *self = self_of(publisher);
	int fds[LP_LISTEN_MAX], count = 1;

	if (self->is_tcp)
		count = lp_listen_tcp(self->object, &self->address, fds);
	else
		fds[0] = lp_listen_unix(self->object, self->path, self->options.mode, &self->file);
	if (count < 0 || fds[0] < 0)
		return count < 0 ? count : fds[0];
	return lp_acceptor_start(&self->acceptor, self->base.host.loop, fds, count);
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

static const struct lp_param unix_list[] = {
	{"mode", LP_PARAM_OWN, offsetof(struct options, mode), .initial = "660",
	 .parse = parse_mode, .expects = "permission bits in octal, like 666",
	 .help = "permissions of the socket file"},
};
static const struct lp_params unix_params = {unix_list, LP_COUNT(unix_list), &lp_share_params};

const struct lp_publisher_ops lp_publisher_tcp_ops;
const struct lp_publisher_ops lp_publisher_unix_ops;

/* Everything that the user can have written wrongly shows here. */
static int read_uri(struct socket_publisher *self, const struct lp_uri *uri)
{
	int ret = lp_uri_read(uri, self->base.ops->info.params, &self->options);

	if (ret < 0)
		return ret;
	if (!self->is_tcp)
		return lp_socket_path_check(uri->text, uri->rest);
	ret = lp_tcp_address_parse(uri->text, uri->rest, &self->address);
	if (ret == 0)
		ret = lp_tcp_address_check_open(uri->text, &self->address,
						self->base.host.insecure_lan);
	self->base.is_insecure = ret > 0;
	return ret < 0 ? ret : 0;
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
	lp_acceptor_init(&self->acceptor, NULL, on_accepted);
	self->is_tcp = is_tcp;
	self->object = strdup(uri->text);
	self->path = strdup(uri->rest);
	self->acceptor.object = self->object;
	if (self->object && self->path)
		ret = read_uri(self, uri);
	if (ret < 0) {
		socket_destroy(&self->base);
		return ret;
	}
	lp_share_complete(&self->options.share, host->max_clients);
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
			 "0.0.0.0 or [::] opens it to the network, unencrypted: with "
			 "--insecure-lan only.",
		 .params = &lp_share_params},
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
