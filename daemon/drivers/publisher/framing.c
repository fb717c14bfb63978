/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/framing.h"

#include <errno.h>

int lp_framing_next(const uint8_t *data, size_t size_bytes, size_t max_bytes, size_t *offset,
		    size_t *size)
{
	uint64_t length = 0;

	for (size_t i = 0; i < LP_LENGTH_MAX_BYTES; i++) {
		if (i == size_bytes)
			return 0;
		length |= (uint64_t)(data[i] & 0x7f) << (7 * i);
		if (data[i] & 0x80)
			continue;
		if (length > UINT32_MAX)
			return -EBADMSG;
		*offset = i + 1;
		*size = (size_t)length;
		if (length > max_bytes)
			return -EMSGSIZE;
		return size_bytes - *offset >= length;
	}
	return -EBADMSG;
}
