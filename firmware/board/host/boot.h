/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the boot loader of an Arduino Nano does between a reset and the firmware: how long it waits
 * for a programmer, and what it leaves of the reset's cause. Read from the sources of the loaders
 * (Optiboot's optiboot.c, ArduinoCore-avr's ATmegaBOOT_168.c).
 */
#ifndef BOOT_H
#define BOOT_H

#include <stdbool.h>
#include <stdint.h>

enum boot_loader {
	BOOT_NONE,	   /* flashed with a programmer */
	BOOT_ATMEGABOOT,   /* "old boot loader", 57600 baud; hangs after a watchdog reset */
	BOOT_OPTIBOOT_4_4, /* what Arduino ships: hides the cause */
	BOOT_OPTIBOOT_4_6, /* to 6.2: the cause is in r2; its own watchdog hides a reset by DTR */
	BOOT_OPTIBOOT_7,   /* and later: MCUSR tells it */
};

/* Bits of MCUSR, the chip's register of reset causes. */
#define BOOT_POWER_ON 0x01
#define BOOT_EXTERNAL 0x02
#define BOOT_BROWN_OUT 0x04
#define BOOT_WATCHDOG 0x08

struct boot {
	bool waits; /* for a programmer, before it starts the firmware */
	bool hangs; /* never starts it */
	uint8_t mcusr;
	bool r2_set;
	uint8_t r2;
};

/* The loader's part after a reset that left `mcusr`. */
struct boot boot_after(enum boot_loader loader, uint8_t mcusr);

#endif
