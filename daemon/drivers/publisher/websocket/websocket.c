/* SPDX-License-Identifier: Apache-2.0 */
/* ws:HOST:PORT and wss:HOST:PORT — messages as binary WebSocket frames, and the files of a page. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "base/uri.h"
#include "drivers/publisher/acceptor.h"
#include "drivers/publisher/places.h"
#include "drivers/publisher/share.h"
#include "drivers/publisher/websocket/certificate.h"
#include "drivers/publisher/websocket/handshake.h"
#include "drivers/publisher/websocket/options.h"
#include "drivers/publisher/websocket/server.h"
#include "drivers/publisher/websocket/web_client.h"
#include "include/packet.h"
#include "include/publisher.h"

/* How often the pair is looked at. */
#define RENEWAL_NS (2 * LP_NS_PER_S)
/* Connections that are closed, and libwebsockets still knows. */
#define GOING 64

struct websocket_publisher {
	struct lp_publisher base;
	char *object; /* the URI; names it in messages */
	bool is_tls;
	struct lp_tcp_address address;
	struct lp_websocket_options options;
	struct lp_certificate certificate;
	char machine[256]; /* its name */
	struct lp_acceptor acceptor;
	struct lp_server *server;
	struct lp_timer renewal;
	struct lp_web_clients clients;
};

static struct websocket_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct websocket_publisher *)publisher;
}

/* ---------------------------------------------------------------- accepting */

static int on_accepted(struct lp_acceptor *acceptor, int fd)
{
	struct websocket_publisher *self =
		LP_CONTAINER_OF(acceptor, struct websocket_publisher, acceptor);
	struct lp_web_client *client;
	int ret;

	ret = lp_web_client_add(&self->clients, fd, self->is_tls, &client);
	if (ret < 0)
		return ret;
	lp_connection_set_options(fd, true);
	ret = lp_server_adopt(self->server, fd, client, &client->session);
	if (ret == -ENOMEM)
		lp_web_client_remove(client);
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
	struct lp_web_client *client = lp_session_user(session);

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
	client->has_token =
		!self->is_tls || lp_token_is_offered(protocols, self->certificate.pair.token);
	return NULL;
}

static void on_opened(void *context, struct lp_session *session)
{
	struct websocket_publisher *self = context;
	struct lp_web_client *client = lp_session_user(session);
	const struct lp_publisher_host *host = &self->base.host;
	char text[96];
	int code = -EACCES;
	const char *refusal = "the token is missing or wrong — open the address that lightprobe "
			      "pair prints";

	client->session = session;
	if (client->closing) /* it is being killed */
		return;
	if (self->is_tls && lp_place_is_barred(&client->place))
		refusal = "the token is missing or wrong, or others of this address were: wait "
			  "ten seconds — open the address that lightprobe pair prints";
	if (!self->is_tls || lp_place_token(&client->place, client->has_token)) {
		code = -EUSERS;
		refusal = lp_place_admit(&client->place, &self->options.share,
					 self->base.ops->info.scheme, text, sizeof(text));
	}
	if (host->connected(host->context, &self->base, (struct lp_client *)client, code, refusal,
			    &client->user) < 0)
		lp_web_client_close(client, "refused");
	else
		client->announced = true;
}

static void on_message(void *context, struct lp_session *session, const uint8_t *data,
		       size_t size_bytes)
{
	const struct websocket_publisher *self = context;
	struct lp_web_client *client = lp_session_user(session);
	const struct lp_publisher_host *host = &self->base.host;

	if (client->closing || !lp_web_client_charge(client, LP_COST_REQUEST_NS))
		return;
	if (host->request(host->context, client->user, data, size_bytes) < 0)
		lp_web_client_close(client, "request refused");
	else
		host->requests_done(host->context, client->user);
}

static void on_unreadable(void *context, struct lp_session *session, const char *reason)
{
	const struct websocket_publisher *self = context;
	struct lp_web_client *client = lp_session_user(session);

	if (client->closing)
		return;
	self->base.host.unreadable(self->base.host.context, client->user, -EMSGSIZE, reason);
	lp_web_client_close(client, "unreadable");
}

static struct lp_packet *on_writable(void *context, struct lp_session *session)
{
	struct lp_web_client *client = lp_session_user(session);

	(void)context;
	return lp_send_queue_take(&client->queue);
}

static bool on_page(void *context, struct lp_session *session, size_t size_bytes)
{
	struct lp_web_client *client = lp_session_user(session);

	(void)context;
	return !client->closing &&
	       lp_web_client_charge(client, size_bytes == 0
						    ? LP_COST_PAGE_NS
						    : (int64_t)size_bytes * LP_COST_PAGE_BYTE_NS);
}

static void on_closed(void *context, struct lp_session *session)
{
	const struct websocket_publisher *self = context;
	struct lp_web_client *client = lp_session_user(session);

	if (client->announced)
		self->base.host.disconnected(self->base.host.context, client->user);
	lp_web_client_remove(client);
}

/* ---------------------------------------------------------------- ops */

static void websocket_send(struct lp_publisher *publisher, struct lp_client *handle,
			   struct lp_packet *packet)
{
	struct lp_web_client *client = (struct lp_web_client *)handle;

	if (client->closing)
		return;
	if (lp_send_queue_put(&client->queue, packet))
		publisher->host.superseded(publisher->host.context, client->user);
	lp_session_want_write(client->session);
}

static bool websocket_pending(const struct lp_publisher *publisher)
{
	return lp_web_clients_pending(&self_of(publisher)->clients);
}

static void websocket_destroy(struct lp_publisher *publisher)
{
	struct websocket_publisher *self = self_of(publisher);

	if (!publisher)
		return;
	lp_timer_stop(&self->renewal);
	lp_acceptor_finish(&self->acceptor);
	lp_server_destroy(self->server);
	lp_web_clients_finish(&self->clients);
	lp_certificate_finish(&self->certificate);
	free(self->object);
	free(self);
}

static void note_certificate(struct websocket_publisher *self)
{
	self->base.t_expires_unix_ns = self->certificate.pair.t_expires_unix_ns;
	self->base.waits_for = NULL;
	lp_info(self->object, "certificate", "SHA-256 %s", self->certificate.pair.fingerprint);
}

static int serve(struct websocket_publisher *self)
{
	const struct lp_server_host host = {
		.context = self,
		.check = on_check,
		.opened = on_opened,
		.message = on_message,
		.unreadable = on_unreadable,
		.writable = on_writable,
		.page = on_page,
		.closed = on_closed,
	};
	const struct lp_server_options options = {
		.object = self->object,
		.root = self->options.root,
		.connect = self->options.connect,
		.max_connections =
			self->base.host.max_clients + LP_PLACES_NEW + LP_PLACES_LEAVING + GOING,
		.most_handshakes = LP_PLACES_NEW + GOING,
		.pair = self->is_tls ? &self->certificate.pair : NULL,
	};
	int fds[LP_LISTEN_MAX], count, ret;

	ret = lp_server_create(&options, &host, self->base.host.loop, &self->server);
	if (ret < 0)
		return ret;
	count = lp_listen_tcp(self->object, &self->address, fds);
	if (count < 0)
		return count;
	if (self->is_tls)
		note_certificate(self);
	lp_web_clients_start(&self->clients);
	return lp_acceptor_start(&self->acceptor, self->base.host.loop, fds, count);
}

/* The clock of this machine may be set, or another pair made, at any time. */
static void on_renewal(struct lp_timer *timer)
{
	struct websocket_publisher *self =
		LP_CONTAINER_OF(timer, struct websocket_publisher, renewal);

	if (!lp_certificate_look(&self->certificate))
		return;
	if (!self->server) {
		if (serve(self) < 0)
			self->base.host.failed(self->base.host.context, &self->base, -EIO);
	} else if (lp_server_certify(self->server, &self->certificate.pair) == 0) {
		note_certificate(self);
	}
}

static int websocket_start(struct lp_publisher *publisher)
{
	struct websocket_publisher *self = self_of(publisher);

	if (self->is_tls)
		lp_timer_set(&self->renewal, RENEWAL_NS, RENEWAL_NS);
	return self->base.waits_for ? 0 : serve(self);
}

/* ---------------------------------------------------------------- creating */

/* Who may connect, and how that is secured. */
static int check_access(struct websocket_publisher *self)
{
	int ret = 0;

	if (!self->is_tls) {
		ret = lp_tcp_address_check_open(self->object, &self->address,
						self->base.host.insecure_lan);
		self->base.is_insecure = ret > 0;
	} else if (*self->options.pair) {
		ret = lp_certificate_begin(&self->certificate, self->object, self->options.pair);
		if (!self->certificate.is_valid)
			self->base.waits_for =
				"the certificate of wss: is not valid yet, or no more: nobody can "
				"connect there — is the clock right? else lightprobe pair --new";
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
		ret = lp_websocket_check_root(self->object, self->options.root);
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
	lp_web_clients_init(&self->clients, &self->base);
	lp_timer_init(host->loop, &self->renewal, on_renewal);
	(void)gethostname(self->machine, sizeof(self->machine) - 1);
	if (self->object)
		ret = read_uri(self, uri);
	if (ret < 0) {
		websocket_destroy(&self->base);
		return ret;
	}
	lp_share_complete(&self->options.share, host->max_clients);
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
		 .params = &lp_ws_params},
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
		 .params = &lp_wss_params},
	.create = wss_create,
	.start = websocket_start,
	.send = websocket_send,
	.pending = websocket_pending,
	.destroy = websocket_destroy,
};
