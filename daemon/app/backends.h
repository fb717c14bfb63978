/* SPDX-License-Identifier: Apache-2.0 */
/* The one registry of back ends: from a URI to a source, wheel, ring, orientation sensor or
 * publisher. */
#ifndef LP_APP_BACKENDS_H
#define LP_APP_BACKENDS_H

#include <stddef.h>
#include <stdio.h>

struct lp_backend;
struct lp_orientation;
struct lp_orientation_host;
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
int lp_orientation_open(const char *uri, const struct lp_orientation_host *host,
			struct lp_orientation **orientation);
int lp_publisher_open(const char *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher);

/* The back ends' part of --help: a line for each. */
void lp_backends_list(FILE *out);

/* --help-backends: all that they say of themselves, and the keys of their URIs. */
void lp_backends_help(FILE *out);

/* One line per build option, WITH_X=0 or WITH_X=1. */
void lp_backends_version(FILE *out);

/* The back ends of one role. */
struct lp_backend_role {
	const char *option; /* of the command line: "source" */
	const char *title;  /* of its part of the help */
	int count;
	const struct lp_backend *(*at)(int i); /* i < count */
};

/* All roles; ends with NULL. */
extern const struct lp_backend_role *const lp_backend_roles[];

/* Which back end of the role has the URI's scheme. -EPROTONOSUPPORT: as above. */
int lp_backend_find(const struct lp_backend_role *role, const struct lp_uri *uri);

#endif
