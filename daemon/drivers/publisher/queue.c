/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/queue.h"

#include <errno.h>
#include <stddef.h>
#include <unistd.h>

#include "include/packet.h"

static struct lp_packet *pop_control(struct lp_send_queue *queue)
{
	struct lp_packet *packet = NULL;

	if (queue->control_count > 0) {
		packet = queue->controls[queue->first_control];
		queue->first_control = (queue->first_control + 1) % LP_QUEUE_CONTROLS;
		queue->control_count--;
	}
	return packet;
}

/* The slot gets `packet` and gives what it held. */
static struct lp_packet *exchange(struct lp_packet **slot, struct lp_packet *packet)
{
	struct lp_packet *before = *slot;

	*slot = packet;
	return before;
}

bool lp_send_queue_put(struct lp_send_queue *queue, struct lp_packet *packet)
{
	struct lp_packet *lost = NULL;

	if (packet->kind == LP_PACKET_STATE) {
		lost = exchange(&queue->state, lp_packet_hold(packet));
	} else if (packet->kind == LP_PACKET_PICTURE) {
		lost = exchange(&queue->picture, lp_packet_hold(packet));
	} else {
		if (queue->control_count == LP_QUEUE_CONTROLS)
			lost = pop_control(queue);
		queue->controls[(queue->first_control + queue->control_count) % LP_QUEUE_CONTROLS] =
			lp_packet_hold(packet);
		queue->control_count++;
	}
	lp_packet_drop(lost);
	return lost != NULL;
}

/* The packet to write next; NULL when nothing waits. */
static struct lp_packet *next_packet(struct lp_send_queue *queue)
{
	if (queue->current)
		return queue->current;
	queue->sent_bytes = 0;
	queue->current = pop_control(queue);
	if (!queue->current)
		queue->current = exchange(&queue->state, NULL);
	if (!queue->current)
		queue->current = exchange(&queue->picture, NULL);
	return queue->current;
}

int lp_send_queue_flush(struct lp_send_queue *queue, int fd)
{
	struct lp_packet *packet;

	while ((packet = next_packet(queue)) != NULL) {
		const ssize_t sent = write(fd, packet->data + queue->sent_bytes,
					   packet->size_bytes - queue->sent_bytes);

		if (sent < 0 && errno == EINTR)
			continue;
		if (sent < 0)
			return errno == EAGAIN ? 1 : -errno;
		queue->sent_bytes += (uint32_t)sent;
		if (queue->sent_bytes == packet->size_bytes) {
			lp_packet_drop(packet);
			queue->current = NULL;
		}
	}
	return 0;
}

struct lp_packet *lp_send_queue_take(struct lp_send_queue *queue)
{
	struct lp_packet *packet = next_packet(queue);

	queue->current = NULL;
	return packet;
}

bool lp_send_queue_is_empty(const struct lp_send_queue *queue)
{
	return !queue->current && !queue->state && !queue->picture && queue->control_count == 0;
}

void lp_send_queue_clear(struct lp_send_queue *queue)
{
	struct lp_packet *packet;

	while ((packet = next_packet(queue)) != NULL) {
		lp_packet_drop(packet);
		queue->current = NULL;
	}
}
