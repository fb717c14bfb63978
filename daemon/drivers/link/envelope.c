/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/link/envelope.h"

#include <string.h>

/* CRC-16/CCITT-FALSE. */
static uint16_t crc16(const uint8_t *bytes, size_t count)
{
	uint16_t crc = 0xFFFF;

	for (size_t i = 0; i < count; i++) {
		uint8_t x = (uint8_t)((crc >> 8) ^ bytes[i]);

		x ^= x >> 4;
		crc = (uint16_t)((crc << 8) ^ (x << 12) ^ (x << 5) ^ x);
	}
	return crc;
}

static uint8_t sum_of(const uint8_t *bytes, size_t count)
{
	uint8_t sum = 0;

	for (size_t i = 0; i < count; i++)
		sum = (uint8_t)(sum + bytes[i]);
	return sum;
}

size_t lp_envelope_pack(const struct lp_link_message *message, uint8_t bytes[LP_ENVELOPE_MAX_BYTES])
{
	size_t count = 0;
	uint16_t crc;

	bytes[count++] = message->id;
	memcpy(bytes + count, message->payload, message->length_bytes);
	count += message->length_bytes;
	bytes[count] = sum_of(bytes, count);
	count++;
	crc = crc16(bytes, count);
	bytes[count++] = (uint8_t)(crc & 0xFF);
	bytes[count++] = (uint8_t)(crc >> 8);
	return count;
}

bool lp_envelope_unpack(const uint8_t *bytes, size_t count, struct lp_link_message *message)
{
	if (count < LP_ENVELOPE_EXTRA_BYTES || count > LP_ENVELOPE_MAX_BYTES)
		return false;
	if ((bytes[count - 2] | bytes[count - 1] << 8) != crc16(bytes, count - 2) ||
	    bytes[count - 3] != sum_of(bytes, count - 3))
		return false;
	message->id = bytes[0];
	message->length_bytes = (uint8_t)(count - LP_ENVELOPE_EXTRA_BYTES);
	memset(message->payload, 0, sizeof(message->payload));
	memcpy(message->payload, bytes + 1, message->length_bytes);
	return lp_link_length(message->id) == message->length_bytes;
}

size_t lp_serial_pack(const struct lp_link_message *message,
		      uint8_t bytes[LP_SERIAL_FRAME_MAX_BYTES])
{
	uint8_t envelope[LP_ENVELOPE_MAX_BYTES];
	const size_t count = lp_envelope_pack(message, envelope);
	size_t code = 0; /* where the length of the current block goes */
	size_t end = 1;

	for (size_t i = 0; i < count; i++) {
		if (envelope[i]) {
			bytes[end++] = envelope[i];
		} else {
			bytes[code] = (uint8_t)(end - code);
			code = end++;
		}
	}
	bytes[code] = (uint8_t)(end - code);
	bytes[end++] = 0;
	return end;
}

/* In place; returns the envelope's length, 0 when a block overruns. */
static size_t cobs_decode(uint8_t *bytes, size_t count)
{
	size_t out = 0;

	for (size_t at = 0; at < count;) {
		const size_t block = bytes[at];

		if (block == 0 || at + block > count)
			return 0;
		memmove(bytes + out, bytes + at + 1, block - 1);
		out += block - 1;
		at += block;
		if (at < count)
			bytes[out++] = 0;
	}
	return out;
}

bool lp_serial_read(struct lp_serial_reader *reader, uint8_t byte, struct lp_link_message *message)
{
	const bool ended = byte == 0;
	bool good = false;

	if (!ended) {
		if (reader->count == LP_SERIAL_FRAME_MAX_BYTES - 1)
			reader->overlong = true;
		else
			reader->bytes[reader->count++] = byte;
		return false;
	}
	if (reader->count == 0 && !reader->overlong)
		return false;
	if (!reader->overlong)
		good = lp_envelope_unpack(reader->bytes, cobs_decode(reader->bytes, reader->count),
					  message);
	reader->errors += !good;
	reader->count = 0;
	reader->overlong = false;
	return good;
}
