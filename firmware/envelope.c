/* SPDX-License-Identifier: Apache-2.0 */
#include "envelope.h"

/* Not inlined: its shifts are long on an 8-bit machine, and there are several callers. */
__attribute__((noinline)) uint16_t crc16(uint16_t crc, uint8_t byte)
{
	uint8_t x = (uint8_t)(crc >> 8) ^ byte;

	x ^= x >> 4;
	return (uint16_t)(crc << 8) ^ (uint16_t)((uint16_t)x << 12) ^ (uint16_t)((uint16_t)x << 5) ^
	       x;
}

uint8_t envelope_pack(const struct message *message, uint8_t *bytes)
{
	uint8_t count = 0;
	uint8_t sum = message->id;
	uint16_t crc = crc16(CRC16_START, message->id);

	bytes[count++] = message->id;
	for (uint8_t i = 0; i < message->length_bytes; i++) {
		uint8_t byte = message->payload[i];
		bytes[count++] = byte;
		sum += byte;
		crc = crc16(crc, byte);
	}
	bytes[count++] = sum;
	crc = crc16(crc, sum);
	bytes[count++] = crc & 0xFF;
	bytes[count++] = crc >> 8;
	return count;
}

bool envelope_unpack(const uint8_t *bytes, uint8_t count, struct message *message)
{
	uint8_t sum = 0;
	uint16_t crc = CRC16_START;

	if (count < ENVELOPE_EXTRA_BYTES || count > ENVELOPE_MAX_BYTES)
		return false;
	for (uint8_t i = 0; i < count - 2; i++) {
		crc = crc16(crc, bytes[i]);
		if (i < count - 3)
			sum += bytes[i];
	}
	if (bytes[count - 2] != (crc & 0xFF) || bytes[count - 1] != crc >> 8 ||
	    bytes[count - 3] != sum)
		return false;
	message->id = bytes[0];
	message->length_bytes = count - ENVELOPE_EXTRA_BYTES;
	for (uint8_t i = 0; i < message->length_bytes; i++)
		message->payload[i] = bytes[1 + i];
	return true;
}
