/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The daemon's one event loop, on libuv: descriptors, timers, signals. All calls on the thread that
 * runs the loop. Callbacks may start, change and stop any watch and timer, their own included.
 *
 * Time is the system's, or simulated (base/clock.h). Simulated time stands still while anything is
 * left to do; lp_loop_advance() lets it go on, timer by timer, so that what the daemon does does
 * not depend on how fast the machine is.
 */
#ifndef LP_BASE_LOOP_H
#define LP_BASE_LOOP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/macros.h"

struct lp_loop;
struct lp_watch_handle;
struct uv_loop_s;

enum lp_watch_event {
	LP_READABLE = 1 << 0,
	LP_WRITABLE = 1 << 1,
	LP_HANGUP = 1 << 2, /* the other end has gone, or the descriptor reports an error */
};

/* One watched descriptor; embed it. It stays at its address while it is started. */
struct lp_watch {
	int fd; /* -1: not started */
	unsigned int events;
	/* `events`: what happened, of enum lp_watch_event; a hang-up may show as LP_READABLE. */
	void (*ready)(struct lp_watch *watch, unsigned int events);
	struct lp_watch_handle *handle; /* the loop's own */
};

/* One timer; embed it. It stays at its address while it is set. */
struct lp_timer {
	struct lp_loop *loop;
	void (*expired)(struct lp_timer *timer);
	bool is_set;
	int64_t due_ns, period_ns;
	struct lp_timer *next; /* the loop's own */
};

int lp_loop_create(struct lp_loop **loop);

/* Accepts NULL. Started watches are stopped; their descriptors must still be open. */
void lp_loop_destroy(struct lp_loop *loop);

/* Returns after lp_loop_stop(). */
void lp_loop_run(struct lp_loop *loop);
void lp_loop_stop(struct lp_loop *loop);

/* Handle what is ready now, without waiting. False: nothing was. */
bool lp_loop_run_once(struct lp_loop *loop);

/* For libraries that join a foreign libuv loop. */
struct uv_loop_s *lp_loop_uv(struct lp_loop *loop);

/* Embed it; it stays at its address until it is called. */
struct lp_loop_end {
	void (*ended)(struct lp_loop_end *end);
	struct lp_loop_end *next; /* the loop's own */
};

/* Call end->ended(end) when the loop is destroyed and everything in it is closed: for libraries
 * that need the loop to let go of it. */
void lp_loop_at_end(struct lp_loop *loop, struct lp_loop_end *end);

/* Call caught(context, signal) on the loop's thread. At most four signals. 0 or -errno. */
int lp_loop_on_signal(struct lp_loop *loop, int signal_number,
		      void (*caught)(void *context, int signal_number), void *context);

/*
 * Call ended(context, signal) on the loop's thread when the user, the session or the system ends
 * the program: SIGINT, SIGHUP, SIGTERM. SIGINT and SIGHUP that were ignored when the program
 * started (nohup, a shell's background job) stay ignored. 0 or -errno.
 */
int lp_loop_on_end(struct lp_loop *loop, void (*ended)(void *context, int signal_number),
		   void *context);

/*
 * Call watch->ready() whenever one of `events` happens on `fd`, which becomes non-blocking. The
 * caller owns `fd` and closes it after lp_watch_stop(). 0 or -errno: -EPERM for a file, which is
 * always ready.
 */
int lp_watch_start(struct lp_loop *loop, struct lp_watch *watch, int fd, unsigned int events,
		   void (*ready)(struct lp_watch *watch, unsigned int events));

/* Watch for other events. Does nothing when the watch is not started. */
void lp_watch_change(struct lp_watch *watch, unsigned int events);

/* Does nothing when the watch is not started. No event reaches it afterwards. */
void lp_watch_stop(struct lp_watch *watch);

/* Prepare a timer; it is not set. */
void lp_timer_init(struct lp_loop *loop, struct lp_timer *timer,
		   void (*expired)(struct lp_timer *timer));

/* Expire after `delay_ns`, then every `period_ns` (0: once). Replaces an earlier setting. Periods
 * that were missed expire once. */
void lp_timer_set(struct lp_timer *timer, int64_t delay_ns, int64_t period_ns);

/* Does nothing when the timer is not set, or was never prepared. */
void lp_timer_stop(struct lp_timer *timer);

/*
 * Simulated time only (lp_clock_is_simulated()): let all that is due until `t_ns` happen, in order,
 * then call reached(context) and stand still. A time in the past means now.
 */
void lp_loop_advance(struct lp_loop *loop, int64_t t_ns, void (*reached)(void *context),
		     void *context);

/* Work is under way outside of the loop: simulated time stands still until lp_loop_release(). */
void lp_loop_hold(struct lp_loop *loop);
void lp_loop_release(struct lp_loop *loop);

#endif
