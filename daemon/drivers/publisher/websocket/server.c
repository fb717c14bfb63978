/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/server.h"

#include <errno.h>
#include <libwebsockets.h>
#include <openssl/ssl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "drivers/publisher/peer.h"
#include "drivers/publisher/websocket/files.h"
#include "drivers/publisher/websocket/handshake.h"
#include "drivers/publisher/websocket/pair.h"
#include "include/packet.h"
#include "include/publisher.h"

#define HEADER_BYTES 4096    /* of one request; more is refused */
#define REQUEST_TIMEOUT_S 5  /* for TLS, headers, a piece of a file */
#define CLOSE_TIMEOUT_S 2    /* for the last message of a session that ends */
#define PING_AFTER_S 30	     /* of silence; browsers answer for pages that sleep */
#define HANGUP_AFTER_S 90    /* of silence */
#define OTHER_DESCRIPTORS 16 /* of libwebsockets itself */
#define LONGEST_REASON 123   /* of a close frame */
#define RESPONSE_HEADERS 5
#define NO_OLD_TLS (SSL_OP_NO_TLSv1 | SSL_OP_NO_TLSv1_1)
/* Without CBC and without RSA key exchange; those of TLS 1.3 are all good. */
#define TLS_1_2_CIPHERS "ECDHE+AESGCM:ECDHE+CHACHA20"
#define FILE_BYTES 16384       /* of a file that are sent at a time */
#define HEADER_TEXT_BYTES 1024 /* longest Host, Origin, list of protocols */

/*
 * What a page from here may do: load its own files and talk to its own host, nothing else. WebGL
 * textures are blobs or data; a glTF object that the user loads is a blob.
 */
#define CONTENT_SECURITY_POLICY                                                                 \
	"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; " \
	"connect-src 'self' blob: data: %s; media-src 'self' blob:; base-uri 'none'; "          \
	"form-action 'none'; frame-ancestors 'none'"

struct lp_session {
	struct lp_server *server;
	struct lp_session *next, *previous;
	struct lws *wsi;
	int fd;
	void *user;
	const char *close_reason; /* NULL: open */
	bool unreadable, close_sent;
	size_t input_bytes;
	uint8_t input[LP_REQUEST_MAX_BYTES];
};

struct lp_server {
	struct lp_server_host host;
	struct lws_context *context; /* NULL as soon as it is gone */
	struct lp_loop_end end;
	struct lp_session *first;
	struct lws_vhost *vhost;
	struct lp_loop *loop;
	void *loops[1];
	bool is_tls;
	const char *object; /* names it in messages; borrowed */
	SSL_CTX *tls;	    /* libwebsockets' own; NULL: none */
	struct lws_protocols protocols[2];
	struct lws_http_mount mount;
	struct lp_files files; /* of the mount */
	char policy[2048];
	struct lws_protocol_vhost_options headers[RESPONSE_HEADERS];
	const struct lp_session *last_closed; /* only to compare with: it is freed */
	unsigned char output[LWS_PRE + LP_PACKET_LARGE_BYTES];
};

/* ---------------------------------------------------------------- HTTP */

static const char *header(struct lws *wsi, enum lws_token_indexes token, char *text)
{
	if (lws_hdr_copy(wsi, text, HEADER_TEXT_BYTES, token) < 0)
		text[0] = '\0';
	return text;
}

/* The library would answer with an HTML page in HTTP/1.0. */
static int answer(struct lws *wsi, const char *status, const char *text)
{
	unsigned char buffer[LWS_PRE + 512];
	char *start = (char *)buffer + LWS_PRE;
	const int size = snprintf(start, sizeof(buffer) - LWS_PRE,
				  "HTTP/1.1 %s\r\nconnection: close\r\ncontent-type: text/plain; "
				  "charset=utf-8\r\ncontent-length: %zu\r\n\r\n%s\n",
				  status, strlen(text) + 1, text);

	return lws_write(wsi, buffer + LWS_PRE, (size_t)size, LWS_WRITE_HTTP_FINAL);
}

/* 0: go on. 1: answered. */
static int on_upgrade(struct lp_session *session)
{
	const struct lp_server_host *host = &session->server->host;
	char name[HEADER_TEXT_BYTES], origin[HEADER_TEXT_BYTES], protocols[HEADER_TEXT_BYTES];
	const char *refusal;

	/* A header that does not fit is none, and an Origin must not vanish in this way. */
	if (lws_hdr_total_length(session->wsi, WSI_TOKEN_ORIGIN) >= HEADER_TEXT_BYTES)
		refusal = "the Origin is too long";
	else
		refusal = host->check(host->context, session,
				      header(session->wsi, WSI_TOKEN_HOST, name),
				      header(session->wsi, WSI_TOKEN_ORIGIN, origin),
				      header(session->wsi, WSI_TOKEN_PROTOCOL, protocols));
	if (!refusal)
		return 0;
	(void)answer(session->wsi, "403 Forbidden", refusal);
	return 1;
}

/* Also called for each piece of a file (files.h), which is closed before its session. */
static bool on_page_bytes(void *reader, size_t size_bytes)
{
	struct lp_session *session = reader;
	const struct lp_server_host *host = &session->server->host;

	return host->page(host->context, session, size_bytes);
}

/* A path that no file answers for. */
static int on_http(struct lp_session *session)
{
	const struct lp_server *server = session->server;

	(void)answer(session->wsi, "404 Not Found",
		     server->mount.origin ? "there is no such file"
					  : "this probe serves no page: lightprobed "
					    "--publish=ws:HOST:PORT?root=FOLDER");
	return -1;
}

/* ---------------------------------------------------------------- WebSocket */

static void give_up(struct lp_session *session, const char *reason)
{
	const struct lp_server_host *host = &session->server->host;

	session->unreadable = true;
	host->unreadable(host->context, session, reason);
}

static void on_receive(struct lp_session *session, const uint8_t *data, size_t size_bytes)
{
	const struct lp_server_host *host = &session->server->host;

	if (session->unreadable || session->close_reason)
		return;
	if (!lws_frame_is_binary(session->wsi)) {
		give_up(session, "a text message: requests are binary protobuf");
		return;
	}
	if (size_bytes > sizeof(session->input) - session->input_bytes) {
		give_up(session, "longer than a request may be (256 bytes)");
		return;
	}
	if (size_bytes > 0)
		memcpy(session->input + session->input_bytes, data, size_bytes);
	session->input_bytes += size_bytes;
	if (lws_is_final_fragment(session->wsi)) {
		size_bytes = session->input_bytes;
		session->input_bytes = 0;
		host->message(host->context, session, session->input, size_bytes);
	}
}

/* Bytes of the length prefix, which stands before messages on streams only. */
static uint32_t prefix_bytes(const struct lp_packet *packet)
{
	uint32_t count = 1;

	while (packet->data[count - 1] & 0x80)
		count++;
	return count;
}

/*
 * Then the client closes, or the timeout does. lws_close_reason() would not send it: with libuv,
 * libwebsockets 4.1 closes the connection before. LWS_WRITE_HTTP sends bytes as they are.
 */
static int send_close(struct lp_session *session)
{
	unsigned char buffer[LWS_PRE + 4 + LONGEST_REASON];
	unsigned char *frame = buffer + LWS_PRE;
	const size_t length = strnlen(session->close_reason, LONGEST_REASON);

	if (session->close_sent)
		return 0;
	session->close_sent = true;
	frame[0] = 0x88; /* RFC 6455: final, close; not masked */
	frame[1] = (unsigned char)(length + 2);
	frame[2] = LWS_CLOSE_STATUS_POLICY_VIOLATION >> 8;
	frame[3] = LWS_CLOSE_STATUS_POLICY_VIOLATION & 0xff;
	memcpy(frame + 4, session->close_reason, length);
	return lws_write(session->wsi, frame, length + 4, LWS_WRITE_HTTP) < 0 ? -1 : 0;
}

/* -1: close. */
static int on_writable(struct lp_session *session)
{
	struct lp_server *server = session->server;
	struct lp_packet *packet = server->host.writable(server->host.context, session);
	uint32_t skipped, size;
	int sent;

	if (!packet) {
		if (!session->close_reason)
			return 0;
		return send_close(session);
	}
	skipped = prefix_bytes(packet);
	size = packet->size_bytes - skipped;
	memcpy(server->output + LWS_PRE, packet->data + skipped, size);
	lp_packet_drop(packet);
	sent = lws_write(session->wsi, server->output + LWS_PRE, size, LWS_WRITE_BINARY);
	lws_callback_on_writable(session->wsi);
	return sent < (int)size ? -1 : 0;
}

static void take_out(struct lp_session *session)
{
	if (session->previous)
		session->previous->next = session->next;
	else
		session->server->first = session->next;
	if (session->next)
		session->next->previous = session->previous;
}

static void end_session(struct lp_session *session)
{
	struct lp_server *server = session->server;

	if (session->wsi)
		lws_set_opaque_user_data(session->wsi, NULL);
	take_out(session);
	server->last_closed = session;
	server->host.closed(server->host.context, session);
	free(session);
}

static int on_event(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in,
		    size_t size_bytes)
{
	struct lp_session *session = wsi ? lws_get_opaque_user_data(wsi) : NULL;

	if (reason == LWS_CALLBACK_OPENSSL_LOAD_EXTRA_SERVER_VERIFY_CERTS) {
		struct lp_server *server = lws_context_user(lws_get_context(wsi));

		server->tls = user;
		return 0;
	}
	if (!session)
		return lws_callback_http_dummy(wsi, reason, user, in, size_bytes);
	session->wsi = wsi;
	switch (reason) {
	case LWS_CALLBACK_FILTER_HTTP_CONNECTION:
		session->server->files.reader = session;
		return !on_page_bytes(session, 0);
	case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE:
		return on_upgrade(session);
	case LWS_CALLBACK_HTTP:
		return on_http(session);
	case LWS_CALLBACK_ESTABLISHED:
		session->server->host.opened(session->server->host.context, session);
		return 0;
	case LWS_CALLBACK_RECEIVE:
		on_receive(session, in, size_bytes);
		return 0;
	case LWS_CALLBACK_WS_PEER_INITIATED_CLOSE:
		return session->close_sent; /* it answers ours: all is said */
	case LWS_CALLBACK_SERVER_WRITEABLE:
		return on_writable(session);
	case LWS_CALLBACK_WSI_DESTROY:
		end_session(session);
		return 0;
	default:
		return lws_callback_http_dummy(wsi, reason, user, in, size_bytes);
	}
}

void *lp_session_user(const struct lp_session *session)
{
	return session->user;
}

uint64_t lp_session_received_bytes(const struct lp_session *session)
{
	return lp_peer_sent_bytes(session->fd);
}

void lp_session_kill(struct lp_session *session)
{
	lws_set_timeout(session->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
}

void lp_session_want_write(struct lp_session *session)
{
	lws_callback_on_writable(session->wsi);
}

void lp_session_close(struct lp_session *session, const char *reason)
{
	if (session->close_reason)
		return;
	session->close_reason = reason;
	lws_set_timeout(session->wsi, PENDING_TIMEOUT_USER_REASON_BASE, CLOSE_TIMEOUT_S);
	lws_callback_on_writable(session->wsi);
}

/* ---------------------------------------------------------------- life */

int lp_server_adopt(struct lp_server *server, int fd, void *user, struct lp_session **place)
{
	struct lp_session *session = calloc(1, sizeof(*session));
	const lws_adopt_desc_t adopted = {
		.vh = server->vhost,
		.type = LWS_ADOPT_SOCKET | LWS_ADOPT_HTTP |
			(server->is_tls ? LWS_ADOPT_ALLOW_SSL : 0),
		.fd = {.sockfd = fd},
		.opaque = session,
	};

	struct lws *wsi;

	if (!session) {
		close(fd);
		return -ENOMEM;
	}
	session->server = server;
	session->user = user;
	session->fd = fd;
	*place = session;
	session->next = server->first;
	if (session->next)
		session->next->previous = session;
	server->first = session;
	server->last_closed = NULL;
	wsi = lws_adopt_descriptor_vhost_via_info(&adopted);
	if (wsi && server->last_closed != session)
		session->wsi = wsi;
	if (wsi)
		return 0;
	if (server->last_closed != session) /* it came to no connection that could end */
		end_session(session);
	return -EPROTO;
}

/* What the library says is about single connections, hence up to whoever connects. */
static void on_library_log(int level, const char *line)
{
	(void)level;
	lp_debug("websocket", "library", "%.*s", (int)strcspn(line, "\n"), line);
}

static void set_response_headers(struct lp_server *self, const char *connect)
{
	const char *const headers[RESPONSE_HEADERS][2] = {
		{"content-security-policy:", self->policy},
		{"x-content-type-options:", "nosniff"},
		{"referrer-policy:", "no-referrer"},
		{"cross-origin-opener-policy:", "same-origin"},
		{"cross-origin-resource-policy:", "same-origin"},
	};

	(void)snprintf(self->policy, sizeof(self->policy), CONTENT_SECURITY_POLICY, connect);
	for (int i = 0; i < RESPONSE_HEADERS; i++)
		self->headers[i] = (struct lws_protocol_vhost_options){
			.next = i + 1 < RESPONSE_HEADERS ? &self->headers[i + 1] : NULL,
			.name = headers[i][0],
			.value = headers[i][1],
		};
}

static void set_tls(struct lws_context_creation_info *info, const struct lp_pair *pair)
{
	info->options |= LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT;
	info->ssl_cert_filepath = pair->certificate_path;
	info->ssl_private_key_filepath = pair->key_path;
	info->ssl_options_set = NO_OLD_TLS;
	info->ssl_cipher_list = TLS_1_2_CIPHERS;
}

int lp_server_certify(struct lp_server *server, const struct lp_pair *pair)
{
	if (server->tls)
		return lp_pair_use(pair, server->object, server->tls);
	lp_error(server->object, "pair", "libwebsockets takes no other pair — restart lightprobed");
	return -ENOTSUP;
}

static int create_context(struct lp_server *self, const struct lp_server_options *options)
{
	static const lws_retry_bo_t idle = {.secs_since_valid_ping = PING_AFTER_S,
					    .secs_since_valid_hangup = HANGUP_AFTER_S};
	struct lws_context_creation_info info = {
		.port = CONTEXT_PORT_NO_LISTEN_SERVER,
		.protocols = self->protocols,
		.mounts = *options->root ? &self->mount : NULL,
		.headers = self->headers,
		.options = LWS_SERVER_OPTION_LIBUV,
		.foreign_loops = self->loops,
		.pcontext = &self->context,
		.user = self,
		.max_http_header_data = HEADER_BYTES,
		.max_http_header_pool = (unsigned short)options->most_handshakes,
		.pt_serv_buf_size = FILE_BYTES,
		.timeout_secs = REQUEST_TIMEOUT_S,
		.keepalive_timeout = REQUEST_TIMEOUT_S,
		.retry_and_idle_policy = &idle,
		.fd_limit_per_thread = (unsigned int)(options->max_connections + OTHER_DESCRIPTORS),
		.alpn = "http/1.1", /* WebSockets over HTTP/2 send other headers */
		.server_string = "lightprobed",
		.gid = (gid_t)-1,
		.uid = (uid_t)-1,
	};

	if (options->pair)
		set_tls(&info, options->pair);
	self->context = lws_create_context(&info);
	if (!self->context) {
		lp_error(options->object, "start",
			 "libwebsockets cannot start — is libwebsockets-evlib-uv installed? "
			 "--log-level=debug shows what it says");
		return -EPROTO;
	}
	if (*options->root)
		lws_set_fops(self->context, &self->files.ops);
	self->vhost = lws_get_vhost_by_name(self->context, "default");
	return 0;
}

int lp_server_create(const struct lp_server_options *options, const struct lp_server_host *host,
		     struct lp_loop *loop, struct lp_server **server)
{
	struct lp_server *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->host = *host;
	self->loop = loop;
	self->loops[0] = lp_loop_uv(loop);
	self->is_tls = options->pair != NULL;
	self->object = options->object;
	self->protocols[0] = (struct lws_protocols){.name = LP_WEBSOCKET_PROTOCOL,
						    .callback = on_event,
						    .rx_buffer_size = LP_REQUEST_MAX_BYTES,
						    .tx_packet_size = FILE_BYTES};
	if (*options->root) {
		lp_files_init(&self->files, options->root, on_page_bytes);
		lp_files_mount(&self->mount);
	}
	set_response_headers(self, options->connect);
	lws_set_log_level(LLL_ERR | LLL_WARN, on_library_log);
	ret = create_context(self, options);
	if (ret < 0) {
		free(self);
		return ret;
	}
	*server = self;
	return 0;
}

static void on_loop_ended(struct lp_loop_end *end)
{
	struct lp_server *server = LP_CONTAINER_OF(end, struct lp_server, end);

	if (server->context)
		lws_context_destroy(server->context);
	free(server);
}

void lp_server_destroy(struct lp_server *server)
{
	struct lp_session *next;

	if (!server)
		return;
	for (struct lp_session *session = server->first; session; session = next) {
		next = session->next;
		end_session(session);
	}
	lws_context_destroy(server->context); /* begins to; the rest needs the loop */
	server->end.ended = on_loop_ended;
	lp_loop_at_end(server->loop, &server->end);
}
