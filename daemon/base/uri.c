/* SPDX-License-Identifier: Apache-2.0 */
#include "base/uri.h"

#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/param.h"

static int hex_digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	c = (char)(c | 0x20);
	return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* Decode %XX in place. -EINVAL: no two hex digits, or a zero byte. */
static int decode(char *text)
{
	char *out = text;

	for (; *text; text++) {
		if (*text == '%') {
			const int high = hex_digit(text[1]);
			const int low = high < 0 ? -1 : hex_digit(text[2]);

			if (low < 0 || high + low == 0)
				return -EINVAL;
			*out++ = (char)(high << 4 | low);
			text += 2;
		} else {
			*out++ = *text;
		}
	}
	*out = '\0';
	return 0;
}

static bool is_scheme(const char *text, size_t length)
{
	if (length == 0 || !islower((unsigned char)text[0]))
		return false;
	for (size_t i = 1; i < length; i++) {
		if (!islower((unsigned char)text[i]) && !isdigit((unsigned char)text[i]) &&
		    !strchr("+-.", text[i]))
			return false;
	}
	return true;
}

/* Split key=value&key=value in place. Returns what is wrong, or NULL. */
static const char *split_query(struct lp_uri *uri, char *query)
{
	char *next;

	for (; query && *query; query = next) {
		char *value;

		next = strchr(query, '&');
		if (next)
			*next++ = '\0';
		value = strchr(query, '=');
		if (!value || value == query)
			return "expected key=value pairs after '?', separated by '&'";
		if (uri->key_count == LP_URI_MAX_KEYS)
			return "too many keys";
		*value++ = '\0';
		if (decode(query) < 0 || decode(value) < 0)
			return "'%' must be followed by two hex digits (and not 00)";
		uri->keys[uri->key_count++] = (struct lp_uri_key){query, value};
	}
	return NULL;
}

/* Returns what is wrong, or NULL. */
static const char *split(struct lp_uri *uri)
{
	char *colon = strchr(uri->storage, ':');
	char *question;

	if (!colon || !is_scheme(uri->storage, (size_t)(colon - uri->storage)))
		return "must begin with a scheme and a colon, like file:room.jpg";
	*colon = '\0';
	uri->scheme = uri->storage;
	uri->rest = colon + 1;
	question = strchr(colon + 1, '?');
	uri->query = "";
	if (question) {
		uri->query = uri->text + (question + 1 - uri->storage);
		*question = '\0';
	}
	if (decode(colon + 1) < 0)
		return "'%' must be followed by two hex digits (and not 00)";
	return split_query(uri, question ? question + 1 : NULL);
}

static bool has_control(const char *text)
{
	while (*text && !iscntrl((unsigned char)*text))
		text++;
	return *text != '\0';
}

int lp_uri_parse(struct lp_uri *uri, const char *text)
{
	const size_t length = strlen(text);
	const char *fault;

	uri->key_count = 0;
	if (length >= sizeof(uri->text)) {
		lp_error("uri", "parse", "longer than %d bytes", LP_URI_MAX_BYTES - 1);
		return -EINVAL;
	}
	memcpy(uri->text, text, length + 1);
	memcpy(uri->storage, text, length + 1);
	fault = has_control(text) ? "control characters are written %XX" : split(uri);
	if (fault) {
		lp_error(uri->text, "parse", "%s", fault);
		return -EINVAL;
	}
	return 0;
}

int lp_uri_set(const struct lp_uri *uri, const struct lp_params *params, void *fields)
{
	int ret = 0;

	for (int i = 0; i < uri->key_count && ret == 0; i++)
		ret = lp_param_set(params, fields, uri->text, uri->keys[i].name,
				   uri->keys[i].value);
	return ret;
}

int lp_uri_read(const struct lp_uri *uri, const struct lp_params *params, void *fields)
{
	lp_param_defaults(params, fields);
	return lp_uri_set(uri, params, fields);
}

bool lp_uri_has(const struct lp_uri *uri, const char *name)
{
	for (int i = 0; i < uri->key_count; i++) {
		if (strcmp(uri->keys[i].name, name) == 0)
			return true;
	}
	return false;
}
