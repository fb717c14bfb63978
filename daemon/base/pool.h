/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A fixed number of objects of one size, made when first needed and used again ever after: nothing
 * is allocated once all have been out together. All calls from any thread.
 */
#ifndef LP_BASE_POOL_H
#define LP_BASE_POOL_H

#include <stddef.h>

struct lp_pool;

/* `finish` (may be NULL) undoes what users hung into an object; called once per object, by destroy.
 * New objects are zeroed; used ones come back as they were given. NULL: out of memory. */
struct lp_pool *lp_pool_create(size_t object_bytes, int capacity, void (*finish)(void *object));

/* NULL: all objects are out, or no memory for one more. */
void *lp_pool_take(struct lp_pool *pool);

/* Waits for an object. NULL: the pool was closed, or no memory. */
void *lp_pool_wait(struct lp_pool *pool);

void lp_pool_give(struct lp_pool *pool, void *object);

/* Ends every present and future lp_pool_wait(). */
void lp_pool_close(struct lp_pool *pool);

/* Accepts NULL. Every object must be back. */
void lp_pool_destroy(struct lp_pool *pool);

#endif
