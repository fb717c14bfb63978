/* SPDX-License-Identifier: Apache-2.0 */
/* Little-endian numbers into and out of buffers; each put returns the place after what it wrote. */
#ifndef UVC_CAMERA_BYTES_H
#define UVC_CAMERA_BYTES_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint8_t *put8(uint8_t *at, uint8_t value)
{
	*at++ = value;
	return at;
}

static inline uint8_t *put16(uint8_t *at, uint16_t value)
{
	return put8(put8(at, (uint8_t)value), (uint8_t)(value >> 8));
}

static inline uint8_t *put32(uint8_t *at, uint32_t value)
{
	return put16(put16(at, (uint16_t)value), (uint16_t)(value >> 16));
}

static inline uint8_t *put_bytes(uint8_t *at, const void *bytes, size_t size_bytes)
{
	memcpy(at, bytes, size_bytes);
	return at + size_bytes;
}

static inline uint32_t get_le(const uint8_t *at, size_t size_bytes)
{
	uint32_t value = 0;

	for (size_t i = 0; i < size_bytes; i++)
		value |= (uint32_t)at[i] << (8 * i);
	return value;
}

#endif
