/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera on the network may send: its live preview, in pieces as the first byte says, and
 * its answers. */
#include "fuzz.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "drivers/source/osc/exposures.h"
#include "drivers/source/osc/multipart.h"
#include "drivers/source/osc/reply.h"

static struct {
	uint8_t *data;
	size_t bytes;
} part;

static uint8_t *reserve(void *context, size_t size_bytes)
{
	(void)context;
	part.data = realloc(part.data, size_bytes); /* exactly: what is beyond it is a fault */
	fuzz_assert(part.data != NULL);
	part.bytes = size_bytes;
	return part.data;
}

static bool is_whole(void *context, const uint8_t *data, size_t size_bytes)
{
	(void)context;
	return (data[0] ^ size_bytes) & 1;
}

static void on_part(void *context, size_t size_bytes)
{
	(void)context;
	fuzz_assert(size_bytes <= part.bytes);
}

static void try_stream(const uint8_t *data, size_t size_bytes, size_t piece_bytes)
{
	const struct lp_multipart_sink sink = {NULL, reserve, is_whole, on_part};
	struct lp_multipart multipart;

	fuzz_assert(lp_multipart_init(&multipart, "multipart/mixed; boundary=next", &sink) == 0);
	while (size_bytes > 0) {
		const size_t now = piece_bytes < size_bytes ? piece_bytes : size_bytes;

		lp_multipart_feed(&multipart, data, now);
		data += now;
		size_bytes -= now;
	}
}

static void try_answer(const uint8_t *data, size_t size_bytes)
{
	struct lp_osc_exposures range = {0};
	struct lp_osc_health health;
	struct lp_osc_fault fault;
	json_t *json = NULL;
	char *text = calloc(1, size_bytes + 1);
	struct lp_osc_reply reply = {200, text, size_bytes};

	fuzz_assert(text != NULL);
	memcpy(text, data, size_bytes);
	(void)lp_osc_health_read(&reply, &health);
	if (lp_osc_reply_check(&reply, "fuzz", false, &json, &fault) == 0 &&
	    lp_osc_exposures_read(&range, json, 30, 0) == 0) {
		float exposure_us = 1000, gain = 1;

		lp_osc_exposures_snap(&range, &exposure_us, &gain);
		json_decref(lp_osc_exposures_options(&range, exposure_us, gain));
	}
	json_decref(json);
	free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	if (size_bytes < 1)
		return 0;
	try_stream(data + 1, size_bytes - 1, (size_t)data[0] + 1);
	try_answer(data + 1, size_bytes - 1);
	free(part.data);
	part.data = NULL;
	return 0;
}
