/* SPDX-License-Identifier: Apache-2.0 */
#include "negotiation.h"
#include <stdlib.h>
#include <string.h>
#include "bytes.h"

const struct camera_size *agreed_size(const struct agreement *agreement)
{
	return &camera_streams[agreement->format_index - 1].sizes[agreement->size_index - 1];
}

struct agreement negotiate(const uint8_t asked[PROBE_BYTES])
{
	struct agreement agreement = {.format_index = asked[2], .size_index = asked[3]};
	uint32_t interval = get_le(asked + 4, 4);
	const struct camera_size *size;

	if (agreement.format_index < 1 || agreement.format_index > CAMERA_FORMATS)
		agreement.format_index = 1;
	if (agreement.size_index < 1 ||
	    agreement.size_index > camera_size_count(agreement.format_index - 1))
		agreement.size_index = 1;
	size = agreed_size(&agreement);
	agreement.interval = CAMERA_INTERVAL_HZ / size->rates_hz[0];
	for (int i = 0; i < camera_rate_count(size); i++) {
		uint32_t offered = CAMERA_INTERVAL_HZ / size->rates_hz[i];

		if (labs((long)offered - (long)interval) <
		    labs((long)agreement.interval - (long)interval))
			agreement.interval = offered;
	}
	return agreement;
}

void put_probe(uint8_t data[PROBE_BYTES], const struct agreement *agreement)
{
	uint8_t *at = data;

	memset(data, 0, PROBE_BYTES);
	at = put16(at, 1); /* hint: the interval is what matters */
	at = put8(at, agreement->format_index);
	at = put8(at, agreement->size_index);
	put32(at, agreement->interval);
	at = put32(data + 18, (uint32_t)camera_picture_bytes(agreement->format_index - 1,
							     agreed_size(agreement)));
	at = put32(at, CAMERA_PAYLOAD_BYTES);
	at = put32(at, CAMERA_CLOCK_HZ);
	put32(at, 0x01010103); /* frame id and end-of-frame are used; payload format 1 */
}
