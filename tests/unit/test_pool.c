/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <pthread.h>

#include "base/pool.h"

static int finished;

static void finish(void *object)
{
	(void)object;
	finished++;
}

static void test_fixed_number_and_reuse(void **state)
{
	struct lp_pool *pool = lp_pool_create(64, 3, finish);
	void *a, *b, *c;

	(void)state;
	finished = 0;
	a = lp_pool_take(pool);
	b = lp_pool_take(pool);
	c = lp_pool_take(pool);
	assert_true(a && b && c && a != b && b != c);
	assert_null(lp_pool_take(pool));
	memset(b, 7, 64);
	lp_pool_give(pool, b);
	assert_ptr_equal(lp_pool_take(pool), b);
	assert_int_equal(((unsigned char *)b)[63], 7); /* comes back as it was given */
	lp_pool_give(pool, a);
	lp_pool_give(pool, b);
	lp_pool_give(pool, c);
	lp_pool_destroy(pool);
	assert_int_equal(finished, 3);
	lp_pool_destroy(NULL);
}

static void *give_later(void *argument)
{
	void **both = argument;

	lp_pool_give(both[0], both[1]);
	return NULL;
}

static void test_wait_gets_what_another_thread_gives(void **state)
{
	struct lp_pool *pool = lp_pool_create(8, 1, NULL);
	void *object = lp_pool_wait(pool);
	void *both[] = {pool, object};
	pthread_t thread;

	(void)state;
	assert_non_null(object);
	assert_int_equal(pthread_create(&thread, NULL, give_later, both), 0);
	assert_ptr_equal(lp_pool_wait(pool), object);
	pthread_join(thread, NULL);
	lp_pool_give(pool, object);
	lp_pool_destroy(pool);
}

static void *wait_for_object(void *pool)
{
	return lp_pool_wait(pool);
}

static void test_close_ends_waiting(void **state)
{
	struct lp_pool *pool = lp_pool_create(8, 1, NULL);
	void *object = lp_pool_take(pool);
	void *result = object;
	pthread_t thread;

	(void)state;
	assert_int_equal(pthread_create(&thread, NULL, wait_for_object, pool), 0);
	lp_pool_close(pool);
	pthread_join(thread, &result);
	assert_null(result);
	lp_pool_give(pool, object);
	assert_null(lp_pool_wait(pool));
	lp_pool_destroy(pool);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_fixed_number_and_reuse),
		cmocka_unit_test(test_wait_gets_what_another_thread_gives),
		cmocka_unit_test(test_close_ends_waiting),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
