/* SPDX-License-Identifier: Apache-2.0 */
/* How one thread asks another to end, and how that one sleeps meanwhile. */
#ifndef LP_BASE_STOP_H
#define LP_BASE_STOP_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

struct lp_stop {
	pthread_mutex_t lock;
	pthread_cond_t asked;
	bool is_asked;
};

void lp_stop_init(struct lp_stop *stop);

/* Any thread. Ends every present and future lp_stop_wait_until(). */
void lp_stop_ask(struct lp_stop *stop);

/* Sleep until `due_ns` (CLOCK_MONOTONIC), or until asked to stop. False: asked to stop. */
bool lp_stop_wait_until(struct lp_stop *stop, int64_t due_ns);

void lp_stop_finish(struct lp_stop *stop);

#endif
