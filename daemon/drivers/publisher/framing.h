/* SPDX-License-Identifier: Apache-2.0 */
/* "Delimited" protobuf: each message after its length as a base-128 varint. */
#ifndef LP_PUBLISHER_FRAMING_H
#define LP_PUBLISHER_FRAMING_H

#include <stddef.h>
#include <stdint.h>

#define LP_LENGTH_MAX_BYTES 5 /* of a varint of 32 bits */

/*
 * The first message in `data`: its bytes are [*offset, *offset + *size). 1: whole. 0: more bytes
 * are needed. -EBADMSG: no varint of 32 bits. -EMSGSIZE: longer than `max_bytes` (*size says how
 * long).
 */
int lp_framing_next(const uint8_t *data, size_t size_bytes, size_t max_bytes, size_t *offset,
		    size_t *size);

#endif
