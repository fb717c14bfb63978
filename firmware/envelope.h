/* SPDX-License-Identifier: Apache-2.0 */
/* Messages and their envelope on serial and I2C: proto/mcu.md. */
#ifndef ENVELOPE_H
#define ENVELOPE_H

#include <stdbool.h>
#include <stdint.h>

#define MESSAGE_MAX_BYTES 8
#define ENVELOPE_EXTRA_BYTES 4 /* id, sum, CRC */
#define ENVELOPE_MAX_BYTES (MESSAGE_MAX_BYTES + ENVELOPE_EXTRA_BYTES)

struct message {
	uint8_t id;
	uint8_t length_bytes;
	uint8_t payload[MESSAGE_MAX_BYTES];
};

#define CRC16_START 0xFFFF

/* CRC-16/CCITT-FALSE, one byte further. */
uint16_t crc16(uint16_t crc, uint8_t byte);

/* Writes the envelope to `bytes` (ENVELOPE_MAX_BYTES); returns its length. */
uint8_t envelope_pack(const struct message *message, uint8_t *bytes);

/* False when length, CRC or sum do not fit. Whether the id has this length is the reader's to
 * check. */
bool envelope_unpack(const uint8_t *bytes, uint8_t count, struct message *message);

#endif
