/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The host board: the same firmware as a Linux process, around the simulated box of world.h. Its
 * time is virtual: whoever runs it says how much passes (main.c: as much as the wall clock's;
 * tests: as they like).
 */
#ifndef HOST_H
#define HOST_H

#include <stdbool.h>
#include <stdint.h>

#include "board/board.h"
#include "board/host/stk500.h"
#include "board/host/world.h"

#define HOST_EEPROM_BYTES 1024
#define HOST_FLASH_BYTES 32768
#define HOST_LINE_BYTES 4096 /* a power of two */

struct host {
	struct world world;
	uint64_t t_us;
	uint8_t eeprom[HOST_EEPROM_BYTES];
	uint64_t eeprom_ready_us;
	uint16_t worn_address; /* of a cell, of which these bits keep what they held then */
	uint8_t worn_bits, worn_held;
	uint8_t carrier;
	enum reset_cause reset_cause; /* of the next board_init() */
	bool reset_asked;
	uint8_t flash[HOST_FLASH_BYTES]; /* what a programmer has written; it is not run */
	struct stk500 programmer;
	uint64_t boot_us; /* the boot loader has the chip until then; UINT64_MAX: for ever */
	uint16_t boot_count;

	uint16_t servo_half_us;
	uint64_t frame_us; /* start of the next servo frame */
	struct board_index index;

	uint8_t sample_us; /* 0: not sampling */
	uint64_t sample_next_us;
	uint8_t slot;
	bool supply_turn;

	uint8_t in[HOST_LINE_BYTES];
	unsigned in_first, in_end;
	uint32_t zero_us;
	unsigned zeros;
	uint8_t overruns;
	/* Takes what the firmware sends. */
	void (*out)(void *context, const uint8_t *bytes, uint8_t count);
	void *context;

	/* The I2C mailbox as the slave sees it, the CAN controller as SPI bytes. */
	uint8_t mail_in[BOARD_MAIL_BYTES], mail_in_count;
	uint8_t mail_out[BOARD_MAIL_BYTES];
	bool mail_waits, mail_offered;
	uint8_t bus_errors;
	uint8_t (*spi)(void *context, uint8_t byte);
	bool can_waiting;
};

/* The one box of this process: board.h has no context. */
extern struct host host;

void host_init(uint32_t seed);

/* After board_reset(): the boot loader begins. True while it has the chip: the firmware does not
 * run. */
void host_boot(void);
bool host_booting(void);

/* Lets time pass for everything but the firmware. */
void host_pass(uint32_t us);

/* Bytes for the firmware's receiver. */
void host_send(const uint8_t *bytes, unsigned count);

#endif
