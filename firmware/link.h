/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Messages to and from the host over whichever carrier the board is strapped for: proto/mcu.md.
 * One queue outwards; each carrier (link_serial.c, link_i2c.c, link_can.c) takes from it as it can.
 */
#ifndef LINK_H
#define LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "envelope.h"

struct params;
struct safe;

#define LINK_QUEUE 16 /* a power of two */
#define LINK_CAN_BASE 0x500
#define LINK_COLLECT_BYTES (ENVELOPE_MAX_BYTES + 1) /* COBS adds one byte */

struct link_message {
	struct message message;
	uint32_t t_rx_us;
	bool stamped; /* t_rx_us is this message's own */
};

struct link {
	const struct params *params;
	struct safe *safe;
	uint8_t carrier; /* enum carrier */
	struct message queue[LINK_QUEUE];
	uint8_t first, count;
	uint16_t rx_good, rx_bad, tx_dropped;

	uint8_t collected[LINK_COLLECT_BYTES]; /* serial: of the frame being received */
	uint8_t collected_bytes;	       /* one more than fits: too long */
	uint8_t i2c_errors;		       /* seen so far */
	bool can_up;
	bool can_rx1_older; /* than anything in the other receive buffer */
	uint8_t can_check_ms;
	uint8_t can_prescaler; /* by the parameters at the start: they count from a reset on */
};

void link_init(struct link *link, const struct params *params, struct safe *safe, uint8_t carrier);

/* How many messages can be sent now. */
uint8_t link_room(const struct link *link);

/* Queues a message; the caller fills its payload in at once. NULL without room: dropped and
 * counted. */
struct message *link_send(struct link *link, uint8_t id, uint8_t length_bytes);

/* The next message received; false when there is none. Its id and length are not checked. */
bool link_receive(struct link *link, struct link_message *received);

/* Moves queued messages to the carrier. */
void link_poll(struct link *link);

/* Every millisecond: what a carrier must look after. */
void link_tick(struct link *link);

/* For the carriers: oldest queued message or NULL; forget it. */
const struct message *link_next(const struct link *link);
void link_done(struct link *link);

uint8_t link_serial_encode(const struct message *message, uint8_t *frame);
bool link_serial_byte(struct link *link, uint8_t byte, struct message *message);
bool link_serial_receive(struct link *link, struct link_message *received);
void link_serial_poll(struct link *link);

bool link_i2c_receive(struct link *link, struct link_message *received);
void link_i2c_poll(struct link *link);
void link_i2c_tick(struct link *link);

void link_can_init(struct link *link);
bool link_can_receive(struct link *link, struct link_message *received);
void link_can_poll(struct link *link);
void link_can_tick(struct link *link);

#endif
