/* SPDX-License-Identifier: Apache-2.0 */
/* What a client does with a packet: take the length prefix off and decode. */
#ifndef LP_TEST_WIRE_H
#define LP_TEST_WIRE_H

#include <pb_decode.h>
#include <pb_encode.h>

#include "include/packet.h"
#include "lp_test.h"
#include "proto/lightprobe.pb.h"

static inline lightprobe_v1_FromProbe decode_bytes(const uint8_t *data, size_t size)
{
	lightprobe_v1_FromProbe message = lightprobe_v1_FromProbe_init_zero;
	pb_istream_t stream = pb_istream_from_buffer(data, size);

	if (!pb_decode_delimited(&stream, lightprobe_v1_FromProbe_fields, &message))
		fail_msg("no FromProbe message: %s", PB_GET_ERROR(&stream));
	assert_int_equal(stream.bytes_left, 0);
	return message;
}

static inline lightprobe_v1_FromProbe decode_packet(const struct lp_packet *packet)
{
	return decode_bytes(packet->data, packet->size_bytes);
}

/* A Subscription as a client would send it, without its length. */
static inline size_t encode_request(const lightprobe_v1_Subscription *subscription, uint8_t *data,
				    size_t size)
{
	lightprobe_v1_FromClient message = {.which_message = lightprobe_v1_FromClient_subscribe_tag,
					    .message.subscribe = *subscription};
	pb_ostream_t stream = pb_ostream_from_buffer(data, size);

	assert_true(pb_encode(&stream, lightprobe_v1_FromClient_fields, &message));
	return stream.bytes_written;
}

#endif
