/* SPDX-License-Identifier: Apache-2.0 */
/* The CAN controller on the chip's SPI, as far as the firmware uses it; its bus ends in a file
 * descriptor. */
#ifndef MCP2515_H
#define MCP2515_H

#include <stdbool.h>
#include <stdint.h>

struct chip;
struct mcp2515;

/* A frame as it travels on the socket: Linux's struct can_frame. */
struct can_record {
	uint32_t identifier; /* bit 31: extended, bit 30: remote */
	uint8_t length, padding[3];
	uint8_t data[8];
};

struct mcp2515 *mcp2515_create(struct chip *chip);
void mcp2515_destroy(struct mcp2515 *can);

/* Where frames that the chip sends go; may be NULL. */
void mcp2515_on_frame(struct mcp2515 *can, void (*frame)(void *context, const struct can_record *),
		      void *context);

/* A frame comes from the bus; false when it was lost (buffers full, filtered, bus off). */
bool mcp2515_receive(struct mcp2515 *can, const struct can_record *frame);

/* Faults: off the bus; not there at all. */
void mcp2515_bus_off(struct mcp2515 *can, bool off);
void mcp2515_absent(struct mcp2515 *can, bool absent);

#endif
