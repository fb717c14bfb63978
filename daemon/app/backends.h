/* SPDX-License-Identifier: Apache-2.0 */
/* The one registry of back ends: from a URI to a source or a publisher. */
#ifndef LP_APP_BACKENDS_H
#define LP_APP_BACKENDS_H

#include <stdio.h>

struct lp_publisher;
struct lp_publisher_host;
struct lp_ring;
struct lp_ring_host;
struct lp_rotator;
struct lp_rotator_host;
struct lp_source;
struct lp_source_host;
struct lp_uri;

/*
 * -EINVAL: the URI cannot be read, or a key in it is wrong. -EPROTONOSUPPORT: no back end has this
 * scheme (the known ones are listed), or it was left out of this build (the option is named).
 * Logged.
 */
int lp_source_open(const char *uri, const struct lp_source_host *host, struct lp_source **source);
int lp_rotator_open(const char *uri, const struct lp_rotator_host *host,
		    struct lp_rotator **rotator);
int lp_ring_open(const char *uri, const struct lp_ring_host *host, struct lp_ring **ring);
int lp_publisher_open(const char *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher);

/* The back ends' part of --help. */
void lp_backends_help(FILE *out);

/* One line per build option, WITH_X=0 or WITH_X=1. */
void lp_backends_version(FILE *out);

/* A row of the registry. `ops` is NULL where the build left the back end out: `option` brings it
 * back. */
struct lp_backend {
	const char *scheme;
	const char *option; /* NULL: always built */
	const void *ops;
};

/* The ops for a URI, by its scheme; the table ends with a row without scheme. NULL: logged. */
const void *lp_backend_find(const struct lp_backend *table, const char *role,
			    const struct lp_uri *uri);

#endif
