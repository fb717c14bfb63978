/* SPDX-License-Identifier: Apache-2.0 */
/*
 * HTTP to one camera: one command at a time and one stream beside it, on libcurl. Every function
 * is the capture thread's, but lp_osc_http_wake() and lp_osc_http_cancel(), which are any thread's.
 */
#ifndef LP_SOURCE_OSC_HTTP_H
#define LP_SOURCE_OSC_HTTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lp_osc_http;

struct lp_osc_login {
	char user[96], password[96]; /* both "": none is needed */
};

/* Of a command that has got through. */
struct lp_osc_reply {
	int status;	  /* of HTTP */
	const char *text; /* zero-terminated; valid until the next command */
	size_t text_bytes;
};

/* How a stream is. */
enum lp_osc_stream {
	LP_OSC_STREAM_NONE,
	LP_OSC_STREAM_BEGINNING, /* no byte has come */
	LP_OSC_STREAM_RUNNING,
	LP_OSC_STREAM_REFUSED, /* the camera answers with an error: lp_osc_http_stream_reply() */
	LP_OSC_STREAM_ENDED,   /* by the camera */
	LP_OSC_STREAM_BROKEN,  /* by the network */
};

struct lp_osc_stream_sink {
	void *context;
	/* Before the first data(). False: the type is of no use; the stream counts as refused. */
	bool (*begin)(void *context, const char *content_type);
	void (*data)(void *context, const uint8_t *data, size_t size_bytes);
};

/* `base`: "http://HOST:PORT", copied as `login` is. NULL: out of memory. */
struct lp_osc_http *lp_osc_http_create(const char *base, const struct lp_osc_login *login);

/* Accepts NULL. */
void lp_osc_http_destroy(struct lp_osc_http *http);

/* End the wait in lp_osc_http_turn(). */
void lp_osc_http_wake(struct lp_osc_http *http);

/* Commands fail with -ECANCELED from now on, those under way at once. */
void lp_osc_http_cancel(struct lp_osc_http *http);

/* After lp_osc_http_cancel(): commands work again for so long. */
void lp_osc_http_last_words(struct lp_osc_http *http, int64_t left_ns);

/* Wait for something to happen, for `wait_ms` at most, and do what is due. */
void lp_osc_http_turn(struct lp_osc_http *http, int wait_ms);

/* Begin a command: `path` as "/osc/info", `body` JSON (copied); NULL: GET. -EBUSY: one is under
 * way. */
int lp_osc_http_begin(struct lp_osc_http *http, const char *path, const char *body);

/* -EINPROGRESS; 0 with the reply; or why it did not get through: -ENXIO (no such host),
 * -ECONNREFUSED, -ETIMEDOUT, -ECANCELED, -EIO. Once ended, another command may begin. */
int lp_osc_http_end(struct lp_osc_http *http, struct lp_osc_reply *reply);

/* Both, and the wait between them, during which the stream goes on. */
int lp_osc_http_request(struct lp_osc_http *http, const char *path, const char *body,
			struct lp_osc_reply *reply);

/* Begin a stream; one that runs is closed. */
int lp_osc_http_stream(struct lp_osc_http *http, const char *path, const char *body,
		       const struct lp_osc_stream_sink *sink);
enum lp_osc_stream lp_osc_http_stream_state(const struct lp_osc_http *http);

/* Of a refused one. */
void lp_osc_http_stream_reply(const struct lp_osc_http *http, struct lp_osc_reply *reply);
void lp_osc_http_stream_close(struct lp_osc_http *http);

#endif
