/* SPDX-License-Identifier: Apache-2.0 */
/* An event loop in the hands of a test. */
#ifndef LP_LOOP_TEST_H
#define LP_LOOP_TEST_H

#include <poll.h>
#include <stdbool.h>
#include <uv.h>

#include "base/loop.h"

/* Wait until something is ready, at most `timeout_ms`, and handle it. False: nothing was. */
static inline bool loop_turn(struct lp_loop *loop, int timeout_ms)
{
	struct pollfd poll_fd = {.fd = uv_backend_fd(lp_loop_uv(loop)), .events = POLLIN};

	if (lp_loop_run_once(loop)) /* it also begins to watch what was started since */
		return true;
	(void)poll(&poll_fd, 1, timeout_ms);
	return lp_loop_run_once(loop);
}

#endif
