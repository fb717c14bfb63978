/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What waits to be sent to one client: at most one packet half sent, the newest state, the newest
 * picture, and a few control messages. A client that does not read costs this much and no more.
 */
#ifndef LP_PUBLISHER_QUEUE_H
#define LP_PUBLISHER_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

struct lp_packet;

#define LP_QUEUE_CONTROLS 8

/* Zero-initialised is empty. */
struct lp_send_queue {
	struct lp_packet *current; /* [sent_bytes, size) of it is still to go */
	uint32_t sent_bytes;
	struct lp_packet *state, *picture;
	struct lp_packet *controls[LP_QUEUE_CONTROLS]; /* ring */
	int first_control, control_count;
};

/* Hold `packet`. True: an older one was given up for it. */
bool lp_send_queue_put(struct lp_send_queue *queue, struct lp_packet *packet);

/* Write what `fd` takes, control messages first and pictures last. 0: all is sent. 1: the rest must
 * wait until it is writable. Negative: the connection is broken. */
int lp_send_queue_flush(struct lp_send_queue *queue, int fd);

/* The packet that is to go next, taken out of the queue: the caller holds it now. NULL: none. Not
 * to be mixed with lp_send_queue_flush(). */
struct lp_packet *lp_send_queue_take(struct lp_send_queue *queue);

bool lp_send_queue_is_empty(const struct lp_send_queue *queue);

/* Give everything up. */
void lp_send_queue_clear(struct lp_send_queue *queue);

#endif
