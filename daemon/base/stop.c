/* SPDX-License-Identifier: Apache-2.0 */
#include "base/stop.h"

#include <errno.h>
#include <time.h>

#include "base/clock.h"

void lp_stop_init(struct lp_stop *stop)
{
	pthread_condattr_t attributes;

	stop->is_asked = false;
	pthread_mutex_init(&stop->lock, NULL);
	pthread_condattr_init(&attributes);
	pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
	pthread_cond_init(&stop->asked, &attributes);
	pthread_condattr_destroy(&attributes);
}

void lp_stop_ask(struct lp_stop *stop)
{
	pthread_mutex_lock(&stop->lock);
	stop->is_asked = true;
	pthread_cond_broadcast(&stop->asked);
	pthread_mutex_unlock(&stop->lock);
}

bool lp_stop_wait_until(struct lp_stop *stop, int64_t due_ns)
{
	const struct timespec due = {.tv_sec = due_ns / LP_NS_PER_S,
				     .tv_nsec = due_ns % LP_NS_PER_S};
	bool is_asked;
	int ret = 0;

	pthread_mutex_lock(&stop->lock);
	while (!stop->is_asked && ret != ETIMEDOUT)
		ret = pthread_cond_timedwait(&stop->asked, &stop->lock, &due);
	is_asked = stop->is_asked;
	pthread_mutex_unlock(&stop->lock);
	return !is_asked;
}

void lp_stop_finish(struct lp_stop *stop)
{
	pthread_cond_destroy(&stop->asked);
	pthread_mutex_destroy(&stop->lock);
}
