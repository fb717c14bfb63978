/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/stk500.h"

#include <string.h>

#define END ' '
#define IN_SYNC 0x14
#define OK 0x10
#define PAGE_HEAD 3 /* length, high byte first, and which memory */

void stk500_start(struct stk500 *loader)
{
	loader->synchronized = loader->left = false;
	loader->command = 0;
	loader->count = 0;
}

static size_t page_bytes(const struct stk500 *loader)
{
	size_t bytes = loader->arguments[0] << 8 | loader->arguments[1];

	return bytes > STK500_PAGE_BYTES ? STK500_PAGE_BYTES : bytes;
}

/* Bytes between a command and its end. */
static size_t wanted(const struct stk500 *loader)
{
	switch (loader->command) {
	case 'A': /* a parameter */
		return 1;
	case 'B': /* the device */
		return 20;
	case 'E': /* more of the device */
		return 5;
	case 'V': /* an instruction of serial programming */
		return 4;
	case 'U': /* an address in words */
		return 2;
	case 't': /* read a page */
		return PAGE_HEAD;
	case 'd': /* write a page */
		return loader->count < PAGE_HEAD ? PAGE_HEAD + 1 : PAGE_HEAD + page_bytes(loader);
	default:
		return 0;
	}
}

/* Carries a command out; gives the bytes of its answer. */
static size_t execute(struct stk500 *loader, uint8_t *answer)
{
	static const uint8_t signature[] = {0x1E, 0x95, 0x0F}; /* of an ATmega328P */
	const uint8_t *arguments = loader->arguments;
	size_t bytes = page_bytes(loader);

	switch (loader->command) {
	case 'A':
		answer[0] = arguments[0] == 0x81 || arguments[0] == 0x82 ? 4 : 3;
		return 1;
	case 'U':
		loader->address = 2 * (arguments[0] | (uint32_t)arguments[1] << 8);
		return 0;
	case 'V':
		answer[0] = 0;
		return 1;
	case 'u':
		memcpy(answer, signature, sizeof(signature));
		return sizeof(signature);
	case 'Q':
		loader->left = true;
		return 0;
	case 'd':
	case 't':
		if (loader->address + bytes > loader->flash_bytes)
			return 0;
		if (loader->command == 't') {
			memcpy(answer, loader->flash + loader->address, bytes);
			return bytes;
		}
		memcpy(loader->flash + loader->address, arguments + PAGE_HEAD, bytes);
		return 0;
	default:
		return 0;
	}
}

size_t stk500_byte(struct stk500 *loader, uint8_t byte, uint8_t reply[STK500_REPLY_BYTES])
{
	if (!loader->command) {
		loader->command = byte;
		loader->count = 0;
		return 0;
	}
	if (loader->count < wanted(loader)) {
		loader->arguments[loader->count++] = byte;
		return 0;
	}
	size_t bytes = 0;
	if (byte == END) {
		loader->synchronized = true;
		reply[0] = IN_SYNC;
		bytes = 1 + execute(loader, reply + 1);
		reply[bytes++] = OK;
	} else if (loader->synchronized) {
		/* no programmer speaks: it starts the program by its watchdog */
		loader->left = true;
	}
	loader->command = 0;
	return bytes;
}
