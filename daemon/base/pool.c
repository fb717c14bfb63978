/* SPDX-License-Identifier: Apache-2.0 */
#include "base/pool.h"

#include <assert.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>

struct lp_pool {
	pthread_mutex_t lock;
	pthread_cond_t given;
	size_t object_bytes;
	void (*finish)(void *object);
	int capacity, created, free_count;
	bool closed;
	void *free[]; /* the last one given is the first one taken: its memory is warm */
};

struct lp_pool *lp_pool_create(size_t object_bytes, int capacity, void (*finish)(void *object))
{
	struct lp_pool *pool = calloc(1, sizeof(*pool) + (size_t)capacity * sizeof(void *));

	if (!pool)
		return NULL;
	pool->object_bytes = object_bytes;
	pool->capacity = capacity;
	pool->finish = finish;
	pthread_mutex_init(&pool->lock, NULL);
	pthread_cond_init(&pool->given, NULL);
	return pool;
}

static void *take_locked(struct lp_pool *pool)
{
	void *object = NULL;

	if (pool->free_count > 0)
		return pool->free[--pool->free_count];
	if (pool->created < pool->capacity)
		object = calloc(1, pool->object_bytes);
	if (object)
		pool->created++;
	return object;
}

void *lp_pool_take(struct lp_pool *pool)
{
	void *object;

	pthread_mutex_lock(&pool->lock);
	object = take_locked(pool);
	pthread_mutex_unlock(&pool->lock);
	return object;
}

void *lp_pool_wait(struct lp_pool *pool)
{
	void *object = NULL;

	pthread_mutex_lock(&pool->lock);
	while (!pool->closed && pool->free_count == 0 && pool->created == pool->capacity)
		pthread_cond_wait(&pool->given, &pool->lock);
	if (!pool->closed)
		object = take_locked(pool);
	pthread_mutex_unlock(&pool->lock);
	return object;
}

void lp_pool_give(struct lp_pool *pool, void *object)
{
	pthread_mutex_lock(&pool->lock);
	assert(pool->free_count < pool->created);
	pool->free[pool->free_count++] = object;
	pthread_cond_signal(&pool->given);
	pthread_mutex_unlock(&pool->lock);
}

void lp_pool_close(struct lp_pool *pool)
{
	pthread_mutex_lock(&pool->lock);
	pool->closed = true;
	pthread_cond_broadcast(&pool->given);
	pthread_mutex_unlock(&pool->lock);
}

void lp_pool_destroy(struct lp_pool *pool)
{
	if (!pool)
		return;
	assert(pool->free_count == pool->created);
	for (int i = 0; i < pool->free_count; i++) {
		if (pool->finish)
			pool->finish(pool->free[i]);
		free(pool->free[i]);
	}
	pthread_cond_destroy(&pool->given);
	pthread_mutex_destroy(&pool->lock);
	free(pool);
}
