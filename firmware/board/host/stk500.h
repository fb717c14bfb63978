/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a programmer says to an Arduino's boot loader: the commands of STK500 version 1 (AVR061)
 * that Optiboot knows, so that avrdude can write the simulated chip's flash.
 */
#ifndef STK500_H
#define STK500_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define STK500_PAGE_BYTES 128
#define STK500_ARGUMENTS 20
#define STK500_REPLY_BYTES (STK500_PAGE_BYTES + 2)

struct stk500 {
	uint8_t *flash;
	size_t flash_bytes;
	bool synchronized; /* somebody programs: the loader stays */
	bool left;	   /* and has finished */
	uint8_t command;   /* 0: none begun */
	uint8_t arguments[STK500_ARGUMENTS + STK500_PAGE_BYTES];
	size_t count;
	uint32_t address;
};

/* The loader begins: nobody has spoken yet. */
void stk500_start(struct stk500 *loader);

/* One byte from the programmer; gives the length of `reply`, 0: none yet. */
size_t stk500_byte(struct stk500 *loader, uint8_t byte, uint8_t reply[STK500_REPLY_BYTES]);

#endif
