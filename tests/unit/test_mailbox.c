/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <poll.h>
#include <pthread.h>
#include <stdbool.h>

#include "base/mailbox.h"

static bool readable(struct lp_mailbox *mailbox)
{
	struct pollfd poll_fd = {.fd = lp_mailbox_fd(mailbox), .events = POLLIN};

	return poll(&poll_fd, 1, 0) == 1;
}

static void test_newest_wins_and_losses_are_counted(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(2);
	int items[4];

	(void)state;
	assert_null(lp_mailbox_take(mailbox));
	assert_null(lp_mailbox_put(mailbox, &items[0]));
	assert_null(lp_mailbox_put(mailbox, &items[1]));
	assert_ptr_equal(lp_mailbox_put(mailbox, &items[2]), &items[0]);
	assert_ptr_equal(lp_mailbox_put(mailbox, &items[3]), &items[1]);
	assert_int_equal(lp_mailbox_lost(mailbox), 2);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[2]);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[3]);
	assert_null(lp_mailbox_take(mailbox));
	lp_mailbox_destroy(mailbox);
	lp_mailbox_destroy(NULL);
}

static void test_capacity_one_keeps_the_newest(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(1);
	int items[2];

	(void)state;
	assert_null(lp_mailbox_put(mailbox, &items[0]));
	assert_ptr_equal(lp_mailbox_put(mailbox, &items[1]), &items[0]);
	assert_true(readable(mailbox));
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[1]);
	assert_false(readable(mailbox));
	lp_mailbox_destroy(mailbox);
}

static bool is_small(const void *item)
{
	return *(const int *)item < 10;
}

/* What does not count is only displaced when there is no room at all. */
static void test_only_what_counts_is_displaced(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(4);
	int items[] = {1, 10, 2, 3, 11, 12, 4};

	(void)state;
	assert_null(lp_mailbox_put_counted(mailbox, &items[0], 2, is_small));
	assert_null(lp_mailbox_put_counted(mailbox, &items[1], 2, is_small));
	assert_null(lp_mailbox_put_counted(mailbox, &items[2], 2, is_small));
	assert_ptr_equal(lp_mailbox_put_counted(mailbox, &items[3], 2, is_small), &items[0]);
	assert_null(lp_mailbox_put_counted(mailbox, &items[4], 2, is_small));
	/* 2 10 3 11: full */
	assert_ptr_equal(lp_mailbox_put_counted(mailbox, &items[6], 2, is_small), &items[2]);
	assert_ptr_equal(lp_mailbox_put_counted(mailbox, &items[5], 2, is_small), &items[1]);
	assert_int_equal(lp_mailbox_lost(mailbox), 3);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[3]);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[6]);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[4]);
	assert_true(readable(mailbox));
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[5]);
	assert_false(readable(mailbox));
	lp_mailbox_destroy(mailbox);
}

/* More of each kind come than are taken: both go on. */
static void test_they_take_turns(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(6);
	int small[40], large[40], taken = 0, last = 0;

	(void)state;
	for (int k = 0; k < 40; k++) {
		small[k] = 0;
		large[k] = 10 + k;
		(void)lp_mailbox_put_counted(mailbox, &large[k], 1, is_small);
		(void)lp_mailbox_put_counted(mailbox, &small[k], 1, is_small);
		const int item = *(const int *)lp_mailbox_take(mailbox);

		taken += item < 10;
		if (item >= 10) {
			assert_true(item > last); /* of one kind in their order */
			last = item;
		}
	}
	assert_in_range(taken, 15, 25);
	while (lp_mailbox_take(mailbox))
		;
	lp_mailbox_destroy(mailbox);
}

/* A full mailbox of the others loses the oldest of them, and none that counts. */
static void test_none_that_counts_is_displaced_by_others(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(3);
	int items[] = {1, 10, 11, 12};

	(void)state;
	assert_null(lp_mailbox_put_counted(mailbox, &items[0], 1, is_small));
	assert_null(lp_mailbox_put_counted(mailbox, &items[1], 1, is_small));
	assert_null(lp_mailbox_put_counted(mailbox, &items[2], 1, is_small));
	assert_ptr_equal(lp_mailbox_put_counted(mailbox, &items[3], 1, is_small), &items[1]);
	assert_ptr_equal(lp_mailbox_take(mailbox), &items[0]);
	while (lp_mailbox_take(mailbox))
		;
	lp_mailbox_destroy(mailbox);
}

static void test_descriptor_is_readable_while_an_item_waits(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(2);
	int item;

	(void)state;
	assert_false(readable(mailbox));
	lp_mailbox_put(mailbox, &item);
	lp_mailbox_put(mailbox, &item);
	assert_true(readable(mailbox));
	lp_mailbox_take(mailbox);
	assert_true(readable(mailbox));
	lp_mailbox_take(mailbox);
	assert_false(readable(mailbox));
	lp_mailbox_destroy(mailbox);
}

/* Woken once, after what waits; a second time counts only once it has returned. */
static void test_waking(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(2);
	int item;

	(void)state;
	assert_true(lp_mailbox_wake(mailbox));
	assert_false(lp_mailbox_wake(mailbox));
	lp_mailbox_put(mailbox, &item);
	assert_ptr_equal(lp_mailbox_wait(mailbox), &item);
	assert_null(lp_mailbox_wait(mailbox));
	assert_false(lp_mailbox_is_closed(mailbox));
	assert_true(lp_mailbox_wake(mailbox));
	lp_mailbox_close(mailbox);
	assert_null(lp_mailbox_wait(mailbox));
	assert_true(lp_mailbox_is_closed(mailbox));
	lp_mailbox_destroy(mailbox);
}

#define COUNT 20000

static void *produce(void *argument)
{
	struct lp_mailbox *mailbox = argument;

	for (uintptr_t i = 1; i <= COUNT; i++)
		lp_mailbox_put(mailbox, (void *)i);
	lp_mailbox_close(mailbox);
	return NULL;
}

static void test_threads_see_rising_items_and_the_last(void **state)
{
	struct lp_mailbox *mailbox = lp_mailbox_create(4);
	uintptr_t item, last = 0, taken = 0;
	pthread_t thread;

	(void)state;
	assert_int_equal(pthread_create(&thread, NULL, produce, mailbox), 0);
	while ((item = (uintptr_t)lp_mailbox_wait(mailbox)) != 0) {
		assert_true(item > last);
		last = item;
		taken++;
	}
	pthread_join(thread, NULL);
	assert_int_equal(last, COUNT);
	assert_int_equal(taken + lp_mailbox_lost(mailbox), COUNT);
	lp_mailbox_destroy(mailbox);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_newest_wins_and_losses_are_counted),
		cmocka_unit_test(test_capacity_one_keeps_the_newest),
		cmocka_unit_test(test_only_what_counts_is_displaced),
		cmocka_unit_test(test_they_take_turns),
		cmocka_unit_test(test_none_that_counts_is_displaced_by_others),
		cmocka_unit_test(test_descriptor_is_readable_while_an_item_waits),
		cmocka_unit_test(test_waking),
		cmocka_unit_test(test_threads_see_rising_items_and_the_last),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
