/* SPDX-License-Identifier: Apache-2.0 */
/* Where the first JPEG in some bytes begins: the one rule of sources and of the decoder. */
#ifndef LP_BASE_JPEG_START_H
#define LP_BASE_JPEG_START_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/*
 * Offset of the first JPEG in `data` at or after `from`; `size_bytes` when there is none. A JPEG
 * that ends where it begins (FF D8 FF D9) is none: some encoders send such before the picture.
 */
static inline size_t lp_jpeg_start(const uint8_t *data, size_t size_bytes, size_t from)
{
	while (from + 3 <= size_bytes) {
		const uint8_t *soi = (const uint8_t *)memchr(data + from, 0xff, size_bytes - from);
		size_t next;

		if (!soi)
			break;
		from = (size_t)(soi - data);
		if (from + 3 > size_bytes)
			break;
		if (soi[1] != 0xd8 || soi[2] != 0xff) {
			from++;
			continue;
		}
		next = from + 3;
		while (next < size_bytes && data[next] == 0xff) /* fill bytes */
			next++;
		if (next == size_bytes || data[next] != 0xd9)
			return from;
		from = next + 1;
	}
	return size_bytes;
}

#endif
