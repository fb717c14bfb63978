/* SPDX-License-Identifier: Apache-2.0 */
#include "app/loop.h"

#include <errno.h>
#include <stdlib.h>
#include <uv.h>

#define MAX_ENTRIES 24

/* One handle of libuv and what it calls. libuv's errors are negative errno, as ours. */
struct entry {
	union {
		uv_handle_t any;
		uv_poll_t poll;
		uv_signal_t signal;
		uv_timer_t timer;
	} handle;
	void (*ready)(void *context);
	void (*caught)(void *context, int signal_number);
	void *context;
};

struct lp_loop {
	uv_loop_t uv;
	int count;
	struct entry entries[MAX_ENTRIES];
};

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
	*loop = self;
	return 0;
}

/* An entry for a handle; taken only by a successful start, so that every counted one is closed. */
static struct entry *next_entry(struct lp_loop *loop, void *context)
{
	struct entry *entry = &loop->entries[loop->count];

	if (loop->count == MAX_ENTRIES)
		return NULL;
	*entry = (struct entry){.context = context};
	entry->handle.any.data = entry;
	return entry;
}

static void on_poll(uv_poll_t *handle, int status, int events)
{
	struct entry *entry = handle->data;

	(void)status; /* the descriptor's owner finds the error when it reads */
	(void)events;
	entry->ready(entry->context);
}

static void on_signal(uv_signal_t *handle, int signal_number)
{
	struct entry *entry = handle->data;

	entry->caught(entry->context, signal_number);
}

static void on_timer(uv_timer_t *handle)
{
	struct entry *entry = handle->data;

	entry->ready(entry->context);
}

int lp_loop_watch(struct lp_loop *loop, int fd, void (*ready)(void *context), void *context)
{
	struct entry *entry = next_entry(loop, context);
	int ret;

	if (!entry)
		return -ENOSPC;
	entry->ready = ready;
	ret = uv_poll_init(&loop->uv, &entry->handle.poll, fd);
	if (ret < 0)
		return ret;
	loop->count++;
	return uv_poll_start(&entry->handle.poll, UV_READABLE, on_poll);
}

int lp_loop_on_signal(struct lp_loop *loop, int signal_number,
		      void (*caught)(void *context, int signal_number), void *context)
{
	struct entry *entry = next_entry(loop, context);
	int ret;

	if (!entry)
		return -ENOSPC;
	entry->caught = caught;
	ret = uv_signal_init(&loop->uv, &entry->handle.signal);
	if (ret < 0)
		return ret;
	loop->count++;
	return uv_signal_start(&entry->handle.signal, on_signal, signal_number);
}

int lp_loop_every(struct lp_loop *loop, unsigned int period_ms, void (*tick)(void *context),
		  void *context)
{
	struct entry *entry = next_entry(loop, context);
	int ret;

	if (!entry)
		return -ENOSPC;
	entry->ready = tick;
	ret = uv_timer_init(&loop->uv, &entry->handle.timer);
	if (ret < 0)
		return ret;
	loop->count++;
	return uv_timer_start(&entry->handle.timer, on_timer, period_ms, period_ms);
}

void lp_loop_run(struct lp_loop *loop)
{
	(void)uv_run(&loop->uv, UV_RUN_DEFAULT);
}

void lp_loop_stop(struct lp_loop *loop)
{
	uv_stop(&loop->uv);
}

void lp_loop_destroy(struct lp_loop *loop)
{
	if (!loop)
		return;
	for (int i = 0; i < loop->count; i++)
		uv_close(&loop->entries[i].handle.any, NULL);
	(void)uv_run(&loop->uv, UV_RUN_DEFAULT); /* until all are closed */
	(void)uv_loop_close(&loop->uv);
	free(loop);
}
