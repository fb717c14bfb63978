/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/outbox.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/loop.h"
#include "base/mailbox.h"
#include "base/pool.h"
#include "drivers/source/report.h"
#include "include/frame.h"

#define NOTICES 8
#define ITEMS (NOTICES + 64) /* more than a driver has buffers: nothing is ever displaced */

/* A state or a fault on its way to the loop; among frames, the one that cannot be released. */
struct notice {
	struct lp_frame frame;
	const char *fault; /* its name; NULL: this is a state */
	bool is_over;	   /* of a fault */
	enum lp_source_state state;
	char reason[LP_SOURCE_REASON_BYTES];
};

struct lp_source_outbox {
	struct lp_mailbox *mailbox;
	struct lp_pool *notices;

	/* The source's thread's own. */
	struct lp_source_report report;
	uint64_t corrupt_frames; /* since the last usable one */

	/* The loop's own. */
	struct lp_watch watch;
	struct lp_source *source;
	enum lp_source_state state; /* that the host knows */
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

/* ---------------------------------------------------------------- on the source's thread */

static void put_state(struct lp_source_outbox *outbox, enum lp_source_state state,
		      const char *object, const char *stage, const char *reason)
{
	struct notice *notice;

	if (!lp_source_report_state(&outbox->report, state, object, stage, reason))
		return;
	notice = lp_pool_wait(outbox->notices);
	if (!notice)
		return;
	*notice = (struct notice){.state = state};
	memcpy(notice->reason, outbox->report.last_reason, sizeof(notice->reason));
	(void)lp_mailbox_put(outbox->mailbox, &notice->frame);
}

void lp_source_outbox_send(struct lp_source_outbox *outbox, struct lp_frame *frame,
			   const char *object)
{
	char reason[80] = "frames arrive";

	if (frame->flags & LP_FRAME_CORRUPT) {
		outbox->corrupt_frames++;
	} else {
		if (outbox->corrupt_frames)
			(void)snprintf(reason, sizeof(reason),
				       "frames arrive; %" PRIu64 " before were corrupt",
				       outbox->corrupt_frames);
		if (outbox->report.last_state != LP_SOURCE_STREAMING)
			put_state(outbox, LP_SOURCE_STREAMING, object, "stream", reason);
		outbox->corrupt_frames = 0;
	}
	(void)lp_mailbox_put(outbox->mailbox, frame);
}

void lp_source_outbox_report(struct lp_source_outbox *outbox, enum lp_source_state state,
			     const char *object, const char *stage, const char *format, ...)
{
	char reason[LP_SOURCE_REASON_BYTES];
	va_list arguments;

	va_start(arguments, format);
	(void)vsnprintf(reason, sizeof(reason), format, arguments);
	va_end(arguments);
	put_state(outbox, state, object, stage, reason);
}

void lp_source_outbox_fault(struct lp_source_outbox *outbox, const char *id, const char *object,
			    const char *format, ...)
{
	struct notice *notice = lp_pool_wait(outbox->notices);
	char text[LP_SOURCE_REASON_BYTES / 2];
	va_list arguments;

	if (!notice)
		return;
	*notice = (struct notice){.fault = id, .is_over = !format};
	if (format) {
		va_start(arguments, format);
		(void)vsnprintf(text, sizeof(text), format, arguments);
		va_end(arguments);
		lp_warning(object, id, "%s", text);
		(void)snprintf(notice->reason, sizeof(notice->reason), "%.200s: %s", object, text);
	}
	(void)lp_mailbox_put(outbox->mailbox, &notice->frame);
}

enum lp_source_state lp_source_outbox_last_state(const struct lp_source_outbox *outbox)
{
	return outbox->report.last_state;
}

/* ---------------------------------------------------------------- on the loop */

static void hand_on_frame(struct lp_source_outbox *outbox, struct lp_frame *frame)
{
	const struct lp_source_host *host = &outbox->source->host;

	if (outbox->state == LP_SOURCE_STREAMING) {
		host->frame(host->context, frame);
		return;
	}
	lp_frame_release(frame); /* a corrupt one: usable ones come after STREAMING */
	host->corrupt(host->context);
}

static void hand_on_state(struct lp_source_outbox *outbox, struct notice *item)
{
	const struct lp_source_host *host = &outbox->source->host;
	const struct notice notice = *item;

	lp_pool_give(outbox->notices, item);
	if (notice.fault) {
		if (host->fault)
			host->fault(host->context, notice.fault,
				    notice.is_over ? NULL : notice.reason);
		return;
	}
	outbox->state = notice.state;
	host->state(host->context, notice.state, notice.reason);
}

/* One item: what else waits makes the descriptor readable again. */
static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_source_outbox *outbox = LP_CONTAINER_OF(watch, struct lp_source_outbox, watch);
	struct lp_frame *item = lp_mailbox_take(outbox->mailbox);

	(void)events;
	if (!item)
		return;
	if (item->release)
		hand_on_frame(outbox, item);
	else
		hand_on_state(outbox, (struct notice *)item);
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
