/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A thread for calls that may block for as long as a bus likes, and a pair of sockets to talk with
 * it, one packet a message. The loop never waits for the thread: when it closes its end, the thread
 * works off what was sent and ends by itself.
 */
#ifndef LP_LINK_BUS_THREAD_H
#define LP_LINK_BUS_THREAD_H

#include <stdbool.h>

struct lp_bus_thread;

struct lp_bus_job {
	void *context;
	/* The thread. `fd` is its end of the pair; returns when that has been hung up. */
	void (*run)(void *context, int fd);
	/* The thread's last call: frees the context. */
	void (*finish)(void *context);
};

/* 0, and the context is the thread's; or -errno, and it is still the caller's. Loop thread, as all
 * calls here. */
int lp_bus_thread_start(const struct lp_bus_job *job, struct lp_bus_thread **thread);

/* The loop's end of the pair; -1 after lp_bus_thread_end(). */
int lp_bus_thread_fd(const struct lp_bus_thread *thread);

/* Close the loop's end. Returns at once, whatever the thread is doing. */
void lp_bus_thread_end(struct lp_bus_thread *thread);

bool lp_bus_thread_has_ended(struct lp_bus_thread *thread);

/* Accepts NULL. Ends the thread and waits for it, at most `timeout_ms`: a thread that hangs longer
 * is left to itself. */
void lp_bus_thread_destroy(struct lp_bus_thread *thread, int timeout_ms);

#endif
