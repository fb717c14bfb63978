/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera on USB may answer: transfers, data sets, pictures' Exif. */
#include "fuzz.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/source/photo.h"
#include "drivers/source/ptp/data.h"
#include "drivers/source/ptp/session.h"

/* Each transfer begins with its length: 16 bits. */
static struct {
	struct lp_ptp_port port;
	const uint8_t *at;
	size_t left;
} replay;

static int send_bulk(struct lp_ptp_port *port, const uint8_t *data, size_t size_bytes,
		     int timeout_ms)
{
	(void)port;
	(void)data;
	(void)size_bytes;
	(void)timeout_ms;
	return 0;
}

static int receive(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes, int timeout_ms)
{
	size_t bytes;

	(void)port;
	(void)timeout_ms;
	if (replay.left < 2)
		return -ENODEV;
	bytes = (size_t)replay.at[0] | (size_t)replay.at[1] << 8;
	replay.at += 2;
	replay.left -= 2;
	bytes = bytes < replay.left ? bytes : replay.left;
	bytes = bytes < capacity_bytes ? bytes : capacity_bytes;
	memcpy(data, replay.at, bytes);
	replay.at += bytes;
	replay.left -= bytes;
	return (int)bytes;
}

static uint8_t *picture;

static uint8_t *reserve(void *context, size_t size_bytes)
{
	(void)context;
	if (size_bytes > (size_t)1 << 20)
		return NULL;
	picture = realloc(picture, size_bytes); /* exactly: what is beyond it is a fault */
	fuzz_assert(picture != NULL);
	return picture;
}

static void try_session(const uint8_t *data, size_t size_bytes)
{
	static const struct lp_ptp_port_ops ops = {.send = send_bulk,
						   .receive = receive,
						   .event = receive};
	struct lp_ptp_sink sink = {.reserve = reserve};
	struct lp_ptp_session session;
	struct lp_ptp_event event;
	struct lp_ptp_device device;
	const uint8_t *set;
	size_t set_bytes;

	replay.port.ops = &ops;
	replay.at = data;
	replay.left = size_bytes;
	fuzz_assert(lp_ptp_session_init(&session, &replay.port, NULL) == 0);
	if (lp_ptp_get(&session, LP_PTP_GET_DEVICE_INFO, 0, &set, &set_bytes) == 0)
		(void)lp_ptp_device_read(set, set_bytes, &device);
	(void)lp_ptp_event(&session, 0, &event);
	if (lp_ptp_operate(&session, LP_PTP_GET_OBJECT, NULL, &sink) == 0)
		(void)lp_photo_read(picture, sink.size_bytes);
	lp_ptp_session_finish(&session);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	struct lp_ptp_device device;
	struct lp_ptp_values values;
	uint64_t chosen[13];

	try_session(data, size_bytes);
	(void)lp_ptp_device_read(data, size_bytes, &device);
	(void)lp_photo_read(data, size_bytes);
	if (lp_ptp_values_read(data, size_bytes, &values))
		fuzz_assert(lp_ptp_choose(&values, 0, 3, 13, chosen) <= 13);
	return 0;
}
