/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hand-over of pointers between two threads. A full mailbox gives its oldest item back to whoever
 * puts a new one in: the newest wins, and what was lost is counted.
 */
#ifndef LP_BASE_MAILBOX_H
#define LP_BASE_MAILBOX_H

#include <stdbool.h>
#include <stdint.h>

struct lp_mailbox;

/* NULL: out of memory or descriptors (errno). */
struct lp_mailbox *lp_mailbox_create(int capacity);

/* Returns the item that had to go, for the caller to release; NULL when none had to. */
void *lp_mailbox_put(struct lp_mailbox *mailbox, void *item);

/* The same, but of the items that `counts` says yes to no more than `most` may wait: one that
 * counts too much displaces the oldest of them, and waits no longer than it would have. They take
 * turns with the others: behind those that count before it, each waits for one other at most. */
void *lp_mailbox_put_counted(struct lp_mailbox *mailbox, void *item, int most,
			     bool (*counts)(const void *item));

/* The oldest item; NULL when empty. */
void *lp_mailbox_take(struct lp_mailbox *mailbox);

/* Waits for an item. NULL: closed and empty, or woken. */
void *lp_mailbox_wait(struct lp_mailbox *mailbox);

/* Once no item is left, lp_mailbox_wait() returns NULL one time. False: an earlier call has not
 * shown this effect yet, so that this one adds nothing. */
bool lp_mailbox_wake(struct lp_mailbox *mailbox);

bool lp_mailbox_is_closed(struct lp_mailbox *mailbox);

/* Ends lp_mailbox_wait() once the mailbox is empty. */
void lp_mailbox_close(struct lp_mailbox *mailbox);

/* Readable while an item waits. */
int lp_mailbox_fd(const struct lp_mailbox *mailbox);

/* Items given back by put(), ever. */
uint64_t lp_mailbox_lost(struct lp_mailbox *mailbox);

/* Accepts NULL. Must be empty: take() and release what is left first. */
void lp_mailbox_destroy(struct lp_mailbox *mailbox);

#endif
