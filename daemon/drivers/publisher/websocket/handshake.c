/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/handshake.h"

#include <arpa/inet.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

/* What follows http:// or https:// in an origin; NULL: it is no origin of a page. */
static const char *host_of_origin(const char *origin)
{
	const char *const schemes[] = {"http://", "https://"};

	for (int i = 0; i < 2; i++) {
		const size_t length = strlen(schemes[i]);

		if (strncasecmp(origin, schemes[i], length) == 0)
			return origin + length;
	}
	return NULL;
}

/* The next item of a list with commas, blanks left out; steps over it. False: none left. */
static bool next_item(const char **list, const char **item, size_t *length)
{
	const char *at = *list + strspn(*list, ", \t");

	*item = at;
	*length = strcspn(at, ", \t");
	*list = at + *length;
	return *length > 0;
}

bool lp_origin_is_ok(const char *origin, const char *host, const char *allowed)
{
	const char *own = host_of_origin(origin), *item;
	size_t length;

	if (!*origin || (own && *own && strcasecmp(own, host) == 0))
		return true;
	while (next_item(&allowed, &item, &length)) {
		if (strlen(origin) == length && strncasecmp(origin, item, length) == 0)
			return true;
	}
	return false;
}

/* The host without its port, and without the brackets of IPv6. False: too long to be one. */
static bool strip_port(const char *host, char *name, size_t size_bytes)
{
	const bool has_brackets = host[0] == '[';
	const char *begin = host + has_brackets;
	const size_t length = strcspn(begin, has_brackets ? "]" : ":");
	const char *rest = begin + length;

	if (has_brackets && *rest++ != ']')
		return false;
	return length > 0 && length < size_bytes && (!*rest || *rest == ':') &&
	       strspn(rest, ":0123456789") == strlen(rest) &&
	       snprintf(name, size_bytes, "%.*s", (int)length, begin) > 0;
}

static bool is_address(const char *name)
{
	struct in6_addr address;

	return inet_pton(AF_INET, name, &address) == 1 || inet_pton(AF_INET6, name, &address) == 1;
}

bool lp_host_is_ok(const char *host, const char *machine, const char *allowed)
{
	char name[256], local[260], origin[256];
	const char *item;
	size_t length;

	if (!strip_port(host, name, sizeof(name)))
		return false;
	(void)snprintf(local, sizeof(local), "%s.local", machine);
	if (is_address(name) || strcasecmp(name, "localhost") == 0 ||
	    (*machine && (strcasecmp(name, machine) == 0 || strcasecmp(name, local) == 0)))
		return true;
	while (next_item(&allowed, &item, &length)) {
		(void)snprintf(origin, sizeof(origin), "%.*s", (int)length, item);
		if (host_of_origin(origin) && strcasecmp(host_of_origin(origin), host) == 0)
			return true;
	}
	return false;
}

static bool is_same(const char *a, const char *b, size_t length)
{
	unsigned char difference = 0;

	for (size_t i = 0; i < length; i++)
		difference |= (unsigned char)(a[i] ^ b[i]);
	return difference == 0;
}

bool lp_token_is_offered(const char *protocols, const char *token)
{
	const size_t prefix = strlen(LP_WEBSOCKET_TOKEN_PREFIX), wanted = strlen(token);
	const char *item;
	size_t length;

	while (next_item(&protocols, &item, &length)) {
		if (length == prefix + wanted &&
		    strncmp(item, LP_WEBSOCKET_TOKEN_PREFIX, prefix) == 0 &&
		    is_same(item + prefix, token, wanted))
			return true;
	}
	return false;
}
