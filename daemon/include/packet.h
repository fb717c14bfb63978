/* SPDX-License-Identifier: Apache-2.0 */
/* Encoded bytes, shared by every client that gets the same message. Immutable once published. */
#ifndef LP_PACKET_H
#define LP_PACKET_H

#include <stdint.h>

#define LP_PACKET_MAX_BYTES 2048
#define LP_PACKET_LARGE_BYTES 100000 /* a reflection map of 64 texels: 96 KiB, and its header */

/* What a slow client may lose: a newer STATE replaces an older one still unsent, and a newer
 * PICTURE an older one; CONTROL is kept. */
enum lp_packet_kind {
	LP_PACKET_STATE,
	LP_PACKET_CONTROL,
	LP_PACKET_PICTURE, /* large: all else goes first */
};

/* Counted reference; all calls on the loop thread. `release` puts it back into its pool. */
struct lp_packet {
	uint32_t references;
	enum lp_packet_kind kind;
	uint32_t size_bytes;
	void (*release)(struct lp_packet *packet);
	uint8_t *large; /* in place of `data`: of a message that is longer; NULL: it is in `data` */
	uint8_t data[LP_PACKET_MAX_BYTES]; /* length prefix included: goes to the stream as it is */
};

static inline const uint8_t *lp_packet_bytes(const struct lp_packet *packet)
{
	return packet->large ? packet->large : packet->data;
}

static inline struct lp_packet *lp_packet_hold(struct lp_packet *packet)
{
	packet->references++;
	return packet;
}

static inline void lp_packet_drop(struct lp_packet *packet)
{
	if (packet && --packet->references == 0)
		packet->release(packet);
}

#endif
