/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Many descriptors and timers behind one: a back end shows the loop a single descriptor for its
 * whole life, whatever it opens and closes meanwhile. One thread; level-triggered (epoll).
 */
#ifndef LP_BASE_POLLER_H
#define LP_BASE_POLLER_H

#include <stddef.h>
#include <stdint.h>
#include <sys/epoll.h>

/* The structure that embeds a member, from the member's address. */
#define LP_CONTAINER_OF(pointer, type, member) \
	((type *)(void *)((char *)(pointer)-offsetof(type, member)))

struct lp_poller;

/* One watched descriptor; embed it. Stays at its address while it is added. */
struct lp_watch {
	int fd; /* -1: not watched */
	uint32_t events;
	/* `events`: EPOLL* that happened. May add and remove any watch, itself included. */
	void (*ready)(struct lp_watch *watch, uint32_t events);
};

/* One timer; embed it. */
struct lp_timer {
	struct lp_watch watch;
	void (*expired)(struct lp_timer *timer);
};

int lp_poller_create(struct lp_poller **poller);
int lp_poller_fd(const struct lp_poller *poller);

/* Watch `fd`, which the caller owns and closes after remove(). 0 or -errno. */
int lp_poller_add(struct lp_poller *poller, struct lp_watch *watch, int fd, uint32_t events,
		  void (*ready)(struct lp_watch *watch, uint32_t events));
void lp_poller_modify(struct lp_poller *poller, struct lp_watch *watch, uint32_t events);

/* Does nothing when the watch is not added. No event reaches it afterwards. */
void lp_poller_remove(struct lp_poller *poller, struct lp_watch *watch);

/* Handle what is ready, at most a few dozen events: what is left is ready at the next call. */
int lp_poller_dispatch(struct lp_poller *poller);

void lp_poller_destroy(struct lp_poller *poller); /* accepts NULL; watches must be removed */

/* 0 or -errno. */
int lp_timer_start(struct lp_timer *timer, struct lp_poller *poller,
		   void (*expired)(struct lp_timer *timer));

/* Expire once after `delay_ns`, then every `period_ns` (0: never again). delay 0 disarms. */
void lp_timer_set(struct lp_timer *timer, int64_t delay_ns, int64_t period_ns);

/* Does nothing when the timer was not started. */
void lp_timer_stop(struct lp_timer *timer, struct lp_poller *poller);

#endif
