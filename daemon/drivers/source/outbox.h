/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Frames and states, in order, from a source's own thread to the loop. It keeps the order of
 * callbacks that include/source.h promises: STREAMING is reported by itself with the first usable
 * frame, and corrupt frames before that are counted, not handed on.
 */
#ifndef LP_SOURCE_OUTBOX_H
#define LP_SOURCE_OUTBOX_H

#include "include/source.h"

struct lp_frame;
struct lp_source_outbox;

/* NULL: out of memory or descriptors. */
struct lp_source_outbox *lp_source_outbox_create(void);

/* Loop thread, once. From now on the host of `source`, which must outlive the outbox, is called.
 * 0 or -errno. */
int lp_source_outbox_start(struct lp_source_outbox *outbox, struct lp_source *source);

/* Source's thread. Takes over the reference to `frame`. `object` names the device in messages. */
void lp_source_outbox_send(struct lp_source_outbox *outbox, struct lp_frame *frame,
			   const char *object);

/* Source's thread. Report a state other than STREAMING; drivers/source/report.h says how it is
 * logged. The same state with the same reason is reported once. */
__attribute__((format(printf, 5, 6))) void
lp_source_outbox_report(struct lp_source_outbox *outbox, enum lp_source_state state,
			const char *object, const char *stage, const char *format, ...);

/* Source's thread. A fault of the device that does not stop its frames, by its name (static), or
 * its end (`object` and `format` NULL). Logged. */
__attribute__((format(printf, 4, 5))) void lp_source_outbox_fault(struct lp_source_outbox *outbox,
								  const char *id,
								  const char *object,
								  const char *format, ...);

/* Source's thread. The state reported last; 0: none. */
enum lp_source_state lp_source_outbox_last_state(const struct lp_source_outbox *outbox);

/* Accepts NULL. The source's thread will not wait for the loop any more. */
void lp_source_outbox_close(struct lp_source_outbox *outbox);

/* Accepts NULL. The source's thread has ended. Releases what the loop has not taken. */
void lp_source_outbox_destroy(struct lp_source_outbox *outbox);

#endif
