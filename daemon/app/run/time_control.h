/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Simulated time (--simulated-time=PATH), for tests: a test listens on a Unix socket, the daemon
 * connects and takes its time from there. Each line holds a time in nanoseconds. The daemon lets
 * everything happen that is due until then, with the work of its threads between, and answers with
 * the same line when nothing is left to do. Its clock stands still in between, so that no result
 * depends on how fast or busy the machine is. It begins at LP_TIME_CONTROL_START_NS.
 *
 * Threads of drivers that wait by themselves (file:, v4l2:, libcamera:) go on in real time.
 */
#ifndef LP_APP_RUN_TIME_CONTROL_H
#define LP_APP_RUN_TIME_CONTROL_H

#include "base/clock.h"

#define LP_TIME_CONTROL_START_NS (1000 * LP_NS_PER_S)

struct lp_loop;
struct lp_time_control;

/* Connects, and makes time simulated from now on. When the test closes the connection the daemon's
 * time stands still for ever. 0 or -errno, logged. */
int lp_time_control_create(const char *path, struct lp_loop *loop,
			   struct lp_time_control **control);
void lp_time_control_destroy(struct lp_time_control *control); /* accepts NULL */

#endif
