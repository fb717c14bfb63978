/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <signal.h>
#include <sys/eventfd.h>

#include "app/loop.h"

static struct lp_loop *loop;
static int fd, ready_calls, ticks, caught_signal;

static void on_ready(void *context)
{
	eventfd_t value;

	assert_ptr_equal(context, &fd);
	assert_int_equal(eventfd_read(fd, &value), 0);
	if (++ready_calls == 3)
		raise(SIGUSR1);
}

static void on_tick(void *context)
{
	(void)context;
	ticks++;
	assert_int_equal(eventfd_write(fd, 1), 0);
}

static void on_signal(void *context, int number)
{
	(void)context;
	caught_signal = number;
	lp_loop_stop(loop);
}

static void test_descriptor_timer_signal(void **state)
{
	(void)state;
	fd = eventfd(0, EFD_NONBLOCK);
	assert_int_equal(lp_loop_create(&loop), 0);
	assert_int_equal(lp_loop_watch(loop, fd, on_ready, &fd), 0);
	assert_int_equal(lp_loop_every(loop, 5, on_tick, NULL), 0);
	assert_int_equal(lp_loop_on_signal(loop, SIGUSR1, on_signal, NULL), 0);
	lp_loop_run(loop);
	assert_int_equal(caught_signal, SIGUSR1);
	assert_true(ready_calls >= 3 && ticks >= 3);
	lp_loop_destroy(loop);
	close(fd);
	lp_loop_destroy(NULL);
}

static void test_bad_descriptor(void **state)
{
	(void)state;
	assert_int_equal(lp_loop_create(&loop), 0);
	assert_true(lp_loop_watch(loop, 12345, on_ready, NULL) < 0);
	lp_loop_destroy(loop);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_descriptor_timer_signal),
		cmocka_unit_test(test_bad_descriptor),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
