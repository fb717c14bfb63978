/* SPDX-License-Identifier: Apache-2.0 */
/* The envelope of serial and I2C, and COBS: proto/mcu.md. Pure. */
#ifndef LP_LINK_ENVELOPE_H
#define LP_LINK_ENVELOPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "drivers/link/carrier.h"

#define LP_ENVELOPE_EXTRA_BYTES 4
#define LP_ENVELOPE_MAX_BYTES (LP_LINK_MAX_BYTES + LP_ENVELOPE_EXTRA_BYTES)
#define LP_SERIAL_FRAME_MAX_BYTES (LP_ENVELOPE_MAX_BYTES + 2)

/* Returns the envelope's length. */
size_t lp_envelope_pack(const struct lp_link_message *message,
			uint8_t bytes[LP_ENVELOPE_MAX_BYTES]);

/* False when length, sum or CRC do not fit, or the id has another length. */
bool lp_envelope_unpack(const uint8_t *bytes, size_t count, struct lp_link_message *message);

/* A whole frame with its closing zero; returns its length. */
size_t lp_serial_pack(const struct lp_link_message *message,
		      uint8_t bytes[LP_SERIAL_FRAME_MAX_BYTES]);

/* What has come since the last zero byte. Zeroed at the start. */
struct lp_serial_reader {
	uint8_t bytes[LP_SERIAL_FRAME_MAX_BYTES];
	uint8_t count;
	bool overlong;
	uint64_t errors; /* frames that were no message */
};

/* One byte; true when it completes a message. */
bool lp_serial_read(struct lp_serial_reader *reader, uint8_t byte, struct lp_link_message *message);

#endif
