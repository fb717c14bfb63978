/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Back ends are chosen by URI: scheme:rest?key=value&key=value. The rest, keys and values may hold
 * %XX; a '?' in a path is written %3F.
 */
#ifndef LP_BASE_URI_H
#define LP_BASE_URI_H

#include <stdbool.h>
#include <stddef.h>

#define LP_URI_MAX_BYTES 2048
#define LP_URI_MAX_KEYS 32

struct lp_params;

struct lp_uri_key {
	const char *name, *value; /* decoded */
};

/* Points into itself: not to be copied. */
struct lp_uri {
	char text[LP_URI_MAX_BYTES]; /* as it was written; names the object in messages */
	const char *scheme;
	const char *rest;  /* decoded */
	const char *query; /* as written, without '?'; "" when there is none */
	int key_count;
	struct lp_uri_key keys[LP_URI_MAX_KEYS];
	char storage[LP_URI_MAX_BYTES];
};

/* -EINVAL, logged: no scheme, bad %XX, a key without '=', too long. `*uri` is valid after 0 only.
 */
int lp_uri_parse(struct lp_uri *uri, const char *text);

/* Every key of the query into `*fields` (base/param.h); `params` NULL: no key is known. -EINVAL,
 * logged. */
int lp_uri_set(const struct lp_uri *uri, const struct lp_params *params, void *fields);

/* The same, after the defaults. */
int lp_uri_read(const struct lp_uri *uri, const struct lp_params *params, void *fields);

/* Whether the query has this key. */
bool lp_uri_has(const struct lp_uri *uri, const char *name);

#endif
