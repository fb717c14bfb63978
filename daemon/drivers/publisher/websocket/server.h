/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An HTTP server with one WebSocket protocol and a folder of files, on libwebsockets, which joins
 * the daemon's loop. Loop thread. It accepts nothing by itself: connections are handed to it.
 */
#ifndef LP_WEBSOCKET_SERVER_H
#define LP_WEBSOCKET_SERVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lp_loop;
struct lp_pair;
struct lp_packet;
struct lp_server;
struct lp_session; /* one connection; owned by the server */

/* Calls into the publisher. `session` is the same from opened() to closed(). */
struct lp_server_host {
	void *context;
	/* Why this handshake is refused, as an answer to it; NULL: it may go on. The texts are the
	 * headers' ("" when absent). */
	const char *(*check)(void *context, struct lp_session *session, const char *host,
			     const char *origin, const char *protocols);
	void (*opened)(void *context, struct lp_session *session);
	/* One binary message; at most LP_REQUEST_MAX_BYTES. */
	void (*message)(void *context, struct lp_session *session, const uint8_t *data,
			size_t size_bytes);
	/* A text message, or one that is too long (-EMSGSIZE); nothing more is heard of this
	 * session but writable() and closed(). */
	void (*unreadable)(void *context, struct lp_session *session, const char *reason);
	/* It takes a message now, as lp_session_want_write() has asked. NULL: nothing is left. The
	 * packet is the server's to drop. */
	struct lp_packet *(*writable)(void *context, struct lp_session *session);
	/* A page's file is asked for (0), or so many bytes of it are sent. False: end the
	 * connection.
	 */
	bool (*page)(void *context, struct lp_session *session, size_t size_bytes);
	/* The connection has ended; the last call. Sessions that never opened are closed, too. */
	void (*closed)(void *context, struct lp_session *session);
};

struct lp_server_options {
	const char *object;  /* names it in messages; borrowed */
	const char *root;    /* folder of files to serve; "": none */
	const char *connect; /* sources that the page may connect to besides its own; "": none */
	int max_connections, most_handshakes;
	const struct lp_pair *pair; /* NULL: without TLS */
};

/* 0 or -errno, logged. */
int lp_server_create(const struct lp_server_options *options, const struct lp_server_host *host,
		     struct lp_loop *loop, struct lp_server **server);

/* Handshakes from now on are with this pair. 0 or -errno, logged: the former stays. */
int lp_server_certify(struct lp_server *server, const struct lp_pair *pair);

/* Closes all sessions; closed() is called for each. Accepts NULL. */
void lp_server_destroy(struct lp_server *server);

/* Serve an accepted socket, which it takes over in any case. `user` is the publisher's. 0, or
 * -errno: closed() has been called, but for -ENOMEM. *place is set before anything is called. */
int lp_server_adopt(struct lp_server *server, int fd, void *user, struct lp_session **place);

void *lp_session_user(const struct lp_session *session);

/* Bytes that have come on this connection since it began, of any kind: frames that the library
 * answers by itself, TLS. */
uint64_t lp_session_received_bytes(const struct lp_session *session);

/* End it now, whatever it is doing; closed() follows. */
void lp_session_kill(struct lp_session *session);

/* Have writable() called when the connection takes a message. */
void lp_session_want_write(struct lp_session *session);

/* Close when writable() has nothing left, or after two seconds; `reason` (static) goes along. */
void lp_session_close(struct lp_session *session, const char *reason);

#endif
