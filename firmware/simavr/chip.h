/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The flashed ATmega328P in libsimavr, with the simulated box (board/host/world.h) on its pins. The
 * chip's time is its cycle counter; nothing here knows wall-clock time.
 */
#ifndef CHIP_H
#define CHIP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <simavr/sim_avr.h>

#include "board/host/boot.h"
#include "board/host/frame_log.h"
#include "board/host/stk500.h"
#include "board/host/world.h"

#define CHIP_HZ 16000000
#define CHIP_US(us) ((uint64_t)(us) * (CHIP_HZ / 1000000))
#define CHIP_LINE_BYTES 65536 /* powers of two */
#define CHIP_BYTE_US 20	      /* 500 kbaud */

struct chip_servo {
	uint64_t pulses, first_us, last_us; /* since the last question */
	double least_us, most_us, period_us;
};

struct mcp2515;
struct twi_master;

struct chip {
	avr_t *avr;
	struct world world;
	struct mcp2515 *can;
	bool dead; /* crashed or asleep for ever */
	unsigned resets;

	uint8_t mux;  /* 74HC4067's channel */
	double strap; /* share of the supply on the strap pin */
	avr_irq_t *adc, *uart_in;
	double adc_mv;		/* of the pin that was converted last */
	uint64_t bandgap_cycle; /* the ADC was switched to the reference then */
	bool bandgap;		/* it is there still */
	bool reset, booting;	/* the boot loader is to begin; has the chip, */
	uint64_t boot_cycle;	/* until then; UINT64_MAX: for ever */
	struct boot boot;
	struct stk500 programmer;
	unsigned wdt_pending_us; /* the watchdog's interrupt has waited so long */
	bool wdt_bites;
	uint64_t asleep_cycles, load_cycle;
	uint64_t woken_cycle, longest_awake_cycles;
	uint64_t rise_cycle;
	bool pulse_high;
	struct chip_servo servo;

	uint8_t line_in[CHIP_LINE_BYTES];
	unsigned line_in_first, line_in_end;
	uint16_t worn_address; /* of an EEPROM cell, of which these bits keep what they held then */
	uint8_t worn_bits, worn_held;
	bool line_in_running, line_in_wait;
	/* Sent and not yet taken; called for every byte, may be NULL. */
	void (*line_out)(void *context, uint8_t byte);
	void *line_out_context;
	struct frame_log log;

	/* I2C: what the chip did with the injected state. */
	bool twi_answered, twi_acknowledged;
	uint8_t twi_data;
	uint64_t twi_cycle;

	uint8_t external_mask[3], external_value[3]; /* pins driven from outside: ports B, C, D */
};

/* Loads the ELF; NULL with a message on stderr. `carrier` is strapped: "serial", "i2c" or "can". */
struct chip *chip_create(const char *elf, const char *carrier, uint32_t seed);
void chip_destroy(struct chip *chip);

/* Whether the boot loader has the chip: what comes on the serial line is for it. */
bool chip_booting(const struct chip *chip);

/* Runs to a cycle count, or until the chip is dead. */
void chip_run_until(struct chip *chip, uint64_t cycle);

enum chip_reset { CHIP_POWER_ON, CHIP_BROWN_OUT, CHIP_EXTERNAL, CHIP_WATCHDOG };
void chip_reset(struct chip *chip, enum chip_reset why);

/* Level of an input pin, 'B' to 'D'. */
void chip_pin(struct chip *chip, char port, uint8_t bit, bool high);

/* Queues bytes for the chip's receiver; false when there is no room. */
bool chip_send(struct chip *chip, const uint8_t *bytes, size_t count);

#define CHIP_EEPROM_BYTES 1024
uint8_t *chip_eeprom(struct chip *chip);

/*
 * An I2C master's transaction with the chip as slave. Returns bytes acknowledged (write) or read;
 * -1: the address was not acknowledged. `stretch_us`: the longest that the chip held the clock.
 */
int chip_twi_write(struct chip *chip, const uint8_t *bytes, int count, double *stretch_us);
int chip_twi_read(struct chip *chip, uint8_t *bytes, int count, double *stretch_us);
void chip_twi_error(struct chip *chip);

#endif
