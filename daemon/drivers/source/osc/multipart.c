/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/multipart.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define MOST_BOUNDARY_BYTES 70 /* RFC 2046, 5.1.1 */
/* So many bytes are not the same by chance, in any picture of any day. */
#define CERTAIN_BYTES 6

/* ---------------------------------------------------------------- the type */

#define BLANKS " \t"

static const char *skip_blanks(const char *text)
{
	return text + strspn(text, BLANKS);
}

/* The value of a parameter: as it stands, or in quotes, where a backslash makes the next character
 * plain (RFC 2045, 5.1). Steps behind it. Returns its length; what does not fit is counted only. */
static size_t read_value(const char **text, char *value, size_t capacity)
{
	const char *at = *text;
	const bool is_quoted = *at == '"';
	size_t length = 0;

	for (at += is_quoted; *at && !strchr(is_quoted ? "\"" : ";" BLANKS, *at); at++) {
		if (is_quoted && *at == '\\' && at[1])
			at++;
		if (length < capacity)
			value[length] = *at;
		length++;
	}
	*text = at + (is_quoted && *at == '"');
	return length;
}

/* The parameters follow the type, each behind a semicolon; blanks may stand anywhere between. */
static size_t find_boundary(const char *type, char *value, size_t capacity)
{
	static const char wanted[] = "boundary";
	const char *at = strchr(type, ';');

	while (at) {
		const char *const name = skip_blanks(at + 1);
		const size_t name_bytes = strcspn(name, ";=" BLANKS);
		size_t length = 0;

		at = skip_blanks(name + name_bytes);
		if (*at == '=') {
			at = skip_blanks(at + 1);
			length = read_value(&at, value, capacity);
		}
		if (name_bytes == strlen(wanted) && strncasecmp(name, wanted, name_bytes) == 0)
			return length;
		at = strchr(at, ';');
	}
	return 0;
}

int lp_multipart_init(struct lp_multipart *multipart, const char *content_type,
		      const struct lp_multipart_sink *sink)
{
	size_t length;

	*multipart = (struct lp_multipart){.sink = *sink};
	if (!content_type || strncasecmp(content_type, "multipart/", 10) != 0)
		return -EPROTO;
	length = find_boundary(content_type, multipart->boundary, MOST_BOUNDARY_BYTES);
	if (length == 0 || length > MOST_BOUNDARY_BYTES)
		return -EPROTO;
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

/* A line without its end: is it the boundary, with or without its dashes? Blanks may follow
 * (RFC 2046, 5.1.1: transport padding); with dashes behind it, no part follows. */
static bool is_boundary(const struct lp_multipart *m)
{
	for (size_t dashes = 0; dashes <= 2; dashes++) {
		const char *const text = m->line + dashes;

		if (m->line_bytes >= dashes + m->boundary_bytes &&
		    memcmp(m->line, "--", dashes) == 0 &&
		    memcmp(text, m->boundary, m->boundary_bytes) == 0 &&
		    *skip_blanks(text + m->boundary_bytes) == '\0')
			return true;
	}
	return false;
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

static bool ends_like_a_jpeg(const uint8_t *body, size_t bytes)
{
	return bytes >= 2 && body[bytes - 2] == 0xff && body[bytes - 1] == 0xd9;
}

/* Where the picture ends before the boundary's text at `at`: in front of its dashes and the line
 * end. False: these bytes are rather the picture's own. What RFC 2046 prescribes is always a
 * boundary; without line end or dashes it must be long, or follow the end of a JPEG. */
static bool ends_at(const struct lp_multipart *m, size_t at, size_t *end)
{
	size_t dashes = 0, line_end = at;

	while (dashes < 2 && line_end > 0 && m->body[line_end - 1] == '-') {
		line_end--;
		dashes++;
	}
	*end = line_end;
	if (*end > 0 && m->body[*end - 1] == '\n')
		(*end)--;
	if (*end > 0 && m->body[*end - 1] == '\r')
		(*end)--;
	const bool begins_line = line_end == 0 || *end < line_end;

	return (begins_line && dashes == 2) || ends_like_a_jpeg(m->body, *end) ||
	       begins_line + dashes + m->boundary_bytes >= CERTAIN_BYTES;
}

/* Look for the boundary in what has just come, and in what may have been its beginning before.
 * Returns how many of the `added` bytes belong to what came before the boundary's end. */
static size_t search_boundary(struct lp_multipart *m, size_t added)
{
	const size_t old = m->body_bytes - added;
	size_t from = old > m->boundary_bytes ? old - m->boundary_bytes : 0, end;
	const uint8_t *found;

	while ((found = memmem(m->body + from, m->body_bytes - from, m->boundary,
			       m->boundary_bytes)) != NULL) {
		const size_t at = (size_t)(found - m->body);

		from = at + 1;
		if (!ends_at(m, at, &end))
			continue;
		end_part(m, end);
		/* What follows the boundary in its line says whether it is the last one. */
		memcpy(m->line, m->boundary, m->boundary_bytes);
		m->line_bytes = m->boundary_bytes;
		return at + m->boundary_bytes > old ? at + m->boundary_bytes - old : 0;
	}
	return added;
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
	if (ends_like_a_jpeg(m->body, m->body_bytes) &&
	    m->sink.is_whole(m->sink.context, m->body, m->body_bytes))
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
