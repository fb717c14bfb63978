/* SPDX-License-Identifier: Apache-2.0 */
/* Encoded bytes, shared by every client that gets the same message. Immutable once published. */
#ifndef LP_PACKET_H
#define LP_PACKET_H

#include <stdint.h>

#define LP_PACKET_MAX_BYTES 2112
#define LP_PACKET_LARGE_BYTES                                               \
	100000 /* of the kind that is larger: a reflection map of 64 texels \
		*/

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
	const char *name; /* of its message, as in the schema: "estimate" (static) */
	uint32_t size_bytes;
	void (*release)(struct lp_packet *packet);
	uint8_t *data;		 /* length prefix included: goes to the stream as it is */
	uint32_t capacity_bytes; /* of data, which lives as long as the packet */
};

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
