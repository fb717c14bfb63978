/* SPDX-License-Identifier: Apache-2.0 */
#include "mcp2515.h"

#include <stdlib.h>
#include <string.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_spi.h>

#include "chip.h"

/* Pins: firmware/board/atmega328p/pins.h. */
#define SELECT_BIT 1
#define INTERRUPT_BIT 0
#define REGISTER_SPDR 0x4E /* in data space */

#define CANSTAT 0x0E
#define CANCTRL 0x0F
#define CANINTE 0x2B
#define CANINTF 0x2C
#define EFLG 0x2D
#define TXB0CTRL 0x30
#define RXB0CTRL 0x60
#define RXM0SIDH 0x20
#define MODE_CONFIG 0x80
#define TXREQ 0x08
#define BUS_OFF 0x20

#define FRAME_BITS 130 /* at most, stuffed */

struct mcp2515 {
	struct chip *chip;
	avr_spi_t *spi;
	uint8_t registers[128];
	bool selected, absent;
	uint8_t instruction, address, count; /* bytes of the transfer so far */
	void (*frame)(void *context, const struct can_record *frame);
	void *context;
};

static void reset(struct mcp2515 *can)
{
	memset(can->registers, 0, sizeof(can->registers));
	can->registers[CANSTAT] = can->registers[CANCTRL] = MODE_CONFIG;
}

static void update_interrupt(struct mcp2515 *can)
{
	bool pending = can->registers[CANINTF] & can->registers[CANINTE];

	chip_pin(can->chip, 'B', INTERRUPT_BIT, !pending || can->absent);
}

static bool on_bus(const struct mcp2515 *can)
{
	return !can->absent && can->registers[CANSTAT] == 0 && !(can->registers[EFLG] & BUS_OFF);
}

static avr_cycle_count_t transmit_timer(avr_t *avr, avr_cycle_count_t when, void *context)
{
	struct mcp2515 *can = context;
	const uint8_t *buffer = &can->registers[TXB0CTRL + 1];
	struct can_record record = {0};

	(void)avr, (void)when;
	if (!(can->registers[TXB0CTRL] & TXREQ) || !on_bus(can))
		return 0;
	record.identifier = buffer[0] << 3 | buffer[1] >> 5;
	record.length = buffer[4] & 0x0F;
	memcpy(record.data, buffer + 5, 8);
	can->registers[TXB0CTRL] &= ~TXREQ;
	if (can->frame)
		can->frame(can->context, &record);
	return 0;
}

/* Eight quanta a bit, each 2 (prescaler + 1) clocks of an 8 MHz crystal. */
static void start_transmit(struct mcp2515 *can)
{
	unsigned prescaler = (can->registers[0x2A] & 0x3F) + 1;
	uint64_t bit_cycles = CHIP_HZ / 8000000 * 2 * prescaler * 8;

	if (can->registers[TXB0CTRL] & TXREQ && on_bus(can))
		avr_cycle_timer_register(can->chip->avr, FRAME_BITS * bit_cycles, transmit_timer,
					 can);
}

static void write_register(struct mcp2515 *can, uint8_t address, uint8_t value)
{
	if (address == CANSTAT)
		return;
	can->registers[address] = value;
	if (address == CANCTRL)
		can->registers[CANSTAT] = value & 0xE0;
	if (address == TXB0CTRL)
		start_transmit(can);
}

static uint8_t status(const struct mcp2515 *can)
{
	uint8_t received = can->registers[CANINTF] & 3;

	return received | (can->registers[TXB0CTRL] & TXREQ ? 0x04 : 0);
}

/* One byte of a transfer: takes `in`, gives back what the controller puts on MISO meanwhile. */
static uint8_t exchange(struct mcp2515 *can, uint8_t in)
{
	uint8_t count = can->count++;

	if (count == 0) {
		can->instruction = in;
		if (in == 0xC0)
			reset(can);
		if (in == 0x81) {
			can->registers[TXB0CTRL] |= TXREQ;
			start_transmit(can);
		}
		can->address = in == 0x40   ? TXB0CTRL + 1
			       : in == 0x90 ? RXB0CTRL + 1
			       : in == 0x94 ? RXB0CTRL + 0x11
					    : 0;
		return 0;
	}
	switch (can->instruction) {
	case 0x02: /* write */
		if (count == 1)
			can->address = in;
		else
			write_register(can, can->address++ & 0x7F, in);
		return 0;
	case 0x03: /* read */
		if (count == 1) {
			can->address = in;
			return 0;
		}
		return can->registers[can->address++ & 0x7F];
	case 0x40: /* load the transmit buffer */
		can->registers[can->address++ & 0x7F] = in;
		return 0;
	case 0x90: /* read a receive buffer */
	case 0x94:
		return can->registers[can->address++ & 0x7F];
	case 0xA0:
		return status(can);
	default:
		return 0;
	}
}

static void on_select(struct avr_irq_t *irq, uint32_t value, void *context)
{
	struct mcp2515 *can = context;
	bool selected = !(value & 1);

	(void)irq;
	if (can->selected && !selected && can->count) {
		if (can->instruction == 0x90)
			can->registers[CANINTF] &= ~1;
		if (can->instruction == 0x94)
			can->registers[CANINTF] &= ~2;
		update_interrupt(can);
	}
	if (selected && !can->selected)
		can->count = 0;
	can->selected = selected;
}

/* simavr takes 100 us for a byte; the real thing 1 us: the exchange is done at once. */
static void on_byte(avr_t *avr, avr_io_addr_t address, uint8_t value, void *context)
{
	struct mcp2515 *can = context;
	uint8_t out = 0xFF;

	(void)address;
	if (can->selected && !can->absent)
		out = exchange(can, value);
	can->spi->input_data_register = out;
	avr_regbit_set(avr, can->spi->spi.raised);
}

static bool accepted(const struct mcp2515 *can, uint16_t identifier)
{
	uint16_t mask = can->registers[RXM0SIDH] << 3 | can->registers[RXM0SIDH + 1] >> 5;
	uint16_t filter = can->registers[0] << 3 | can->registers[1] >> 5;

	return ((identifier ^ filter) & mask) == 0;
}

bool mcp2515_receive(struct mcp2515 *can, const struct can_record *frame)
{
	bool extended = frame->identifier >> 31;
	uint16_t identifier = frame->identifier & 0x7FF;
	uint8_t full = can->registers[CANINTF] & 3;
	int buffer = full & 1;

	/* The filters here are for standard frames. */
	if (!on_bus(can) || extended || !accepted(can, identifier) || full == 3)
		return false;
	uint8_t *to = &can->registers[RXB0CTRL + 1 + 0x10 * buffer];
	to[0] = identifier >> 3;
	to[1] = (identifier & 7) << 5 | (frame->identifier >> 30 & 1 ? 0x10 : 0);
	to[2] = to[3] = 0;
	to[4] = frame->length;
	memcpy(to + 5, frame->data, 8);
	can->registers[CANINTF] |= 1 << buffer;
	update_interrupt(can);
	return true;
}

void mcp2515_bus_off(struct mcp2515 *can, bool off)
{
	if (off)
		can->registers[EFLG] |= BUS_OFF;
	else
		can->registers[EFLG] &= ~BUS_OFF;
	start_transmit(can);
}

void mcp2515_absent(struct mcp2515 *can, bool absent)
{
	can->absent = absent;
	if (absent)
		reset(can);
	update_interrupt(can);
}

void mcp2515_on_frame(struct mcp2515 *can, void (*frame)(void *context, const struct can_record *),
		      void *context)
{
	can->frame = frame;
	can->context = context;
}

struct mcp2515 *mcp2515_create(struct chip *chip)
{
	struct mcp2515 *can = calloc(1, sizeof(*can));

	can->chip = chip;
	for (avr_io_t *io = chip->avr->io_port; io; io = io->next) {
		if (strcmp(io->kind, "spi") == 0)
			can->spi = (avr_spi_t *)io;
	}
	reset(can);
	avr_register_io_write(chip->avr, REGISTER_SPDR, on_byte, can);
	avr_irq_register_notify(avr_io_getirq(chip->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), SELECT_BIT),
				on_select, can);
	update_interrupt(can);
	return can;
}

void mcp2515_destroy(struct mcp2515 *can)
{
	free(can);
}
