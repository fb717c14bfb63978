/* SPDX-License-Identifier: Apache-2.0 */
/* Frames and changes of state, in order, from the capture thread to the loop. */
#ifndef LP_SOURCE_OUTBOX_H
#define LP_SOURCE_OUTBOX_H

#include "include/source.h"

struct lp_frame;
struct lp_source_outbox;

#define LP_SOURCE_REASON_BYTES 512

/* NULL: out of memory or descriptors. */
struct lp_source_outbox *lp_source_outbox_create(void);

/* Loop thread, once. From now on the host of `source`, which must outlive the outbox, is called for
 * everything that was sent and told, in that order. 0 or -errno. */
int lp_source_outbox_start(struct lp_source_outbox *outbox, struct lp_source *source);

/* Capture thread. Takes over the reference to `frame`. */
void lp_source_outbox_send(struct lp_source_outbox *outbox, struct lp_frame *frame);

/* Capture thread. What was told last is not told again. */
void lp_source_outbox_tell(struct lp_source_outbox *outbox, enum lp_source_state state,
			   const char *object, const char *stage, const char *reason);

/* Accepts NULL. The capture thread will not wait for the loop any more. */
void lp_source_outbox_close(struct lp_source_outbox *outbox);

/* Accepts NULL. Releases what was not taken. */
void lp_source_outbox_destroy(struct lp_source_outbox *outbox);

#endif
