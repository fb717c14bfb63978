/* SPDX-License-Identifier: Apache-2.0 */
/* ws:HOST:PORT and wss:HOST:PORT — messages as binary WebSocket frames, and the files of a page. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/publisher/acceptor.h"
#include "drivers/publisher/peer.h"
#include "drivers/publisher/queue.h"
#include "drivers/publisher/share.h"
#include "drivers/publisher/websocket/handshake.h"
#include "drivers/publisher/websocket/pair.h"
#include "drivers/publisher/websocket/server.h"
#include "include/packet.h"
#include "include/publisher.h"

/* Connections that are no WebSocket clients: pages that load, handshakes under way, and whoever
 * opens connections and says nothing. */
#define MOST_OTHERS 256
#define MOST_OTHERS_PER_PEER 64

/* The query of the URI. */
struct options {
	struct lp_share share;
	char root[1024];
	char origins[1024];
	char connect[1024];
	char pair[1024];
};

/* One connection; the host's struct lp_client once it is a WebSocket. */
struct client {
	struct websocket_publisher *owner;
	struct client *next, *previous;
	struct lp_session *session;
	struct lp_peer peer;
	struct lp_send_queue queue;
	void *user;
	bool is_open;	/* a WebSocket */
	bool has_token; /* or needs none */
	bool announced; /* the host will hear disconnected() */
	bool closing;	/* nothing more is queued for it */
};

struct websocket_publisher {
	struct lp_publisher base;
	char *object; /* the URI; names it in messages */
	bool is_tls;
	struct lp_tcp_address address;
	struct options options;
	struct lp_pair pair;
	char machine[256]; /* its name */
	struct lp_acceptor acceptor;
	struct lp_server *server;
	struct client *first;
};

static struct websocket_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct websocket_publisher *)publisher;
}

static struct lp_client *handle_of(struct client *client)
{
	return (struct lp_client *)client;
}

/* ---------------------------------------------------------------- the list of connections */

static void add_client(struct client *client)
{
	struct websocket_publisher *self = client->owner;

	client->next = self->first;
	if (client->next)
		client->next->previous = client;
	self->first = client;
}

static void remove_client(struct client *client)
{
	if (client->previous)
		client->previous->next = client->next;
	else
		client->owner->first = client->next;
	if (client->next)
		client->next->previous = client->previous;
	lp_send_queue_clear(&client->queue);
	free(client);
}

/* Connections that are WebSockets, or those that are not; *same: how many are of this peer. */
static int count_clients(const struct websocket_publisher *self, bool is_open,
			 const struct lp_peer *peer, int *same)
{
	int count = 0;

	*same = 0;
	for (const struct client *client = self->first; client; client = client->next) {
		if (client->is_open != is_open)
			continue;
		count++;
		*same += lp_peer_is_same(&client->peer, peer);
	}
	return count;
}

static int on_accepted(struct lp_acceptor *acceptor, int fd)
{
	struct websocket_publisher *self =
		LP_CONTAINER_OF(acceptor, struct websocket_publisher, acceptor);
	struct client *client;
	struct lp_peer peer;
	int same, ret;

	lp_peer_read(fd, &peer);
	if (count_clients(self, false, &peer, &same) >= MOST_OTHERS || same >= MOST_OTHERS_PER_PEER)
		return -EUSERS;
	client = calloc(1, sizeof(*client));
	if (!client)
		return -ENOMEM;
	lp_connection_set_options(fd, true);
	*client = (struct client){.owner = self, .peer = peer};
	add_client(client);
	ret = lp_server_adopt(self->server, fd, client);
	if (ret == -ENOMEM)
		remove_client(client);
	if (ret < 0)
		lp_debug(self->object, "accept", "a connection cannot be served: %s",
			 lp_strerror(ret));
	return 0;
}

/* ---------------------------------------------------------------- calls of the server */

static const char *on_check(void *context, struct lp_session *session, const char *host,
			    const char *origin, const char *protocols)
{
	const struct websocket_publisher *self = context;
	struct client *client = lp_session_user(session);

	/* With TLS the certificate names the host. */
	if (!self->is_tls && !lp_host_is_ok(host, self->machine, self->options.origins)) {
		lp_warning(self->object, "host", "refused: the client calls this machine %s", host);
		return "this probe answers to its address or its own name only";
	}
	if (!lp_origin_is_ok(origin, host, self->options.origins)) {
		lp_warning(self->object, "origin",
			   "refused: a page of %s — add it to ?origins= if it may read the light",
			   origin);
		return "pages of other origins may not read this probe (?origins=)";
	}
	client->has_token = !self->is_tls || lp_token_is_offered(protocols, self->pair.token);
	return NULL;
}

static void begin_closing(struct client *client, const char *reason)
{
	const struct lp_publisher_host *host = &client->owner->base.host;

	if (client->closing)
		return;
	client->closing = true;
	if (client->announced)
		host->disconnected(host->context, client->user);
	client->announced = false;
	lp_session_close(client->session, reason);
}

static void on_opened(void *context, struct lp_session *session)
{
	struct websocket_publisher *self = context;
	struct client *client = lp_session_user(session);
	const struct lp_publisher_host *host = &self->base.host;
	int same, count;
	char text[96];
	const char *refusal = "the token is missing or wrong — open the address that lightprobe "
			      "pair prints";

	client->session = session;
	count = count_clients(self, true, &client->peer, &same);
	client->is_open = true;
	if (client->has_token)
		refusal = lp_share_refusal(&self->options.share, self->base.ops->info.scheme, count,
					   same, "address", text, sizeof(text));
	if (host->connected(host->context, &self->base, handle_of(client), refusal, &client->user) <
	    0)
		begin_closing(client, "refused");
	else
		client->announced = true;
}

static void on_message(void *context, struct lp_session *session, const uint8_t *data,
		       size_t size_bytes)
{
	const struct websocket_publisher *self = context;
	struct client *client = lp_session_user(session);
	const struct lp_publisher_host *host = &self->base.host;

	if (client->closing)
		return;
	if (host->request(host->context, client->user, data, size_bytes) < 0)
		begin_closing(client, "request refused");
	else
		host->requests_done(host->context, client->user);
}

static void on_unreadable(void *context, struct lp_session *session, const char *reason)
{
	const struct websocket_publisher *self = context;
	struct client *client = lp_session_user(session);

	if (client->closing)
		return;
	self->base.host.unreadable(self->base.host.context, client->user, reason);
	begin_closing(client, "unreadable");
}

static struct lp_packet *on_writable(void *context, struct lp_session *session)
{
	struct client *client = lp_session_user(session);

	(void)context;
	return lp_send_queue_take(&client->queue);
}

static void on_closed(void *context, struct lp_session *session)
{
	const struct websocket_publisher *self = context;
	struct client *client = lp_session_user(session);

	if (client->announced)
		self->base.host.disconnected(self->base.host.context, client->user);
	remove_client(client);
}

/* ---------------------------------------------------------------- ops */

static void websocket_send(struct lp_publisher *publisher, struct lp_client *handle,
			   struct lp_packet *packet)
{
	struct client *client = (struct client *)handle;

	if (client->closing)
		return;
	if (lp_send_queue_put(&client->queue, packet))
		publisher->host.superseded(publisher->host.context, client->user);
	lp_session_want_write(client->session);
}

static bool websocket_pending(const struct lp_publisher *publisher)
{
	for (const struct client *client = self_of(publisher)->first; client;
	     client = client->next) {
		if (!lp_send_queue_is_empty(&client->queue))
			return true;
	}
	return false;
}

static void websocket_destroy(struct lp_publisher *publisher)
{
	struct websocket_publisher *self = self_of(publisher);

	if (!publisher)
		return;
	lp_acceptor_finish(&self->acceptor);
	lp_server_destroy(self->server);
	free(self->object);
	free(self);
}

static int websocket_start(struct lp_publisher *publisher)
{
	struct websocket_publisher *self = self_of(publisher);
	const struct lp_server_host host = {
		.context = self,
		.check = on_check,
		.opened = on_opened,
		.message = on_message,
		.unreadable = on_unreadable,
		.writable = on_writable,
		.closed = on_closed,
	};
	const struct lp_server_options options = {
		.object = self->object,
		.root = self->options.root,
		.connect = self->options.connect,
		.max_connections = self->base.host.max_clients + MOST_OTHERS,
		.pair = self->is_tls ? &self->pair : NULL,
	};
	int fds[LP_LISTEN_MAX], count, ret;

	ret = lp_server_create(&options, &host, self->base.host.loop, &self->server);
	if (ret < 0)
		return ret;
	count = lp_listen_tcp(self->object, &self->address, fds);
	if (count < 0)
		return count;
	if (self->is_tls)
		lp_info(self->object, "certificate", "SHA-256 %s", self->pair.fingerprint);
	return lp_acceptor_start(&self->acceptor, self->base.host.loop, fds, count);
}

/* ---------------------------------------------------------------- creating */

/* They become part of a header. */
static int parse_connect(const char *text, void *field)
{
	const size_t length = strlen(text);

	if (length >= sizeof(((struct options *)NULL)->connect) ||
	    strspn(text,
		   "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789:/.[]- *") !=
		    length)
		return -EINVAL;
	memcpy(field, text, length + 1);
	return 0;
}

static const struct lp_param list[] = {
	{"root", LP_PARAM_TEXT, offsetof(struct options, root), .initial = "", .max = 1024,
	 .help = "folder whose files are served by HTTP, index.html first; default: none"},
	{"origins", LP_PARAM_TEXT, offsetof(struct options, origins), .initial = "", .max = 1024,
	 .help = "origins whose pages may connect besides the probe's own, with commas between"},
	{"connect", LP_PARAM_OWN, offsetof(struct options, connect), .initial = "",
	 .parse = parse_connect,
	 .expects = "origins of letters, digits and :/.[]-, with blanks between",
	 .help = "where the served page may connect besides this probe, like ws://127.0.0.1:7703"},
};
static const struct lp_params ws_params = {list, LP_COUNT(list), &lp_share_params};

static const struct lp_param wss_list[] = {
	{"pair", LP_PARAM_TEXT, offsetof(struct options, pair), .initial = "", .max = 1024,
	 .help = "folder with key, certificate and token, as lightprobe pair makes it"},
};
static const struct lp_params wss_params = {wss_list, LP_COUNT(wss_list), &ws_params};

static int check_root(const struct websocket_publisher *self)
{
	const char *root = self->options.root;
	struct stat status;

	if (!*root || (stat(root, &status) == 0 && S_ISDIR(status.st_mode)))
		return 0;
	lp_error(self->object, "root", "%s: is no folder — make web builds the page in build/web",
		 root);
	return -ENOTDIR;
}

/* Who may connect, and how that is secured. */
static int check_access(struct websocket_publisher *self)
{
	int ret = 0;

	if (!self->is_tls) {
		ret = lp_tcp_address_check_open(self->object, &self->address,
						self->base.host.insecure_lan);
		self->base.is_insecure = ret > 0;
	} else if (*self->options.pair) {
		ret = lp_pair_read(&self->pair, self->object, self->options.pair);
		self->base.t_expires_unix_ns = self->pair.t_expires_unix_ns;
	} else {
		lp_error(self->object, "pair",
			 "needs ?pair=FOLDER with key, certificate and token — lightprobe pair "
			 "makes it");
		ret = -EINVAL;
	}
	return ret < 0 ? ret : 0;
}

/* Everything that the user can have written wrongly shows here. */
static int read_uri(struct websocket_publisher *self, const struct lp_uri *uri)
{
	int ret = lp_uri_read(uri, self->base.ops->info.params, &self->options);

	if (ret == 0)
		ret = lp_tcp_address_parse(uri->text, uri->rest, &self->address);
	if (ret == 0)
		ret = check_root(self);
	return ret < 0 ? ret : check_access(self);
}

static int create(const struct lp_publisher_ops *ops, bool is_tls, const struct lp_uri *uri,
		  const struct lp_publisher_host *host, struct lp_publisher **publisher)
{
	struct websocket_publisher *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self)
		return ret;
	self->base = (struct lp_publisher){.ops = ops, .host = *host};
	self->is_tls = is_tls;
	self->object = strdup(uri->text);
	lp_acceptor_init(&self->acceptor, self->object, on_accepted);
	(void)gethostname(self->machine, sizeof(self->machine) - 1);
	if (self->object)
		ret = read_uri(self, uri);
	if (ret < 0) {
		websocket_destroy(&self->base);
		return ret;
	}
	lp_share_complete(&self->options.share, host->max_clients, true);
	*publisher = &self->base;
	return 0;
}

const struct lp_publisher_ops lp_publisher_ws_ops;
const struct lp_publisher_ops lp_publisher_wss_ops;

static int ws_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
		     struct lp_publisher **publisher)
{
	return create(&lp_publisher_ws_ops, false, uri, host, publisher);
}

static int wss_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher)
{
	return create(&lp_publisher_wss_ops, true, uri, host, publisher);
}

const struct lp_publisher_ops lp_publisher_ws_ops = {
	.info = {.scheme = "ws",
		 .form = "HOST:PORT",
		 .help = "messages to web pages of this machine, and the page itself\n"
			 "Beyond loopback it is unencrypted: with --insecure-lan only.",
		 .params = &ws_params},
	.create = ws_create,
	.start = websocket_start,
	.send = websocket_send,
	.pending = websocket_pending,
	.destroy = websocket_destroy,
};

const struct lp_publisher_ops lp_publisher_wss_ops = {
	.info = {.scheme = "wss",
		 .form = "HOST:PORT",
		 .help = "messages and page over the network: encrypted, for clients with the "
			 "token",
		 .params = &wss_params},
	.create = wss_create,
	.start = websocket_start,
	.send = websocket_send,
	.pending = websocket_pending,
	.destroy = websocket_destroy,
};
