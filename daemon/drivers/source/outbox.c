/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/outbox.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/loop.h"
#include "base/mailbox.h"
#include "base/pool.h"
#include "include/frame.h"

#define NOTICES 8
#define ITEMS (NOTICES + 64) /* more than a driver has buffers: nothing is ever displaced */

/* A change of state; among frames, the one that cannot be released. */
struct notice {
	struct lp_frame frame;
	enum lp_source_state state;
	char reason[LP_SOURCE_REASON_BYTES];
};

struct lp_source_outbox {
	struct lp_mailbox *mailbox;
	struct lp_pool *notices;
	struct notice told; /* capture thread's own */
	struct lp_watch watch;
	struct lp_source *source;
};

struct lp_source_outbox *lp_source_outbox_create(void)
{
	struct lp_source_outbox *outbox = calloc(1, sizeof(*outbox));

	if (!outbox)
		return NULL;
	outbox->mailbox = lp_mailbox_create(ITEMS);
	outbox->notices = lp_pool_create(sizeof(struct notice), NOTICES, NULL);
	if (outbox->mailbox && outbox->notices)
		return outbox;
	lp_source_outbox_destroy(outbox);
	return NULL;
}

void lp_source_outbox_send(struct lp_source_outbox *outbox, struct lp_frame *frame)
{
	(void)lp_mailbox_put(outbox->mailbox, frame);
}

void lp_source_outbox_tell(struct lp_source_outbox *outbox, enum lp_source_state state,
			   const char *object, const char *stage, const char *reason)
{
	struct notice *notice, now = {.state = state};

	snprintf(now.reason, sizeof(now.reason), "%s: %s: %s", object, stage, reason);
	if (now.state == outbox->told.state && !strcmp(now.reason, outbox->told.reason))
		return;
	outbox->told = now;
	notice = lp_pool_wait(outbox->notices);
	if (!notice)
		return;
	*notice = now;
	(void)lp_mailbox_put(outbox->mailbox, &notice->frame);
}

/* One item: what else waits makes the descriptor readable again. */
static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_source_outbox *outbox = LP_CONTAINER_OF(watch, struct lp_source_outbox, watch);
	const struct lp_source_host *host = &outbox->source->host;
	struct lp_frame *item = lp_mailbox_take(outbox->mailbox);
	struct notice notice;

	(void)events;
	if (!item)
		return;
	if (item->release) {
		host->frame(host->context, item);
		return;
	}
	notice = *(struct notice *)item;
	lp_pool_give(outbox->notices, item);
	host->state(host->context, notice.state, notice.reason);
}

int lp_source_outbox_start(struct lp_source_outbox *outbox, struct lp_source *source)
{
	outbox->source = source;
	return lp_watch_start(source->host.loop, &outbox->watch, lp_mailbox_fd(outbox->mailbox),
			      LP_READABLE, on_ready);
}

void lp_source_outbox_close(struct lp_source_outbox *outbox)
{
	if (outbox)
		lp_pool_close(outbox->notices);
}

void lp_source_outbox_destroy(struct lp_source_outbox *outbox)
{
	struct lp_frame *item;

	if (!outbox)
		return;
	lp_watch_stop(&outbox->watch);
	while (outbox->mailbox && (item = lp_mailbox_take(outbox->mailbox)) != NULL) {
		if (item->release)
			lp_frame_release(item);
		else
			lp_pool_give(outbox->notices, item);
	}
	lp_mailbox_destroy(outbox->mailbox);
	lp_pool_destroy(outbox->notices);
	free(outbox);
}
