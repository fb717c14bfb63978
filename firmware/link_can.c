/* SPDX-License-Identifier: Apache-2.0 */
/* CAN frames through an MCP2515 on SPI (datasheet DS20001801). One transmit buffer, so that order
 * is kept. */
#include "link.h"

#include <stddef.h>

#include "board/board.h"
#include "params.h"
#include "safe.h"

/* Instructions. */
#define DO_RESET 0xC0
#define DO_READ 0x03
#define DO_WRITE 0x02
#define DO_STATUS 0xA0
#define DO_READ_RX0 0x90
#define DO_READ_RX1 0x94
#define DO_LOAD_TX0 0x40
#define DO_SEND_TX0 0x81

/* Registers. */
#define RXF0SIDH 0x00
#define RXF3SIDH 0x10
#define RXM0SIDH 0x20
#define CANSTAT 0x0E
#define CANCTRL 0x0F
#define CNF3 0x28
#define EFLG 0x2D
#define RXB0CTRL 0x60
#define TXB0CTRL 0x30

#define MODE_MASK 0xE0
#define MODE_CONFIG 0x80
#define MODE_NORMAL 0x00
#define STATUS_RX0 0x01
#define STATUS_RX1 0x02
#define STATUS_RX (STATUS_RX0 | STATUS_RX1)
#define STATUS_TX0 0x04
#define EFLG_BUS_OFF 0x20
#define RXB0_ROLLOVER 0x04
#define SIDL_REMOTE 0x10
#define SIDL_EXTENDED 0x08

#define HOST_IDS_MASK 0x7C0 /* 0x500 to 0x53F are for the MCU */
#define CHECK_MS 10
#define RETRY_MS 250

static void write_registers(uint8_t address, const uint8_t *values, uint8_t count)
{
	board_spi_select(true);
	board_spi_exchange(DO_WRITE);
	board_spi_exchange(address);
	for (uint8_t i = 0; i < count; i++)
		board_spi_exchange(values[i]);
	board_spi_select(false);
}

static void write_register(uint8_t address, uint8_t value)
{
	write_registers(address, &value, 1);
}

static uint8_t command(uint8_t instruction, uint8_t argument)
{
	board_spi_select(true);
	board_spi_exchange(instruction);
	uint8_t answer = board_spi_exchange(argument);
	board_spi_select(false);
	return answer;
}

static uint8_t read_register(uint8_t address)
{
	board_spi_select(true);
	board_spi_exchange(DO_READ);
	board_spi_exchange(address);
	uint8_t value = board_spi_exchange(0);
	board_spi_select(false);
	return value;
}

static void write_identifier(uint8_t address, uint16_t identifier)
{
	uint8_t registers[4] = {identifier >> 3, (identifier & 7) << 5, 0, 0};

	write_registers(address, registers, sizeof(registers));
}

static uint8_t prescaler_of(const struct params *params)
{
	uint8_t crystal_mhz = param(params, PARAM_CAN_CRYSTAL_MHZ) < 16 ? 8 : 16;
	uint16_t kbit_s = param(params, PARAM_CAN_KBIT_S);
	uint8_t slower = kbit_s >= 500 ? 1 : kbit_s >= 250 ? 2 : 4;

	return crystal_mhz / 8 * slower - 1;
}

/* Bit time of 8 quanta (1 + 2 + 3 + 2), sampled at 75 %. */
static void configure(uint8_t prescaler)
{
	const uint8_t timing[4] = {
		0x01,	   /* CNF3: phase 2 of two quanta */
		0x91,	   /* CNF2: propagation two, phase 1 three */
		prescaler, /* CNF1 */
		0x03,	   /* CANINTE: both receive buffers */
	};

	write_registers(CNF3, timing, sizeof(timing));
	for (uint8_t i = 0; i < 12; i += 4) {
		write_identifier(RXF0SIDH + i, LINK_CAN_BASE);
		write_identifier(RXF3SIDH + i, LINK_CAN_BASE);
	}
	write_identifier(RXM0SIDH, HOST_IDS_MASK);
	write_identifier(RXM0SIDH + 4, HOST_IDS_MASK);
	write_register(RXB0CTRL, RXB0_ROLLOVER);
	write_register(CANCTRL, MODE_NORMAL);
}

static void bring_up(struct link *link)
{
	link->can_up = false;
	link->can_rx1_older = false; /* its buffers will be empty */
	board_spi_select(true);
	board_spi_exchange(DO_RESET);
	board_spi_select(false);
	/* 128 clocks of its oscillator, 16 us at 8 MHz: bytes to nobody take longer. */
	for (uint8_t i = 0; i < 32; i++)
		board_spi_exchange(0);
	if ((read_register(CANSTAT) & MODE_MASK) != MODE_CONFIG) {
		safe_latch(link->safe, FAULT_CAN_ABSENT, 0);
		return;
	}
	configure(link->can_prescaler);
	link->can_up = true;
}

void link_can_init(struct link *link)
{
	link->can_prescaler = prescaler_of(link->params);
	board_spi_start();
	bring_up(link);
}

/* Reads one receive buffer, which frees it. False: a frame that is none of ours. */
static bool read_buffer(struct message *message, uint8_t instruction)
{
	uint8_t header[5];

	board_spi_select(true);
	board_spi_exchange(instruction);
	for (uint8_t i = 0; i < sizeof(header); i++)
		header[i] = board_spi_exchange(0);
	message->length_bytes = header[4] & 0x0F;
	if (message->length_bytes > MESSAGE_MAX_BYTES)
		message->length_bytes = MESSAGE_MAX_BYTES;
	for (uint8_t i = 0; i < message->length_bytes; i++)
		message->payload[i] = board_spi_exchange(0);
	board_spi_select(false);
	message->id = (uint8_t)(header[0] << 3 | header[1] >> 5);
	return !(header[1] & (SIDL_REMOTE | SIDL_EXTENDED)) && header[0] >> 3 == LINK_CAN_BASE >> 6;
}

/*
 * The controller fills buffer 1 only while buffer 0 is full. So what is in buffer 1 when buffer 0
 * has just been read is older than whatever comes into buffer 0 next.
 */
bool link_can_receive(struct link *link, struct link_message *received)
{
	bool fresh;

	if (!link->can_up || !board_can_waiting(&received->t_rx_us, &fresh))
		return false;
	uint8_t full = command(DO_STATUS, 0) & STATUS_RX;
	if (!full)
		return false;
	received->stamped = fresh && full != STATUS_RX;
	bool from_rx1 = full == STATUS_RX1 || (full == STATUS_RX && link->can_rx1_older);
	bool ours = read_buffer(&received->message, from_rx1 ? DO_READ_RX1 : DO_READ_RX0);
	link->can_rx1_older = !from_rx1 && command(DO_STATUS, 0) & STATUS_RX1;
	if (!ours)
		link->rx_bad++;
	return ours;
}

void link_can_poll(struct link *link)
{
	const struct message *next = link_next(link);

	if (!next || !link->can_up || command(DO_STATUS, 0) & STATUS_TX0)
		return;
	uint16_t identifier = LINK_CAN_BASE + next->id;
	board_spi_select(true);
	board_spi_exchange(DO_LOAD_TX0);
	board_spi_exchange(identifier >> 3);
	board_spi_exchange((identifier & 7) << 5);
	board_spi_exchange(0);
	board_spi_exchange(0);
	board_spi_exchange(next->length_bytes);
	for (uint8_t i = 0; i < next->length_bytes; i++)
		board_spi_exchange(next->payload[i]);
	board_spi_select(false);
	board_spi_select(true);
	board_spi_exchange(DO_SEND_TX0);
	board_spi_select(false);
	link_done(link);
}

/* A lost controller is started again; bus-off ends by itself after 128 quiet moments on the bus. */
void link_can_tick(struct link *link)
{
	if (++link->can_check_ms < (link->can_up ? CHECK_MS : RETRY_MS))
		return;
	link->can_check_ms = 0;
	if (!link->can_up || (read_register(CANSTAT) & MODE_MASK) != MODE_NORMAL)
		bring_up(link);
	else if (read_register(EFLG) & EFLG_BUS_OFF)
		safe_latch(link->safe, FAULT_CAN_BUS_OFF, 0);
}
