/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/session.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/stop.h"
#include "drivers/source/ptp/data.h"

#define HEADER_BYTES 12U
#define MOST_OBJECT_BYTES ((size_t)64 << 20)
#define MOST_DATA_BYTES ((size_t)1 << 10) /* to the camera */
/* A camera that says nothing for so long has hung. */
#define PATIENCE_NS (10 * LP_NS_PER_S)
#define SLICE_MS 100
#define SEND_MS 2000
#define MOST_PER_READ ((size_t)256 << 10)
#define MOST_STALE 8 /* answers to operations that were given up */

enum container { COMMAND = 1, DATA = 2, RESPONSE = 3, EVENT = 4 };

struct header {
	uint32_t length;
	uint16_t type, code;
	uint32_t transaction;
};

int lp_ptp_session_init(struct lp_ptp_session *session, struct lp_ptp_port *port,
			struct lp_stop *stop)
{
	*session = (struct lp_ptp_session){.port = port,
					   .stop = stop,
					   .chunk = malloc(2 * LP_PTP_CHUNK_BYTES)};
	if (!session->chunk)
		return -ENOMEM;
	session->set = session->chunk + LP_PTP_CHUNK_BYTES;
	return 0;
}

void lp_ptp_session_finish(struct lp_ptp_session *session)
{
	free(session->chunk);
	session->chunk = session->set = NULL;
}

/* ---------------------------------------------------------------- bytes */

static uint8_t *write_header(uint8_t *at, const struct header *header)
{
	at = lp_ptp_write(at, header->length, 4);
	at = lp_ptp_write(at, header->type, 2);
	at = lp_ptp_write(at, header->code, 2);
	return lp_ptp_write(at, header->transaction, 4);
}

static struct header read_header(const uint8_t *data)
{
	struct lp_ptp_reader reader = lp_ptp_reader_of(data, HEADER_BYTES);
	struct header header;

	header.length = (uint32_t)lp_ptp_read(&reader, 4);
	header.type = (uint16_t)lp_ptp_read(&reader, 2);
	header.code = (uint16_t)lp_ptp_read(&reader, 2);
	header.transaction = (uint32_t)lp_ptp_read(&reader, 4);
	return header;
}

static int send_command(struct lp_ptp_session *session, enum lp_ptp_operation operation,
			const struct lp_ptp_operands *operands)
{
	uint8_t command[HEADER_BYTES + 4 * 3], *at;
	const struct header header = {.length = HEADER_BYTES +
						4 * (uint32_t)operands->parameter_count,
				      .type = COMMAND,
				      .code = (uint16_t)operation,
				      .transaction = session->transaction};

	at = write_header(command, &header);
	for (int i = 0; i < operands->parameter_count; i++)
		at = lp_ptp_write(at, operands->parameters[i], 4);
	return session->port->ops->send(session->port, command, header.length, SEND_MS);
}

static int send_data(struct lp_ptp_session *session, enum lp_ptp_operation operation,
		     const struct lp_ptp_operands *operands)
{
	uint8_t data[HEADER_BYTES + MOST_DATA_BYTES], *at;
	const struct header header = {.length = HEADER_BYTES + (uint32_t)operands->data_bytes,
				      .type = DATA,
				      .code = (uint16_t)operation,
				      .transaction = session->transaction};

	if (operands->data_bytes > MOST_DATA_BYTES)
		return -EFBIG;
	at = write_header(data, &header);
	memcpy(at, operands->data, operands->data_bytes);
	return session->port->ops->send(session->port, data, header.length, SEND_MS);
}

/* Bytes of a transfer, 0 or more; -errno. */
static int receive(struct lp_ptp_session *session, uint8_t *data, size_t capacity_bytes)
{
	const int64_t end_ns = lp_clock_ns() + PATIENCE_NS;
	int ret;

	do
		ret = session->port->ops->receive(session->port, data, capacity_bytes, SLICE_MS);
	while (ret == -ETIMEDOUT && lp_clock_ns() < end_ns);
	return ret;
}

/* ---------------------------------------------------------------- an operation */

static size_t whole_packets(size_t bytes)
{
	return (bytes + LP_PTP_PACKET_BYTES - 1) / LP_PTP_PACKET_BYTES * LP_PTP_PACKET_BYTES;
}

/* The rest of the data, of which the chunk holds the first `held` bytes after the header. */
static int receive_data(struct lp_ptp_session *session, size_t size_bytes, size_t held,
			struct lp_ptp_sink *sink)
{
	uint8_t *to;
	size_t got;

	if (size_bytes > MOST_OBJECT_BYTES)
		return -EFBIG;
	/* a read asks for whole packets */
	to = sink->reserve(sink->context, size_bytes + LP_PTP_PACKET_BYTES);
	if (!to)
		return -ENOMEM;
	if (held > size_bytes)
		return -EPROTO;
	memcpy(to, session->chunk + HEADER_BYTES, held);
	for (got = held; got < size_bytes;) {
		size_t most = whole_packets(size_bytes - got);
		int ret;

		most = most < MOST_PER_READ ? most : MOST_PER_READ;
		ret = receive(session, to + got, most);
		if (ret < 0)
			return ret;
		got += (size_t)ret;
		if (ret == 0 || got > size_bytes)
			return -EPROTO;
	}
	sink->size_bytes = size_bytes;
	return 0;
}

/* One container into the chunk, its header read. Bytes or -errno. */
static int receive_container(struct lp_ptp_session *session, struct header *header)
{
	int ret;

	do /* data that fill their last packet end with an empty one */
		ret = receive(session, session->chunk, LP_PTP_CHUNK_BYTES);
	while (ret == 0);
	if (ret < 0)
		return ret;
	if ((size_t)ret < HEADER_BYTES)
		return -EPROTO;
	*header = read_header(session->chunk);
	return header->length < HEADER_BYTES ? -EPROTO : ret;
}

static int receive_answer(struct lp_ptp_session *session, enum lp_ptp_operation operation,
			  struct lp_ptp_sink *sink)
{
	bool has_data = false;

	for (int stale = 0; stale < MOST_STALE;) {
		struct header header;
		int ret = receive_container(session, &header);

		if (ret < 0)
			return ret;
		if (header.type == RESPONSE && header.transaction != session->transaction) {
			stale++;
			continue;
		}
		if (header.transaction != session->transaction)
			return -EPROTO;
		if (header.type == RESPONSE) {
			session->response = header.code;
			if (header.code != LP_PTP_OK)
				return -EREMOTEIO;
			return sink && !has_data ? -EPROTO : 0;
		}
		if (header.type != DATA || header.code != operation || !sink || has_data)
			return -EPROTO;
		ret = receive_data(session, header.length - HEADER_BYTES,
				   (size_t)ret - HEADER_BYTES, sink);
		if (ret < 0)
			return ret;
		has_data = true;
	}
	return -EPROTO;
}

int lp_ptp_operate(struct lp_ptp_session *session, enum lp_ptp_operation operation,
		   const struct lp_ptp_operands *operands, struct lp_ptp_sink *sink)
{
	static const struct lp_ptp_operands none = {.parameter_count = 0};
	int ret;

	operands = operands ? operands : &none;
	session->response = 0;
	/* What is asked without a session has number 0, and so has OpenSession. */
	if (operation == LP_PTP_OPEN_SESSION)
		session->transaction = 0;
	else if (operation != LP_PTP_GET_DEVICE_INFO)
		session->transaction++;
	ret = send_command(session, operation, operands);
	if (ret == 0 && operands->data)
		ret = send_data(session, operation, operands);
	return ret < 0 ? ret : receive_answer(session, operation, sink);
}

int lp_ptp_drain(struct lp_ptp_session *session)
{
	for (int n = 0; n < MOST_STALE; n++) {
		const int ret = session->port->ops->receive(session->port, session->chunk,
							    LP_PTP_CHUNK_BYTES, SLICE_MS);

		if (ret < 0)
			return ret == -ETIMEDOUT ? 0 : ret;
	}
	return 0;
}

static uint8_t *reserve_set(void *context, size_t size_bytes)
{
	struct lp_ptp_session *session = context;

	return size_bytes <= LP_PTP_CHUNK_BYTES ? session->set : NULL;
}

int lp_ptp_get(struct lp_ptp_session *session, enum lp_ptp_operation operation, uint32_t parameter,
	       const uint8_t **data, size_t *size_bytes)
{
	struct lp_ptp_operands operands = {.parameters = {parameter}, .parameter_count = 1};
	struct lp_ptp_sink sink = {.context = session, .reserve = reserve_set};
	int ret;

	if (operation == LP_PTP_GET_DEVICE_INFO)
		operands.parameter_count = 0;
	ret = lp_ptp_operate(session, operation, &operands, &sink);
	*data = session->set;
	*size_bytes = sink.size_bytes;
	return ret == -ENOMEM ? -EPROTO : ret;
}

int lp_ptp_event(struct lp_ptp_session *session, int timeout_ms, struct lp_ptp_event *event)
{
	uint8_t data[LP_PTP_PACKET_BYTES];
	struct lp_ptp_reader reader;
	struct header header;
	int ret;

	if (session->stop && !lp_stop_wait_until(session->stop, 0))
		return -ECANCELED;
	ret = session->port->ops->event(session->port, data, sizeof(data), timeout_ms);
	if (ret == -ETIMEDOUT)
		return 0;
	if (ret < (int)HEADER_BYTES)
		return ret < 0 ? ret : 0;
	header = read_header(data);
	if (header.type != EVENT)
		return 0;
	reader = lp_ptp_reader_of(data + HEADER_BYTES, (size_t)ret - HEADER_BYTES);
	*event = (struct lp_ptp_event){.code = header.code,
				       .parameter = (uint32_t)lp_ptp_read(&reader, 4)};
	return 1;
}

const char *lp_ptp_response_text(uint16_t response, char text[64])
{
	static const struct {
		uint16_t code;
		const char *words;
	} known[] = {
		{0x2002, "general error"},
		{0x2003, "session not open"},
		{0x2005, "operation not supported"},
		{0x2009, "no such object"},
		{0x200A, "property not supported"},
		{LP_PTP_STORE_FULL, "its storage is full"},
		{0x200F, "access denied"},
		{LP_PTP_DEVICE_BUSY, "busy"},
		{0x201B, "format of the property"},
		{0x201C, "value not allowed"},
		{LP_PTP_SESSION_ALREADY_OPEN, "session already open"},
	};
	const char *words = "refused";

	for (size_t i = 0; i < sizeof(known) / sizeof(*known); i++)
		if (known[i].code == response)
			words = known[i].words;
	(void)snprintf(text, 64, "%s (0x%04x)", words, response);
	return text;
}
