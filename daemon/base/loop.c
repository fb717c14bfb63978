/* SPDX-License-Identifier: Apache-2.0 */
#include "base/loop.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/timerfd.h>
#include <unistd.h>
#include <uv.h>

#include "base/clock.h"

#define MAX_SIGNALS 4

/* libuv's side of a watch: outlives it until libuv has closed the handle. libuv's errors are
 * negative errno, as ours. */
struct lp_watch_handle {
	uv_poll_t poll;
	struct lp_loop *loop;
	struct lp_watch *watch; /* NULL: stopped */
};

struct signal_handle {
	uv_signal_t signal;
	struct lp_loop *loop;
	void (*caught)(void *context, int signal_number);
	void *context;
};

struct lp_loop {
	uv_loop_t uv;
	bool stopped;
	struct lp_timer *timers; /* those that are set, the next one first */
	int timer_fd; /* readable when the first timer is due; unused in simulated time */
	struct lp_watch timer_watch;
	struct lp_loop_end *ends;
	int signal_count;
	struct signal_handle signals[MAX_SIGNALS];

	/* Of simulated time. */
	bool happened; /* a callback has run: more may follow from it */
	int holds;
	int64_t goal_ns;
	void (*reached)(void *context); /* NULL: told, or no goal */
	void *reached_context;
};

/* ---------------------------------------------------------------- descriptors */

static void on_closed(uv_handle_t *handle)
{
	free(handle->data);
}

static void on_poll(uv_poll_t *poll, int status, int uv_events)
{
	struct lp_watch_handle *handle = poll->data;
	struct lp_watch *watch = handle->watch;
	unsigned int events = 0;

	if (status < 0 || uv_events & UV_DISCONNECT)
		events |= LP_HANGUP;
	if (uv_events & UV_READABLE)
		events |= LP_READABLE;
	if (uv_events & UV_WRITABLE)
		events |= LP_WRITABLE;
	handle->loop->happened = true;
	watch->ready(watch, events);
	if (status < 0 && handle->watch) { /* libuv has stopped it because of the error */
		events = watch->events;
		watch->events = 0;
		lp_watch_change(watch, events);
	}
}

static int uv_events_of(unsigned int events)
{
	int uv_events = 0;

	if (events & LP_READABLE)
		uv_events |= UV_READABLE;
	if (events & LP_WRITABLE)
		uv_events |= UV_WRITABLE;
	return events == LP_HANGUP ? UV_DISCONNECT : uv_events;
}

int lp_watch_start(struct lp_loop *loop, struct lp_watch *watch, int fd, unsigned int events,
		   void (*ready)(struct lp_watch *watch, unsigned int events))
{
	struct lp_watch_handle *handle = calloc(1, sizeof(*handle));
	int ret;

	if (!handle)
		return -ENOMEM;
	handle->poll.data = handle;
	handle->loop = loop;
	handle->watch = watch;
	ret = uv_poll_init(&loop->uv, &handle->poll, fd);
	if (ret < 0) {
		free(handle);
		return ret;
	}
	*watch = (struct lp_watch){.fd = fd, .ready = ready, .handle = handle};
	lp_watch_change(watch, events);
	return 0;
}

void lp_watch_change(struct lp_watch *watch, unsigned int events)
{
	if (!watch->handle || watch->events == events)
		return;
	watch->events = events;
	/* Neither can fail: the descriptor is known to be pollable. */
	if (events)
		(void)uv_poll_start(&watch->handle->poll, uv_events_of(events), on_poll);
	else
		(void)uv_poll_stop(&watch->handle->poll);
}

void lp_watch_stop(struct lp_watch *watch)
{
	struct lp_watch_handle *handle = watch->handle;

	if (!handle)
		return;
	handle->watch = NULL;
	watch->handle = NULL;
	watch->fd = -1;
	uv_close((uv_handle_t *)&handle->poll, on_closed);
}

/* ---------------------------------------------------------------- timers */

/* Have the loop woken when the first timer is due. */
static void arm(struct lp_loop *loop)
{
	const int64_t due_ns = loop->timers ? loop->timers->due_ns : 0; /* 0 disarms */
	const struct itimerspec setting = {
		.it_value = {.tv_sec = due_ns / LP_NS_PER_S, .tv_nsec = due_ns % LP_NS_PER_S}};

	if (!lp_clock_is_simulated()) /* fails for bad arguments only */
		(void)timerfd_settime(loop->timer_fd, TFD_TIMER_ABSTIME, &setting, NULL);
}

static void insert(struct lp_timer *timer)
{
	struct lp_timer **at = &timer->loop->timers;

	while (*at && (*at)->due_ns <= timer->due_ns)
		at = &(*at)->next;
	timer->next = *at;
	timer->is_set = true;
	*at = timer;
}

static void take_out(struct lp_timer *timer)
{
	struct lp_timer **at = &timer->loop->timers;

	while (*at != timer)
		at = &(*at)->next;
	*at = timer->next;
	timer->is_set = false;
}

/* Let the timers expire that are due; the loop is then armed for the next one. */
static void run_due(struct lp_loop *loop)
{
	const int64_t now_ns = lp_clock_ns();
	struct lp_timer *timer;

	while ((timer = loop->timers) != NULL && timer->due_ns <= now_ns) {
		take_out(timer);
		if (timer->period_ns > 0) {
			timer->due_ns += timer->period_ns;
			if (timer->due_ns <= now_ns) /* late: no burst to catch up */
				timer->due_ns = now_ns + timer->period_ns;
			insert(timer);
		}
		timer->expired(timer);
	}
	arm(loop);
}

static void on_timer_fd(struct lp_watch *watch, unsigned int events)
{
	struct lp_loop *loop = LP_CONTAINER_OF(watch, struct lp_loop, timer_watch);
	uint64_t expirations;

	(void)events;
	/* Nothing to read when it was set anew after it expired: then nothing is due. */
	(void)!read(watch->fd, &expirations, sizeof(expirations));
	run_due(loop);
}

void lp_timer_init(struct lp_loop *loop, struct lp_timer *timer,
		   void (*expired)(struct lp_timer *timer))
{
	*timer = (struct lp_timer){.loop = loop, .expired = expired};
}

void lp_timer_set(struct lp_timer *timer, int64_t delay_ns, int64_t period_ns)
{
	struct lp_loop *loop = timer->loop;
	const struct lp_timer *first = loop->timers;
	const bool was_first = timer == first;

	if (timer->is_set)
		take_out(timer);
	timer->due_ns = lp_clock_ns() + delay_ns;
	timer->period_ns = period_ns;
	insert(timer);
	if (was_first || loop->timers != first)
		arm(loop);
}

void lp_timer_stop(struct lp_timer *timer)
{
	if (!timer->is_set)
		return;
	take_out(timer);
	arm(timer->loop);
}

void lp_loop_at_end(struct lp_loop *loop, struct lp_loop_end *end)
{
	end->next = loop->ends;
	loop->ends = end;
}

/* ---------------------------------------------------------------- signals */

static void on_signal(uv_signal_t *signal, int signal_number)
{
	struct signal_handle *handle = signal->data;

	handle->loop->happened = true;
	handle->caught(handle->context, signal_number);
}

int lp_loop_on_signal(struct lp_loop *loop, int signal_number,
		      void (*caught)(void *context, int signal_number), void *context)
{
	struct signal_handle *handle = &loop->signals[loop->signal_count];
	int ret;

	if (loop->signal_count == MAX_SIGNALS)
		return -ENOSPC;
	*handle = (struct signal_handle){.loop = loop, .caught = caught, .context = context};
	handle->signal.data = handle;
	ret = uv_signal_init(&loop->uv, &handle->signal);
	if (ret < 0)
		return ret;
	loop->signal_count++;
	return uv_signal_start(&handle->signal, on_signal, signal_number);
}

static bool is_ignored(int signal_number)
{
	struct sigaction action;

	return sigaction(signal_number, NULL, &action) == 0 && action.sa_handler == SIG_IGN;
}

int lp_loop_on_end(struct lp_loop *loop, void (*ended)(void *context, int signal_number),
		   void *context)
{
	int ret = lp_loop_on_signal(loop, SIGTERM, ended, context);

	if (ret == 0 && !is_ignored(SIGINT))
		ret = lp_loop_on_signal(loop, SIGINT, ended, context);
	if (ret == 0 && !is_ignored(SIGHUP))
		ret = lp_loop_on_signal(loop, SIGHUP, ended, context);
	return ret;
}

/* ---------------------------------------------------------------- simulated time */

void lp_loop_advance(struct lp_loop *loop, int64_t t_ns, void (*reached)(void *context),
		     void *context)
{
	loop->goal_ns = t_ns;
	loop->reached = reached;
	loop->reached_context = context;
}

void lp_loop_hold(struct lp_loop *loop)
{
	loop->holds++;
}

void lp_loop_release(struct lp_loop *loop)
{
	loop->holds--;
}

/* Nothing is left to do at this time: go on to the next timer or to the goal. False: at the goal.
 */
static bool step_time(struct lp_loop *loop)
{
	void (*reached)(void *context) = loop->reached;
	const int64_t now_ns = lp_clock_ns();
	int64_t next_ns = loop->goal_ns;

	if (!reached)
		return false;
	if (loop->timers && loop->timers->due_ns <= next_ns)
		next_ns = loop->timers->due_ns;
	if (next_ns > now_ns)
		lp_clock_simulate(next_ns);
	if (loop->timers && loop->timers->due_ns <= lp_clock_ns()) {
		run_due(loop);
	} else {
		loop->reached = NULL;
		reached(loop->reached_context);
	}
	return true;
}

static void run_simulated(struct lp_loop *loop)
{
	while (!loop->stopped) {
		if (lp_loop_run_once(loop) || loop->stopped)
			continue;
		if (loop->holds > 0 || !step_time(loop))
			(void)uv_run(&loop->uv, UV_RUN_ONCE); /* wait for something to happen */
	}
}

/* ---------------------------------------------------------------- life */

int lp_loop_create(struct lp_loop **loop)
{
	struct lp_loop *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	ret = uv_loop_init(&self->uv);
	if (ret < 0) {
		free(self);
		return ret;
	}
	self->timer_fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
	ret = self->timer_fd < 0 ? -errno
				 : lp_watch_start(self, &self->timer_watch, self->timer_fd,
						  LP_READABLE, on_timer_fd);
	if (ret < 0) {
		lp_loop_destroy(self);
		return ret;
	}
	*loop = self;
	return 0;
}

void lp_loop_run(struct lp_loop *loop)
{
	if (lp_clock_is_simulated())
		run_simulated(loop);
	else if (!loop->stopped)
		(void)uv_run(&loop->uv, UV_RUN_DEFAULT);
}

bool lp_loop_run_once(struct lp_loop *loop)
{
	loop->happened = false;
	(void)uv_run(&loop->uv, UV_RUN_NOWAIT);
	return loop->happened;
}

void lp_loop_stop(struct lp_loop *loop)
{
	loop->stopped = true;
	uv_stop(&loop->uv);
}

struct uv_loop_s *lp_loop_uv(struct lp_loop *loop)
{
	return &loop->uv;
}

/* Watches that nobody has stopped, and libraries' own handles. */
static void close_handle(uv_handle_t *handle, void *context)
{
	struct lp_loop *loop = context;

	if (uv_is_closing(handle))
		return;
	for (int i = 0; i < loop->signal_count; i++) {
		if (handle == (uv_handle_t *)&loop->signals[i].signal) {
			uv_close(handle, NULL);
			return;
		}
	}
	if (handle->type == UV_POLL && handle->data == handle) /* ours, not a library's */
		lp_watch_stop(((struct lp_watch_handle *)handle->data)->watch);
}

void lp_loop_destroy(struct lp_loop *loop)
{
	if (!loop)
		return;
	uv_walk(&loop->uv, close_handle, loop);
	while (uv_run(&loop->uv, UV_RUN_DEFAULT) != 0) { /* until all are closed */
	}
	while (loop->ends) {
		struct lp_loop_end *end = loop->ends;

		loop->ends = end->next;
		end->ended(end);
	}
	(void)uv_loop_close(&loop->uv);
	if (loop->timer_fd >= 0)
		close(loop->timer_fd);
	free(loop);
}
