/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera on the network may send: its live preview - a line with its type, then its bytes,
 * in pieces as the first byte says - and its answers. */
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

static void try_stream(const char *type, const uint8_t *data, size_t size_bytes, size_t piece_bytes)
{
	const struct lp_multipart_sink sink = {NULL, reserve, is_whole, on_part};
	struct lp_multipart multipart;

	if (lp_multipart_init(&multipart, type, &sink) < 0)
		return;
	fuzz_assert(multipart.boundary_bytes > 0 && multipart.boundary_bytes <= 70);
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

/* The type is a text of exactly its length: what is beyond it is a fault. */
static void try_typed(const uint8_t *data, size_t size_bytes, size_t piece_bytes)
{
	const uint8_t *end = size_bytes ? memchr(data, '\n', size_bytes) : NULL;
	const size_t type_bytes = end ? (size_t)(end - data) : size_bytes;
	char *type = calloc(1, type_bytes + 1);

	fuzz_assert(type != NULL);
	memcpy(type, data, type_bytes);
	if (end)
		try_stream(type, end + 1, size_bytes - type_bytes - 1, piece_bytes);
	free(type);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	if (size_bytes < 1)
		return 0;
	try_typed(data + 1, size_bytes - 1, (size_t)data[0] + 1);
	try_answer(data + 1, size_bytes - 1);
	free(part.data);
	part.data = NULL;
	return 0;
}
