/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The hardware contract: all that the portable firmware (../ *.c) knows of a chip. One folder per
 * board implements it: atmega328p (the real one), host (a Linux process on a pty).
 *
 * Called from the main loop only (board_time_us() from anywhere); nothing blocks longer than said.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* Constant tables that must not cost RAM: in flash where that is another address space. */
#ifdef __AVR__
#define BOARD_FLASH __flash
#else
#define BOARD_FLASH
#endif

#define BOARD_LDRS 9
#define BOARD_MAIL_BYTES 13 /* one I2C transaction: length, envelope (proto/mcu.md) */

/* Same values as Hello.board and Hello.reset_cause; messages.c asserts it. */
enum board_kind { BOARD_HOST = 0, BOARD_ATMEGA328P = 1 };
enum reset_cause {
	RESET_CAUSE_UNKNOWN, /* a boot loader hides it */
	RESET_CAUSE_POWER_ON,
	RESET_CAUSE_EXTERNAL,
	RESET_CAUSE_BROWN_OUT,
	RESET_CAUSE_WATCHDOG,
	RESET_CAUSE_STACK,
	RESET_CAUSE_REQUESTED,
};

/* Same values as Capabilities.carrier. */
enum carrier { CARRIER_SERIAL, CARRIER_I2C, CARRIER_CAN };

struct board_info {
	uint8_t kind;	     /* enum board_kind */
	uint8_t reset_cause; /* enum reset_cause */
	uint8_t carrier;     /* enum carrier, as strapped */
	uint16_t boot_count;
};

/* Pins, clock, servo released, interrupts on; watchdog running (125 ms to the servo's release, 250
 * ms to the reset). */
void board_init(struct board_info *info);

/* The clock: microseconds since board_init(), modulo 2^32. */
uint32_t board_time_us(void);

/* Tells the watchdog that the main loop lives. */
void board_alive(void);

/* Sleeps until there may be something to do: 1 ms at most. */
void board_idle(void);

/* Releases the servo and resets the chip, with `cause` in the next board_info. Does not return on a
 * chip; takes up to the watchdog's time. */
void board_reset(enum reset_cause cause);

/* False once the stack has grown into the guard: data may be corrupt. */
bool board_stack_ok(void);
uint16_t board_stack_free_bytes(void);

/*
 * Servo pulse width in half microseconds, every 20 ms; takes effect with the next pulse. 0 releases
 * the servo: no pulse, supply switch off.
 */
void board_servo(uint16_t half_us);

/*
 * The comb's two sensors, decoded as quadrature: `count` goes up by one at every edge that passes
 * upwards, down downwards; levels are bits 0 and 1, set on a tooth. `changes` counts all edges,
 * `errors` those where both sensors changed at once, so that the direction was lost.
 */
struct board_index {
	int16_t count;
	uint8_t levels;
	uint8_t changes, errors; /* modulo 256 */
};
void board_index(struct board_index *index);

/*
 * Starts sampling, one slot every so many microseconds: slots 0 to 8 are the LDRs, then one of
 * (feedback, supply) alternately. Levels are 10-bit shares of the supply, except the supply's own
 * slot: the 1.1 V reference as a share of the supply. Called again, it begins anew with slot 0; a
 * conversion under way is thrown away. May be called between board_lock() and board_unlock().
 */
enum board_slot { BOARD_SLOT_FEEDBACK = BOARD_LDRS, BOARD_SLOT_SUPPLY };
void board_sample(uint8_t period_us);
/* Every conversion, FROM THE INTERRUPT: a few microseconds at most. The board calls it; ring.c has
 * it. */
void board_on_conversion(uint8_t slot, uint16_t level);

/* Keeps interrupts out while the main loop copies what they write. Not nested; microseconds. */
void board_lock(void);
void board_unlock(void);

/* EEPROM, at least 512 bytes. A write takes 3.4 ms; until ready() says that it has ended, read()
 * and write() must not be called. */
bool board_eeprom_ready(void);
uint8_t board_eeprom_read(uint16_t address);
void board_eeprom_write(uint16_t address, uint8_t value);

/* Serial line. get() returns -1 when nothing waits; put() takes all bytes or none. */
int16_t board_uart_get(void);
bool board_uart_put(const uint8_t *bytes, uint8_t count);
/* Time of the zero byte that get() returned last; false when another one has come since. */
bool board_uart_stamp(uint32_t *t_us);
uint8_t board_uart_overruns(void);

/*
 * I2C slave. receive(): the bytes of one finished write transaction, false when there is none.
 * offer(): what the next read transaction gets; false while the former offer has not been read
 * whole. bus_errors(): illegal start or stop conditions seen since the start.
 */
void board_i2c_start(uint8_t address);
bool board_i2c_receive(uint8_t *bytes, uint8_t *count, uint32_t *t_us);
bool board_i2c_offer(const uint8_t *bytes);
uint8_t board_i2c_bus_errors(void);

/* SPI to the CAN controller: chip select, one byte exchanged (2 us), interrupt pin (low), and when
 * it fell; `fresh`: it has fallen since the last call that returned true. */
void board_spi_start(void);
void board_spi_select(bool selected);
uint8_t board_spi_exchange(uint8_t byte);
bool board_can_waiting(uint32_t *t_us, bool *fresh);

#endif
