/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <stdlib.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include "base/clock.h"
#include "base/loop.h"
#include "loop_test.h"

static struct lp_loop *loop;

static int setup(void **state)
{
	(void)state;
	return lp_loop_create(&loop);
}

static int teardown(void **state)
{
	(void)state;
	lp_loop_destroy(loop);
	lp_loop_destroy(NULL);
	return 0;
}

/* ---------------------------------------------------------------- descriptors */

struct counted {
	struct lp_watch watch;
	struct counted *victim;
	unsigned int events;
	int calls;
};

static void count_call(struct lp_watch *watch, unsigned int events)
{
	struct counted *counted = LP_CONTAINER_OF(watch, struct counted, watch);

	counted->events = events;
	counted->calls++;
	if (counted->victim)
		lp_watch_stop(&counted->victim->watch);
}

static void test_a_watch_is_called_while_something_waits(void **state)
{
	struct counted a = {0}, b = {0};
	const int fd_a = eventfd(0, EFD_NONBLOCK), fd_b = eventfd(1, EFD_NONBLOCK);

	(void)state;
	assert_int_equal(lp_watch_start(loop, &a.watch, fd_a, LP_READABLE, count_call), 0);
	assert_int_equal(lp_watch_start(loop, &b.watch, fd_b, LP_READABLE, count_call), 0);
	lp_loop_run_once(loop);
	assert_int_equal(a.calls, 0);
	assert_int_equal(b.calls, 1);
	assert_int_equal(b.events, LP_READABLE);
	lp_watch_change(&b.watch, LP_READABLE | LP_WRITABLE);
	lp_loop_run_once(loop);
	assert_int_equal(b.events, LP_READABLE | LP_WRITABLE);
	lp_watch_change(&b.watch, 0);
	lp_loop_run_once(loop);
	assert_int_equal(b.calls, 2);
	lp_watch_stop(&a.watch);
	lp_watch_stop(&a.watch);
	assert_int_equal(a.watch.fd, -1);
	lp_watch_stop(&b.watch);
	lp_watch_change(&b.watch, LP_READABLE);
	lp_loop_run_once(loop);
	assert_int_equal(b.calls, 2);
	close(fd_a);
	close(fd_b);
}

static void test_a_stopped_watch_gets_no_event_of_the_same_turn(void **state)
{
	struct counted a = {0}, b = {0};
	const int fd_a = eventfd(1, EFD_NONBLOCK), fd_b = eventfd(1, EFD_NONBLOCK);

	(void)state;
	a.victim = &b;
	b.victim = &a;
	assert_int_equal(lp_watch_start(loop, &a.watch, fd_a, LP_READABLE, count_call), 0);
	assert_int_equal(lp_watch_start(loop, &b.watch, fd_b, LP_READABLE, count_call), 0);
	lp_loop_run_once(loop);
	assert_int_equal(a.calls + b.calls, 1);
	lp_watch_stop(&a.watch);
	lp_watch_stop(&b.watch);
	close(fd_a);
	close(fd_b);
}

static void test_a_reader_that_leaves_is_a_hangup_each_turn(void **state)
{
	struct counted writer = {0};
	int pipe_fds[2];

	(void)state;
	assert_int_equal(pipe(pipe_fds), 0);
	assert_int_equal(lp_watch_start(loop, &writer.watch, pipe_fds[1], LP_HANGUP, count_call),
			 0);
	lp_loop_run_once(loop);
	assert_int_equal(writer.calls, 0);
	close(pipe_fds[0]);
	for (int i = 1; i <= 3; i++) {
		assert_true(loop_turn(loop, 60000));
		assert_true(writer.calls >= i);
	}
	assert_int_equal(writer.events, LP_HANGUP);
	lp_watch_stop(&writer.watch);
	close(pipe_fds[1]);
}

static void test_bad_descriptor(void **state)
{
	struct counted bad = {0};
	char name[] = "/tmp/lp-loop-XXXXXX";
	const int file = mkstemp(name);

	(void)state;
	assert_int_equal(lp_watch_start(loop, &bad.watch, 12345, LP_READABLE, count_call), -EBADF);
	assert_int_equal(lp_watch_start(loop, &bad.watch, file, LP_READABLE, count_call), -EPERM);
	lp_watch_stop(&bad.watch);
	close(file);
	unlink(name);
}

static void test_what_is_left_is_closed(void **state)
{
	static struct counted forgotten;
	const int fd = eventfd(1, EFD_NONBLOCK);

	(void)state;
	assert_int_equal(lp_watch_start(loop, &forgotten.watch, fd, LP_READABLE, count_call), 0);
	lp_loop_destroy(loop); /* the sanitizer finds what it leaves behind */
	assert_int_equal(forgotten.watch.fd, -1);
	close(fd);
	assert_int_equal(lp_loop_create(&loop), 0);
}

/* ---------------------------------------------------------------- timers and signals */

struct counted_timer {
	struct lp_timer timer;
	int calls;
	int64_t t_ns;
};

static void count_expiry(struct lp_timer *timer)
{
	struct counted_timer *counted = LP_CONTAINER_OF(timer, struct counted_timer, timer);

	counted->calls++;
	counted->t_ns = lp_clock_ns();
}

static int ends;
static bool watch_was_closed;
static struct lp_watch left_over;

static void on_loop_end(struct lp_loop_end *end)
{
	assert_non_null(end->ended);
	watch_was_closed = !left_over.handle;
	ends++;
}

/* A library that lives in the loop lets go of it when nothing of it is left. */
static void test_what_needs_the_loop_to_its_end_is_called_then(void **state)
{
	struct lp_loop_end first = {.ended = on_loop_end}, second = {.ended = on_loop_end};
	int fds[2];

	(void)state;
	ends = 0;
	assert_int_equal(pipe(fds), 0);
	assert_int_equal(lp_watch_start(loop, &left_over, fds[0], LP_READABLE, NULL), 0);
	lp_loop_at_end(loop, &first);
	lp_loop_at_end(loop, &second);
	(void)lp_loop_run_once(loop);
	assert_int_equal(ends, 0);
	lp_loop_destroy(loop);
	loop = NULL;
	assert_int_equal(ends, 2);
	assert_true(watch_was_closed);
	close(fds[0]);
	close(fds[1]);
}

static void test_timer_once_periodic_and_stopped(void **state)
{
	struct counted_timer timer = {0};
	const int64_t start_ns = lp_clock_ns();

	(void)state;
	lp_timer_stop(&timer.timer); /* never prepared: nothing happens */
	lp_timer_init(loop, &timer.timer, count_expiry);
	assert_false(loop_turn(loop, 0));
	lp_timer_set(&timer.timer, 20 * LP_NS_PER_MS, 0);
	while (timer.calls == 0)
		assert_true(loop_turn(loop, 60000));
	assert_true(timer.t_ns - start_ns >= 20 * LP_NS_PER_MS);
	assert_false(timer.timer.is_set);
	assert_false(loop_turn(loop, 50));
	assert_int_equal(timer.calls, 1);

	lp_timer_set(&timer.timer, LP_NS_PER_MS, LP_NS_PER_MS);
	while (timer.calls < 4)
		assert_true(loop_turn(loop, 60000));
	lp_timer_stop(&timer.timer);
	lp_timer_stop(&timer.timer);
	assert_false(loop_turn(loop, 10));
	assert_int_equal(timer.calls, 4);
}

static void test_the_next_timer_is_first_whatever_the_order_of_setting(void **state)
{
	struct counted_timer late = {0}, soon = {0};

	(void)state;
	lp_timer_init(loop, &late.timer, count_expiry);
	lp_timer_init(loop, &soon.timer, count_expiry);
	lp_timer_set(&late.timer, 3600 * LP_NS_PER_S, 0);
	lp_timer_set(&soon.timer, LP_NS_PER_MS, 0);
	while (soon.calls == 0)
		assert_true(loop_turn(loop, 60000));
	assert_int_equal(late.calls, 0);
	lp_timer_stop(&late.timer);
}

static int caught_signal;

static void on_signal(void *context, int number)
{
	assert_ptr_equal(context, &caught_signal);
	caught_signal = number;
	lp_loop_stop(loop);
}

static void raise_signal(struct lp_timer *timer)
{
	(void)timer;
	raise(SIGUSR1);
}

static void test_a_signal_ends_the_run(void **state)
{
	struct lp_timer timer = {0};

	(void)state;
	assert_int_equal(lp_loop_on_signal(loop, SIGUSR1, on_signal, &caught_signal), 0);
	lp_timer_init(loop, &timer, raise_signal);
	lp_timer_set(&timer, 0, 0);
	lp_loop_run(loop);
	assert_int_equal(caught_signal, SIGUSR1);
}

/* ---------------------------------------------------------------- simulated time */

#define START_NS (1000 * LP_NS_PER_S)

static struct {
	struct counted_timer every_s;
	int64_t reached_ns;
	int expiries_when_reached;
	struct lp_watch work;
	bool released;
} simulated;

static void on_reached(void *context)
{
	assert_ptr_equal(context, &simulated);
	simulated.reached_ns = lp_clock_ns();
	simulated.expiries_when_reached = simulated.every_s.calls;
	lp_loop_stop(loop);
}

static void on_work_done(struct lp_watch *watch, unsigned int events)
{
	eventfd_t value;

	(void)events;
	assert_int_equal(eventfd_read(watch->fd, &value), 0);
	assert_int_equal(lp_clock_ns(), START_NS); /* it stood still */
	assert_int_equal(simulated.every_s.calls, 0);
	simulated.released = true;
	lp_loop_release(loop);
}

/* From here on time is simulated in this process: this test is the last one. */
static void test_simulated_time_goes_from_timer_to_timer(void **state)
{
	const int fd = eventfd(1, EFD_NONBLOCK);

	(void)state;
	lp_clock_simulate(START_NS);
	assert_true(lp_clock_is_simulated());
	lp_timer_init(loop, &simulated.every_s.timer, count_expiry);
	lp_timer_set(&simulated.every_s.timer, LP_NS_PER_S, LP_NS_PER_S);
	assert_int_equal(lp_watch_start(loop, &simulated.work, fd, LP_READABLE, on_work_done), 0);
	lp_loop_hold(loop);
	lp_loop_advance(loop, START_NS + 3600 * LP_NS_PER_S + 1, on_reached, &simulated);
	lp_loop_run(loop);
	assert_true(simulated.released);
	assert_int_equal(simulated.reached_ns, START_NS + 3600 * LP_NS_PER_S + 1);
	assert_int_equal(simulated.expiries_when_reached, 3600);
	assert_int_equal(simulated.every_s.t_ns, START_NS + 3600 * LP_NS_PER_S);
	assert_true(lp_clock_unix_ns(START_NS + 5) - lp_clock_unix_ns(START_NS) == 5);
	lp_timer_stop(&simulated.every_s.timer);
	lp_watch_stop(&simulated.work);
	close(fd);
}

#define LOOP_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		LOOP_TEST(test_a_watch_is_called_while_something_waits),
		LOOP_TEST(test_a_stopped_watch_gets_no_event_of_the_same_turn),
		LOOP_TEST(test_a_reader_that_leaves_is_a_hangup_each_turn),
		LOOP_TEST(test_bad_descriptor),
		LOOP_TEST(test_what_is_left_is_closed),
		LOOP_TEST(test_what_needs_the_loop_to_its_end_is_called_then),
		LOOP_TEST(test_timer_once_periodic_and_stopped),
		LOOP_TEST(test_the_next_timer_is_first_whatever_the_order_of_setting),
		LOOP_TEST(test_a_signal_ends_the_run),
		LOOP_TEST(test_simulated_time_goes_from_timer_to_timer),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
