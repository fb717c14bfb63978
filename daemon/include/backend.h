/* SPDX-License-Identifier: Apache-2.0 */
/* What a back end says of itself: every table of ops begins with it. */
#ifndef LP_BACKEND_H
#define LP_BACKEND_H

struct lp_params;

struct lp_backend {
	const char *scheme; /* of its URIs, before the colon */
	const char *form;   /* what follows the colon, in capitals: "HOST:PORT"; "": nothing */
	/* The first line says what it is, alone in --help; further ones are for --help-backends. */
	const char *help;
	const struct lp_params *params; /* the query of its URIs; NULL: none */
	/* The build option that brings it back. NULL: it is in this build. */
	const char *left_out;
};

#endif
