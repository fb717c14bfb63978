/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon as a whole: source, worker, hub and publishers on one loop. */
#ifndef LP_APP_DAEMON_H
#define LP_APP_DAEMON_H

struct lp_options;

/* Exit codes: part of the command line's contract. */
enum lp_exit {
	LP_EXIT_OK = 0,
	LP_EXIT_FAILURE = 1, /* the device, a socket, or no estimate (--once) */
	LP_EXIT_USAGE = 2,   /* command line or configuration */
};

/* Runs until a signal, the end of a `once` set, or a fault that ends it. Returns enum lp_exit. */
int lp_daemon_run(const struct lp_options *options);

/* Create everything and start nothing: says what is wrong. Returns enum lp_exit. */
int lp_daemon_check(const struct lp_options *options);

#endif
