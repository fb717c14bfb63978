/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/http.h"

#include <curl/curl.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/macros.h"

#define MOST_TEXT_BYTES ((size_t)256 << 10) /* of a reply; cameras send a few KiB */
#define CONNECT_MS 3000L
#define COMMAND_MS 5000L /* cameras answer within one second, but for a change of mode */
#define READ_BYTES (256L << 10)
#define TURN_MS 100

struct text {
	char *data; /* MOST_TEXT_BYTES + 1 */
	size_t bytes;
};

struct lp_osc_http {
	char base[300];
	CURLM *multi;
	struct curl_slist *headers;
	atomic_bool canceled;
	int64_t last_words_ns; /* until when commands work although canceled; 0: not */

	CURL *command;
	bool command_runs, command_done;
	CURLcode command_result;
	struct text reply;

	CURL *stream;
	enum lp_osc_stream stream_state;
	bool stream_done;
	struct lp_osc_stream_sink sink;
	struct text refusal;
};

/* ---------------------------------------------------------------- bytes that come */

static size_t keep_text(const char *data, size_t size, size_t count, void *context)
{
	struct text *text = context;
	const size_t bytes = size * count;

	if (bytes > MOST_TEXT_BYTES - text->bytes)
		return 0; /* libcurl ends the transfer */
	memcpy(text->data + text->bytes, data, bytes);
	text->bytes += bytes;
	text->data[text->bytes] = '\0';
	return bytes;
}

static void begin_stream(struct lp_osc_http *http)
{
	const char *type = NULL;
	long status = 0;

	(void)curl_easy_getinfo(http->stream, CURLINFO_RESPONSE_CODE, &status);
	(void)curl_easy_getinfo(http->stream, CURLINFO_CONTENT_TYPE, &type);
	http->stream_state = status == 200 && http->sink.begin(http->sink.context, type)
				     ? LP_OSC_STREAM_RUNNING
				     : LP_OSC_STREAM_REFUSED;
}

static size_t take_stream(const char *data, size_t size, size_t count, void *context)
{
	struct lp_osc_http *http = context;

	if (http->stream_state == LP_OSC_STREAM_BEGINNING)
		begin_stream(http);
	if (http->stream_state == LP_OSC_STREAM_REFUSED)
		return keep_text(data, size, count, &http->refusal);
	http->sink.data(http->sink.context, (const uint8_t *)data, size * count);
	return size * count;
}

/* ---------------------------------------------------------------- life */

static CURL *make_easy(const struct lp_osc_http *http, const struct lp_osc_login *login)
{
	CURL *easy = curl_easy_init();

	if (!easy)
		return NULL;
	(void)curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
	(void)curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http");
	(void)curl_easy_setopt(easy, CURLOPT_NOPROXY, "*"); /* a camera is in our own network */
	(void)curl_easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, CONNECT_MS);
	(void)curl_easy_setopt(easy, CURLOPT_HTTPHEADER, http->headers);
	if (*login->user) {
		(void)curl_easy_setopt(easy, CURLOPT_HTTPAUTH, (long)CURLAUTH_DIGEST);
		(void)curl_easy_setopt(easy, CURLOPT_USERNAME, login->user);
		(void)curl_easy_setopt(easy, CURLOPT_PASSWORD, login->password);
	}
	return easy;
}

static struct curl_slist *make_headers(void)
{
	static const char *const lines[] = {"Content-Type: application/json; charset=utf-8",
					    "X-XSRF-Protected: 1", "Expect:"};
	struct curl_slist *headers = NULL;

	for (size_t i = 0; i < LP_COUNT(lines); i++) {
		struct curl_slist *longer = curl_slist_append(headers, lines[i]);

		if (!longer) {
			curl_slist_free_all(headers);
			return NULL;
		}
		headers = longer;
	}
	return headers;
}

struct lp_osc_http *lp_osc_http_create(const char *base, const struct lp_osc_login *login)
{
	struct lp_osc_http *http = calloc(1, sizeof(*http));

	if (!http || curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
		free(http);
		return NULL;
	}
	(void)snprintf(http->base, sizeof(http->base), "%s", base);
	http->multi = curl_multi_init();
	http->headers = make_headers();
	http->command = make_easy(http, login);
	http->stream = make_easy(http, login);
	http->reply.data = malloc(MOST_TEXT_BYTES + 1);
	http->refusal.data = malloc(MOST_TEXT_BYTES + 1);
	if (!http->multi || !http->headers || !http->command || !http->stream ||
	    !http->reply.data || !http->refusal.data) {
		lp_osc_http_destroy(http);
		return NULL;
	}
	(void)curl_easy_setopt(http->command, CURLOPT_TIMEOUT_MS, COMMAND_MS);
	(void)curl_easy_setopt(http->command, CURLOPT_WRITEFUNCTION, keep_text);
	(void)curl_easy_setopt(http->command, CURLOPT_WRITEDATA, &http->reply);
	(void)curl_easy_setopt(http->stream, CURLOPT_BUFFERSIZE, READ_BYTES);
	(void)curl_easy_setopt(http->stream, CURLOPT_WRITEFUNCTION, take_stream);
	(void)curl_easy_setopt(http->stream, CURLOPT_WRITEDATA, http);
	return http;
}

static void abandon_command(struct lp_osc_http *http)
{
	if (http->command_runs)
		(void)curl_multi_remove_handle(http->multi, http->command);
	http->command_runs = http->command_done = false;
}

void lp_osc_http_destroy(struct lp_osc_http *http)
{
	if (!http)
		return;
	if (http->multi) {
		abandon_command(http);
		lp_osc_http_stream_close(http);
	}
	curl_easy_cleanup(http->command);
	curl_easy_cleanup(http->stream);
	(void)curl_multi_cleanup(http->multi);
	curl_slist_free_all(http->headers);
	free(http->reply.data);
	free(http->refusal.data);
	free(http);
	curl_global_cleanup();
}

void lp_osc_http_wake(struct lp_osc_http *http)
{
	(void)curl_multi_wakeup(http->multi);
}

void lp_osc_http_cancel(struct lp_osc_http *http)
{
	atomic_store(&http->canceled, true);
	lp_osc_http_wake(http);
}

void lp_osc_http_last_words(struct lp_osc_http *http, int64_t left_ns)
{
	http->last_words_ns = lp_clock_ns() + left_ns;
}

static bool is_canceled(const struct lp_osc_http *http)
{
	return atomic_load(&http->canceled) && lp_clock_ns() >= http->last_words_ns;
}

/* ---------------------------------------------------------------- transfers */

static void end_stream(struct lp_osc_http *http, CURLcode result)
{
	(void)curl_multi_remove_handle(http->multi, http->stream);
	http->stream_done = true;
	if (http->stream_state == LP_OSC_STREAM_BEGINNING && result == CURLE_OK)
		begin_stream(http); /* without a byte */
	if (http->stream_state != LP_OSC_STREAM_REFUSED)
		http->stream_state =
			result == CURLE_OK ? LP_OSC_STREAM_ENDED : LP_OSC_STREAM_BROKEN;
}

void lp_osc_http_turn(struct lp_osc_http *http, int wait_ms)
{
	CURLMsg *message;
	int count;

	(void)curl_multi_poll(http->multi, NULL, 0, wait_ms, NULL);
	(void)curl_multi_perform(http->multi, &count);
	while ((message = curl_multi_info_read(http->multi, &count)) != NULL) {
		const CURLcode result = message->data.result;

		if (message->msg != CURLMSG_DONE)
			continue;
		if (message->easy_handle == http->stream) {
			end_stream(http, result);
		} else {
			(void)curl_multi_remove_handle(http->multi, http->command);
			http->command_result = result;
			http->command_done = true;
			http->command_runs = false;
		}
	}
}

static void set_request(const struct lp_osc_http *http, CURL *easy, const char *path,
			const char *body)
{
	char url[400];

	(void)snprintf(url, sizeof(url), "%s%s", http->base, path);
	(void)curl_easy_setopt(easy, CURLOPT_URL, url);
	if (body)
		(void)curl_easy_setopt(easy, CURLOPT_COPYPOSTFIELDS, body);
	else
		(void)curl_easy_setopt(easy, CURLOPT_HTTPGET, 1L);
}

int lp_osc_http_begin(struct lp_osc_http *http, const char *path, const char *body)
{
	if (http->command_runs || http->command_done)
		return -EBUSY;
	http->reply.bytes = 0;
	http->reply.data[0] = '\0';
	set_request(http, http->command, path, body);
	if (curl_multi_add_handle(http->multi, http->command) != CURLM_OK)
		return -ENOMEM;
	http->command_runs = true;
	return 0;
}

static int error_of(CURLcode result)
{
	switch (result) {
	case CURLE_OK:
		return 0;
	case CURLE_COULDNT_RESOLVE_HOST:
		return -ENXIO;
	case CURLE_COULDNT_CONNECT:
		return -ECONNREFUSED;
	case CURLE_OPERATION_TIMEDOUT:
		return -ETIMEDOUT;
	default:
		return -EIO;
	}
}

int lp_osc_http_end(struct lp_osc_http *http, struct lp_osc_reply *reply)
{
	long status = 0;

	if (is_canceled(http)) {
		abandon_command(http);
		return -ECANCELED;
	}
	if (!http->command_done)
		return -EINPROGRESS;
	http->command_done = false;
	(void)curl_easy_getinfo(http->command, CURLINFO_RESPONSE_CODE, &status);
	*reply = (struct lp_osc_reply){.status = (int)status,
				       .text = http->reply.data,
				       .text_bytes = http->reply.bytes};
	return error_of(http->command_result);
}

int lp_osc_http_request(struct lp_osc_http *http, const char *path, const char *body,
			struct lp_osc_reply *reply)
{
	int ret = lp_osc_http_begin(http, path, body);

	if (ret < 0)
		return ret;
	while ((ret = lp_osc_http_end(http, reply)) == -EINPROGRESS)
		lp_osc_http_turn(http, TURN_MS);
	return ret;
}

int lp_osc_http_stream(struct lp_osc_http *http, const char *path, const char *body,
		       const struct lp_osc_stream_sink *sink)
{
	lp_osc_http_stream_close(http);
	http->sink = *sink;
	http->refusal.bytes = 0;
	http->refusal.data[0] = '\0';
	set_request(http, http->stream, path, body);
	if (curl_multi_add_handle(http->multi, http->stream) != CURLM_OK)
		return -ENOMEM;
	http->stream_state = LP_OSC_STREAM_BEGINNING;
	http->stream_done = false;
	return 0;
}

enum lp_osc_stream lp_osc_http_stream_state(const struct lp_osc_http *http)
{
	/* A refusal counts when all of it has come. */
	return http->stream_state == LP_OSC_STREAM_REFUSED && !http->stream_done
		       ? LP_OSC_STREAM_BEGINNING
		       : http->stream_state;
}

void lp_osc_http_stream_reply(const struct lp_osc_http *http, struct lp_osc_reply *reply)
{
	long status = 0;

	(void)curl_easy_getinfo(http->stream, CURLINFO_RESPONSE_CODE, &status);
	*reply = (struct lp_osc_reply){.status = (int)status,
				       .text = http->refusal.data,
				       .text_bytes = http->refusal.bytes};
}

void lp_osc_http_stream_close(struct lp_osc_http *http)
{
	if (http->stream_state != LP_OSC_STREAM_NONE)
		(void)curl_multi_remove_handle(http->multi, http->stream);
	http->stream_state = LP_OSC_STREAM_NONE;
}
