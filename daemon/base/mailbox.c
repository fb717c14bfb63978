/* SPDX-License-Identifier: Apache-2.0 */
#include "base/mailbox.h"

#include <assert.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

struct lp_mailbox {
	pthread_mutex_t lock;
	pthread_cond_t filled;
	int event_fd;
	int capacity, first, count;
	bool closed, woken;
	uint64_t lost;
	void *items[]; /* ring */
};

struct lp_mailbox *lp_mailbox_create(int capacity)
{
	struct lp_mailbox *mailbox =
		calloc(1, sizeof(*mailbox) + (size_t)capacity * sizeof(void *));

	if (!mailbox)
		return NULL;
	mailbox->capacity = capacity;
	mailbox->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (mailbox->event_fd < 0) {
		free(mailbox);
		return NULL;
	}
	pthread_mutex_init(&mailbox->lock, NULL);
	pthread_cond_init(&mailbox->filled, NULL);
	return mailbox;
}

/* Make the descriptor readable when there is an item, and only then. Neither call can fail:
 * the counter goes from 0 to 1 and back. */
static void signal_fd(struct lp_mailbox *mailbox, bool readable)
{
	eventfd_t value;

	if (readable)
		(void)eventfd_write(mailbox->event_fd, 1);
	else
		(void)eventfd_read(mailbox->event_fd, &value);
}

static void *take_locked(struct lp_mailbox *mailbox)
{
	void *item;

	if (mailbox->count == 0)
		return NULL;
	item = mailbox->items[mailbox->first];
	mailbox->first = (mailbox->first + 1) % mailbox->capacity;
	if (--mailbox->count == 0)
		signal_fd(mailbox, false);
	return item;
}

/* The item that waits as number k, behind the oldest. */
static void **item_at(struct lp_mailbox *mailbox, int k)
{
	return &mailbox->items[(mailbox->first + k) % mailbox->capacity];
}

static void *remove_locked(struct lp_mailbox *mailbox, int k)
{
	void *item = *item_at(mailbox, k);

	for (; k > 0; k--)
		*item_at(mailbox, k) = *item_at(mailbox, k - 1);
	(void)take_locked(mailbox);
	mailbox->lost++;
	return item;
}

/* Behind k items. */
static void insert_locked(struct lp_mailbox *mailbox, void *item, int k)
{
	for (int j = mailbox->count; j > k; j--)
		*item_at(mailbox, j) = *item_at(mailbox, j - 1);
	*item_at(mailbox, k) = item;
	if (mailbox->count++ == 0)
		signal_fd(mailbox, true);
	pthread_cond_signal(&mailbox->filled);
}

void *lp_mailbox_put(struct lp_mailbox *mailbox, void *item)
{
	void *lost = NULL;

	pthread_mutex_lock(&mailbox->lock);
	if (mailbox->count == mailbox->capacity)
		lost = remove_locked(mailbox, 0);
	insert_locked(mailbox, item, mailbox->count);
	pthread_mutex_unlock(&mailbox->lock);
	return lost;
}

/* What waits of one kind: those that count, or the others. */
struct kind {
	int items;
	int oldest, newest; /* -1: none waits */
};

static struct kind kind_of(struct lp_mailbox *mailbox, bool counted,
			   bool (*counts)(const void *item))
{
	struct kind kind = {.oldest = -1, .newest = -1};

	for (int k = mailbox->count - 1; k >= 0; k--) {
		if (counts(*item_at(mailbox, k)) != counted)
			continue;
		kind.items++;
		kind.oldest = k;
		if (kind.newest < 0)
			kind.newest = k;
	}
	return kind;
}

/* The oldest of the kind goes; each of the others moves up into the place before it, and the item
 * takes the last place, so that it does not wait longer than what it displaces. */
static void *displace_locked(struct lp_mailbox *mailbox, void *item, bool (*counts)(const void *))
{
	const struct kind kind = kind_of(mailbox, true, counts);
	void *lost = *item_at(mailbox, kind.oldest);
	int place = kind.oldest;

	for (int k = kind.oldest + 1; k <= kind.newest; k++) {
		if (!counts(*item_at(mailbox, k)))
			continue;
		*item_at(mailbox, place) = *item_at(mailbox, k);
		place = k;
	}
	*item_at(mailbox, place) = item;
	mailbox->lost++;
	return lost;
}

void *lp_mailbox_put_counted(struct lp_mailbox *mailbox, void *item, int most,
			     bool (*counts)(const void *item))
{
	const bool counted = counts(item);
	void *lost = NULL;

	pthread_mutex_lock(&mailbox->lock);
	struct kind kind = kind_of(mailbox, counted, counts);

	if (counted && kind.items >= most) {
		lost = displace_locked(mailbox, item, counts);
	} else {
		if (mailbox->count == mailbox->capacity)
			lost = remove_locked(mailbox, kind.oldest < 0 ? 0 : kind.oldest);
		kind = kind_of(mailbox, true, counts);
		/* behind the newest that counts, and one of the others */
		const int place = counted ? kind.newest + 2 : mailbox->count;

		insert_locked(mailbox, item, place < mailbox->count ? place : mailbox->count);
	}
	pthread_mutex_unlock(&mailbox->lock);
	return lost;
}

void *lp_mailbox_take(struct lp_mailbox *mailbox)
{
	void *item;

	pthread_mutex_lock(&mailbox->lock);
	item = take_locked(mailbox);
	pthread_mutex_unlock(&mailbox->lock);
	return item;
}

void *lp_mailbox_wait(struct lp_mailbox *mailbox)
{
	void *item;

	pthread_mutex_lock(&mailbox->lock);
	while (mailbox->count == 0 && !mailbox->closed && !mailbox->woken)
		pthread_cond_wait(&mailbox->filled, &mailbox->lock);
	item = take_locked(mailbox);
	if (!item)
		mailbox->woken = false;
	pthread_mutex_unlock(&mailbox->lock);
	return item;
}

bool lp_mailbox_wake(struct lp_mailbox *mailbox)
{
	bool before;

	pthread_mutex_lock(&mailbox->lock);
	before = mailbox->woken;
	mailbox->woken = true;
	pthread_cond_signal(&mailbox->filled);
	pthread_mutex_unlock(&mailbox->lock);
	return !before;
}

bool lp_mailbox_is_closed(struct lp_mailbox *mailbox)
{
	bool closed;

	pthread_mutex_lock(&mailbox->lock);
	closed = mailbox->closed;
	pthread_mutex_unlock(&mailbox->lock);
	return closed;
}

void lp_mailbox_close(struct lp_mailbox *mailbox)
{
	pthread_mutex_lock(&mailbox->lock);
	mailbox->closed = true;
	pthread_cond_broadcast(&mailbox->filled);
	pthread_mutex_unlock(&mailbox->lock);
}

int lp_mailbox_fd(const struct lp_mailbox *mailbox)
{
	return mailbox->event_fd;
}

uint64_t lp_mailbox_lost(struct lp_mailbox *mailbox)
{
	uint64_t lost;

	pthread_mutex_lock(&mailbox->lock);
	lost = mailbox->lost;
	pthread_mutex_unlock(&mailbox->lock);
	return lost;
}

void lp_mailbox_destroy(struct lp_mailbox *mailbox)
{
	if (!mailbox)
		return;
	assert(mailbox->count == 0);
	close(mailbox->event_fd);
	pthread_cond_destroy(&mailbox->filled);
	pthread_mutex_destroy(&mailbox->lock);
	free(mailbox);
}
