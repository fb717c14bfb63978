/* SPDX-License-Identifier: Apache-2.0 */
/* COBS frames on the serial line. */
#include "link.h"

#include "board/board.h"

/* Bytes looked at in one call: the main loop has other work. */
#define BYTES_PER_CALL 64

uint8_t link_serial_encode(const struct message *message, uint8_t *frame)
{
	uint8_t envelope[ENVELOPE_MAX_BYTES];
	uint8_t count = envelope_pack(message, envelope);
	uint8_t code_at = 0;
	uint8_t at = 1;

	for (uint8_t i = 0; i < count; i++) {
		if (envelope[i] == 0) {
			frame[code_at] = at - code_at;
			code_at = at++;
		} else {
			frame[at++] = envelope[i];
		}
	}
	frame[code_at] = at - code_at;
	frame[at++] = 0;
	return at;
}

/* Decodes what was collected, in place; returns the envelope's length, 0 when it is none. */
static uint8_t unstuff(uint8_t *bytes, uint8_t count)
{
	uint8_t to = 0;
	uint8_t at = 0;

	while (at < count) {
		uint8_t end = at + bytes[at];
		if (end > count)
			return 0;
		for (at++; at < end; at++)
			bytes[to++] = bytes[at];
		if (at < count)
			bytes[to++] = 0;
	}
	return to;
}

/* Takes one byte; true when it completed a message. */
bool link_serial_byte(struct link *link, uint8_t byte, struct message *message)
{
	if (byte != 0) {
		if (link->collected_bytes < LINK_COLLECT_BYTES)
			link->collected[link->collected_bytes] = byte;
		if (link->collected_bytes <= LINK_COLLECT_BYTES)
			link->collected_bytes++;
		return false;
	}
	uint8_t count = link->collected_bytes;
	link->collected_bytes = 0;
	if (count == 0)
		return false;
	if (count <= LINK_COLLECT_BYTES &&
	    envelope_unpack(link->collected, unstuff(link->collected, count), message))
		return true;
	link->rx_bad++;
	return false;
}

bool link_serial_receive(struct link *link, struct link_message *received)
{
	for (uint8_t i = 0; i < BYTES_PER_CALL; i++) {
		int16_t byte = board_uart_get();
		if (byte < 0)
			return false;
		if (link_serial_byte(link, byte, &received->message)) {
			received->stamped = board_uart_stamp(&received->t_rx_us);
			return true;
		}
	}
	return false;
}

void link_serial_poll(struct link *link)
{
	uint8_t frame[ENVELOPE_MAX_BYTES + 2];
	const struct message *next;

	while ((next = link_next(link)) && board_uart_put(frame, link_serial_encode(next, frame)))
		link_done(link);
}
