/* SPDX-License-Identifier: Apache-2.0 */
#include "base/poller.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "base/clock.h"

#define BATCH 32

struct lp_poller {
	int epoll_fd;
	int count; /* of the batch that dispatch() is at; 0 outside */
	struct epoll_event batch[BATCH];
};

int lp_poller_create(struct lp_poller **poller)
{
	struct lp_poller *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	if (self->epoll_fd < 0) {
		ret = -errno;
		free(self);
		return ret;
	}
	*poller = self;
	return 0;
}

int lp_poller_fd(const struct lp_poller *poller)
{
	return poller->epoll_fd;
}

int lp_poller_add(struct lp_poller *poller, struct lp_watch *watch, int fd, uint32_t events,
		  void (*ready)(struct lp_watch *watch, uint32_t events))
{
	struct epoll_event event = {.events = events, .data.ptr = watch};

	if (epoll_ctl(poller->epoll_fd, EPOLL_CTL_ADD, fd, &event) < 0)
		return -errno;
	*watch = (struct lp_watch){.fd = fd, .events = events, .ready = ready};
	return 0;
}

void lp_poller_modify(struct lp_poller *poller, struct lp_watch *watch, uint32_t events)
{
	struct epoll_event event = {.events = events, .data.ptr = watch};

	if (watch->fd < 0 || watch->events == events)
		return;
	/* Cannot fail: the descriptor is watched, and changing it takes no memory. */
	(void)epoll_ctl(poller->epoll_fd, EPOLL_CTL_MOD, watch->fd, &event);
	watch->events = events;
}

void lp_poller_remove(struct lp_poller *poller, struct lp_watch *watch)
{
	if (watch->fd < 0 || !watch->ready)
		return;
	(void)epoll_ctl(poller->epoll_fd, EPOLL_CTL_DEL, watch->fd, NULL);
	watch->fd = -1;
	/* Events of this batch that are still to come must not find it. */
	for (int i = 0; i < poller->count; i++) {
		if (poller->batch[i].data.ptr == watch)
			poller->batch[i].data.ptr = NULL;
	}
}

int lp_poller_dispatch(struct lp_poller *poller)
{
	const int count = epoll_wait(poller->epoll_fd, poller->batch, BATCH, 0);

	if (count < 0)
		return errno == EINTR ? 0 : -errno;
	poller->count = count;
	for (int i = 0; i < count; i++) {
		struct lp_watch *watch = poller->batch[i].data.ptr;

		if (watch)
			watch->ready(watch, poller->batch[i].events);
	}
	poller->count = 0;
	return 0;
}

void lp_poller_destroy(struct lp_poller *poller)
{
	if (!poller)
		return;
	close(poller->epoll_fd);
	free(poller);
}

static void timer_ready(struct lp_watch *watch, uint32_t events)
{
	struct lp_timer *timer = LP_CONTAINER_OF(watch, struct lp_timer, watch);
	uint64_t expirations;

	(void)events;
	/* Nothing to read: it was set anew after it expired. */
	if (read(watch->fd, &expirations, sizeof(expirations)) == (ssize_t)sizeof(expirations))
		timer->expired(timer);
}

int lp_timer_start(struct lp_timer *timer, struct lp_poller *poller,
		   void (*expired)(struct lp_timer *timer))
{
	const int fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
	int ret;

	if (fd < 0)
		return -errno;
	ret = lp_poller_add(poller, &timer->watch, fd, EPOLLIN, timer_ready);
	if (ret < 0) {
		close(fd);
		return ret;
	}
	timer->expired = expired;
	return 0;
}

static struct timespec to_timespec(int64_t ns)
{
	return (struct timespec){.tv_sec = ns / LP_NS_PER_S, .tv_nsec = ns % LP_NS_PER_S};
}

void lp_timer_set(struct lp_timer *timer, int64_t delay_ns, int64_t period_ns)
{
	const struct itimerspec setting = {.it_value = to_timespec(delay_ns),
					   .it_interval = to_timespec(period_ns)};

	(void)timerfd_settime(timer->watch.fd, 0, &setting,
			      NULL); /* fails for bad arguments only */
}

void lp_timer_stop(struct lp_timer *timer, struct lp_poller *poller)
{
	const int fd = timer->watch.fd;

	if (!timer->watch.ready || fd < 0)
		return;
	lp_poller_remove(poller, &timer->watch);
	close(fd);
}
