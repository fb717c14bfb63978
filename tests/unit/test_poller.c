/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <poll.h>
#include <stdbool.h>
#include <sys/eventfd.h>

#include "base/clock.h"
#include "base/poller.h"

static struct lp_poller *poller;

static int setup(void **state)
{
	(void)state;
	return lp_poller_create(&poller);
}

static int teardown(void **state)
{
	(void)state;
	lp_poller_destroy(poller);
	return 0;
}

static bool readable(int timeout_ms)
{
	struct pollfd poll_fd = {.fd = lp_poller_fd(poller), .events = POLLIN};

	return poll(&poll_fd, 1, timeout_ms) == 1;
}

struct counted {
	struct lp_watch watch;
	struct counted *victim;
	int calls;
};

static void count_call(struct lp_watch *watch, uint32_t events)
{
	struct counted *counted = LP_CONTAINER_OF(watch, struct counted, watch);

	assert_true(events & EPOLLIN);
	counted->calls++;
	if (counted->victim)
		lp_poller_remove(poller, &counted->victim->watch);
}

static void test_one_descriptor_stands_for_all(void **state)
{
	struct counted a = {0}, b = {0};
	const int fd_a = eventfd(0, EFD_NONBLOCK), fd_b = eventfd(1, EFD_NONBLOCK);

	(void)state;
	assert_false(readable(0));
	assert_int_equal(lp_poller_add(poller, &a.watch, fd_a, EPOLLIN, count_call), 0);
	assert_false(readable(0));
	assert_int_equal(lp_poller_add(poller, &b.watch, fd_b, EPOLLIN, count_call), 0);
	assert_true(readable(0));
	assert_int_equal(lp_poller_dispatch(poller), 0);
	assert_int_equal(a.calls, 0);
	assert_int_equal(b.calls, 1);
	lp_poller_modify(poller, &b.watch, 0);
	assert_false(readable(0));
	lp_poller_modify(poller, &b.watch, EPOLLIN);
	assert_true(readable(0));
	lp_poller_remove(poller, &a.watch);
	lp_poller_remove(poller, &b.watch);
	lp_poller_remove(poller, &b.watch);
	assert_false(readable(0));
	close(fd_a);
	close(fd_b);
}

static void test_a_removed_watch_gets_no_event_of_the_same_batch(void **state)
{
	struct counted a = {0}, b = {0};
	const int fd_a = eventfd(1, EFD_NONBLOCK), fd_b = eventfd(1, EFD_NONBLOCK);

	(void)state;
	a.victim = &b;
	b.victim = &a;
	assert_int_equal(lp_poller_add(poller, &a.watch, fd_a, EPOLLIN, count_call), 0);
	assert_int_equal(lp_poller_add(poller, &b.watch, fd_b, EPOLLIN, count_call), 0);
	assert_int_equal(lp_poller_dispatch(poller), 0);
	assert_int_equal(a.calls + b.calls, 1);
	lp_poller_remove(poller, &a.watch);
	lp_poller_remove(poller, &b.watch);
	close(fd_a);
	close(fd_b);
}

static void test_bad_descriptor(void **state)
{
	struct lp_watch watch = {.fd = -1};

	(void)state;
	assert_int_equal(lp_poller_add(poller, &watch, 12345, EPOLLIN, count_call), -EBADF);
	lp_poller_remove(poller, &watch);
}

struct counted_timer {
	struct lp_timer timer;
	int calls;
};

static void count_expiry(struct lp_timer *timer)
{
	LP_CONTAINER_OF(timer, struct counted_timer, timer)->calls++;
}

static void test_timer_once_periodic_and_disarmed(void **state)
{
	struct counted_timer timer = {0};
	const int64_t start_ns = lp_clock_ns();

	(void)state;
	lp_timer_stop(&timer.timer, poller); /* not started: nothing happens */
	assert_int_equal(lp_timer_start(&timer.timer, poller, count_expiry), 0);
	assert_false(readable(0));
	lp_timer_set(&timer.timer, 20 * LP_NS_PER_MS, 0);
	assert_true(readable(60000));
	assert_true(lp_clock_ns() - start_ns >= 20 * LP_NS_PER_MS);
	lp_poller_dispatch(poller);
	assert_int_equal(timer.calls, 1);
	assert_false(readable(50));

	lp_timer_set(&timer.timer, LP_NS_PER_MS, LP_NS_PER_MS);
	for (int i = 0; i < 3; i++) {
		assert_true(readable(60000));
		lp_poller_dispatch(poller);
	}
	assert_int_equal(timer.calls, 4);
	lp_timer_set(&timer.timer, 0, 0);
	lp_poller_dispatch(poller);
	assert_int_equal(timer.calls, 4);
	lp_timer_stop(&timer.timer, poller);
	lp_timer_stop(&timer.timer, poller);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_one_descriptor_stands_for_all, setup,
						teardown),
		cmocka_unit_test_setup_teardown(
			test_a_removed_watch_gets_no_event_of_the_same_batch, setup, teardown),
		cmocka_unit_test_setup_teardown(test_bad_descriptor, setup, teardown),
		cmocka_unit_test_setup_teardown(test_timer_once_periodic_and_disarmed, setup,
						teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
