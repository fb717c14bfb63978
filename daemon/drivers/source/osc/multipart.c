/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/multipart.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define MOST_BOUNDARY_BYTES 70 /* RFC 2046, 5.1.1 */

int lp_multipart_init(struct lp_multipart *multipart, const char *content_type,
		      const struct lp_multipart_sink *sink)
{
	const char *start = content_type ? strcasestr(content_type, "boundary=") : NULL;
	size_t length;

	*multipart = (struct lp_multipart){.sink = *sink};
	if (!start || strncasecmp(content_type, "multipart/", 10) != 0)
		return -EPROTO;
	start += strlen("boundary=");
	if (*start == '"')
		length = strcspn(++start, "\"");
	else
		length = strcspn(start, "; \t");
	if (length == 0 || length > MOST_BOUNDARY_BYTES)
		return -EPROTO;
	memcpy(multipart->boundary, start, length);
	multipart->boundary_bytes = length;
	return 0;
}

/* ---------------------------------------------------------------- lines: boundary and header */

static void begin_header(struct lp_multipart *m)
{
	m->state = LP_MULTIPART_HEADER;
	m->length_bytes = 0;
}

static void read_header_line(struct lp_multipart *m)
{
	static const char name[] = "Content-Length:";

	if (m->line_bytes == 0) {
		m->state = LP_MULTIPART_BODY;
		m->body_bytes = 0;
	} else if (strncasecmp(m->line, name, strlen(name)) == 0) {
		const unsigned long long value = strtoull(m->line + strlen(name), NULL, 10);

		m->length_bytes = value <= LP_MULTIPART_MOST_BYTES ? (size_t)value : 0;
	}
}

/* A line without its end: is it the boundary, with or without its dashes? */
static bool is_boundary(const struct lp_multipart *m)
{
	const size_t dashes = m->line_bytes - m->boundary_bytes;

	return m->line_bytes >= m->boundary_bytes && dashes <= 2 &&
	       memcmp(m->line + dashes, m->boundary, m->boundary_bytes) == 0 &&
	       memcmp(m->line, "--", dashes) == 0;
}

static void read_line(struct lp_multipart *m)
{
	if (m->line_bytes > 0 && m->line[m->line_bytes - 1] == '\r')
		m->line_bytes--;
	m->line[m->line_bytes] = '\0';
	if (m->state == LP_MULTIPART_HEADER)
		read_header_line(m);
	else if (is_boundary(m))
		begin_header(m);
	m->line_bytes = 0;
}

/* Bytes used: up to the end of the line, or all. What is longer than any boundary is cut. */
static size_t take_line(struct lp_multipart *m, const uint8_t *data, size_t size_bytes)
{
	const uint8_t *end = memchr(data, '\n', size_bytes);
	const size_t taken = end ? (size_t)(end - data) : size_bytes;
	const size_t room = sizeof(m->line) - 1 - m->line_bytes;
	const size_t kept = taken < room ? taken : room;

	memcpy(m->line + m->line_bytes, data, kept);
	m->line_bytes += kept;
	if (!end)
		return taken;
	read_line(m);
	return taken + 1;
}

/* ---------------------------------------------------------------- body */

static void end_part(struct lp_multipart *m, size_t size_bytes)
{
	m->sink.part(m->sink.context, size_bytes);
	m->state = LP_MULTIPART_SEEK;
	m->line_bytes = 0;
}

/* The end of the picture before a boundary at `at`: without the dashes and the line end. */
static size_t before_boundary(const uint8_t *body, size_t at)
{
	for (int i = 0; i < 2 && at > 0 && body[at - 1] == '-'; i++)
		at--;
	if (at > 0 && body[at - 1] == '\n')
		at--;
	if (at > 0 && body[at - 1] == '\r')
		at--;
	return at;
}

static bool ends_like_a_jpeg(const struct lp_multipart *m)
{
	return m->body_bytes >= 2 && m->body[m->body_bytes - 2] == 0xff &&
	       m->body[m->body_bytes - 1] == 0xd9;
}

/* Look for the boundary in what has just come, and in what may have been its beginning before.
 * Returns how many of the `added` bytes belong to what came before the boundary's end. */
static size_t search_boundary(struct lp_multipart *m, size_t added)
{
	const size_t old = m->body_bytes - added;
	const size_t from = old > m->boundary_bytes ? old - m->boundary_bytes : 0;
	const uint8_t *found =
		memmem(m->body + from, m->body_bytes - from, m->boundary, m->boundary_bytes);
	size_t at;

	if (!found)
		return added;
	at = (size_t)(found - m->body);
	end_part(m, before_boundary(m->body, at));
	/* What follows the boundary in its line is of no interest. */
	memcpy(m->line, m->boundary, m->boundary_bytes);
	m->line_bytes = m->boundary_bytes;
	return at + m->boundary_bytes - old;
}

/* Bytes used. */
static size_t take_body(struct lp_multipart *m, const uint8_t *data, size_t size_bytes)
{
	const size_t left =
		m->length_bytes > m->body_bytes ? m->length_bytes - m->body_bytes : size_bytes;
	const size_t added = left < size_bytes ? left : size_bytes;
	size_t used;

	m->body = m->body_bytes + added <= LP_MULTIPART_MOST_BYTES
			  ? m->sink.reserve(m->sink.context, m->body_bytes + added)
			  : NULL;
	if (!m->body) { /* no room: the part is left out */
		m->state = LP_MULTIPART_SEEK;
		m->line_bytes = 0;
		return 0;
	}
	memcpy(m->body + m->body_bytes, data, added);
	m->body_bytes += added;
	used = search_boundary(m, added);
	if (m->state != LP_MULTIPART_BODY || m->body_bytes < m->length_bytes)
		return used;
	if (ends_like_a_jpeg(m) && m->sink.is_whole(m->sink.context, m->body, m->body_bytes))
		end_part(m, m->body_bytes);
	else
		m->length_bytes = 0; /* it was wrong, or there is none: the boundary decides */
	return used;
}

void lp_multipart_feed(struct lp_multipart *multipart, const uint8_t *data, size_t size_bytes)
{
	while (size_bytes > 0) {
		const size_t used = multipart->state == LP_MULTIPART_BODY
					    ? take_body(multipart, data, size_bytes)
					    : take_line(multipart, data, size_bytes);

		data += used;
		size_bytes -= used;
	}
}
