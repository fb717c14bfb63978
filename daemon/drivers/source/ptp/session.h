/* SPDX-License-Identifier: Apache-2.0 */
/*
 * PTP over USB: one operation after the other, each a command, maybe data one way, and a response
 * (ISO 15740; USB Still Image Capture Device Definition, 7.1). The thread of the source.
 */
#ifndef LP_SOURCE_PTP_SESSION_H
#define LP_SOURCE_PTP_SESSION_H

#include <stddef.h>
#include <stdint.h>

#include "drivers/source/ptp/port.h"

struct lp_stop;

#define LP_PTP_CHUNK_BYTES ((size_t)64 << 10)

enum lp_ptp_operation {
	LP_PTP_GET_DEVICE_INFO = 0x1001,
	LP_PTP_OPEN_SESSION = 0x1002,
	LP_PTP_CLOSE_SESSION = 0x1003,
	LP_PTP_GET_OBJECT_INFO = 0x1008,
	LP_PTP_GET_OBJECT = 0x1009,
	LP_PTP_DELETE_OBJECT = 0x100B,
	LP_PTP_GET_PROPERTY_DESCRIPTION = 0x1014,
	LP_PTP_GET_PROPERTY = 0x1015,
	LP_PTP_SET_PROPERTY = 0x1016,
	LP_PTP_TERMINATE_OPEN_CAPTURE = 0x1018,
	LP_PTP_INITIATE_OPEN_CAPTURE = 0x101C,
};

enum lp_ptp_response {
	LP_PTP_OK = 0x2001,
	LP_PTP_STORE_FULL = 0x200C,
	LP_PTP_DEVICE_BUSY = 0x2019,
	LP_PTP_SESSION_ALREADY_OPEN = 0x201E,
};

enum lp_ptp_event_code {
	LP_PTP_OBJECT_ADDED = 0x4002,
	LP_PTP_EVENT_STORE_FULL = 0x400A,
	LP_PTP_CAPTURE_COMPLETE = 0x400D,
};

struct lp_ptp_session {
	struct lp_ptp_port *port;
	struct lp_stop *stop; /* ends waiting for an event; NULL: nothing does */
	uint32_t transaction; /* of the last operation */
	uint16_t response;    /* of the last operation */
	uint8_t *chunk;	      /* LP_PTP_CHUNK_BYTES, of the transfer */
	uint8_t *set;	      /* LP_PTP_CHUNK_BYTES, the last data set */
};

struct lp_ptp_operands {
	uint32_t parameters[3];
	int parameter_count;
	const uint8_t *data; /* to the camera; NULL: none */
	size_t data_bytes;
};

/* Where data from the camera go. reserve: room for so many bytes, or NULL. */
struct lp_ptp_sink {
	void *context;
	uint8_t *(*reserve)(void *context, size_t size_bytes);
	size_t size_bytes; /* that came */
};

/* -ENOMEM. Borrows the port. */
int lp_ptp_session_init(struct lp_ptp_session *session, struct lp_ptp_port *port,
			struct lp_stop *stop);
void lp_ptp_session_finish(struct lp_ptp_session *session); /* the port stays open */

/* Take what the camera still has to say of an operation that was given up: it takes no other one
 * before that. 0 or -errno. */
int lp_ptp_drain(struct lp_ptp_session *session);

/*
 * `sink` NULL: data from the camera are not expected. 0: done; -EREMOTEIO: the camera refuses, with
 * session->response. All else is about the transport, after which nothing can be asked any more:
 * -ETIMEDOUT, -ENODEV, -EPIPE, -EPROTO, -EFBIG, -ENOMEM, -EIO.
 */
int lp_ptp_operate(struct lp_ptp_session *session, enum lp_ptp_operation operation,
		   const struct lp_ptp_operands *operands, struct lp_ptp_sink *sink);

/* A data set of less than LP_PTP_CHUNK_BYTES; `*data` is valid until the next operation. */
int lp_ptp_get(struct lp_ptp_session *session, enum lp_ptp_operation operation, uint32_t parameter,
	       const uint8_t **data, size_t *size_bytes);

struct lp_ptp_event {
	uint16_t code;
	uint32_t parameter;
};

/* Wait for an event for at most `timeout_ms`. 1; 0: none has come, or one that is damaged; -errno
 * as above; -ECANCELED: told to stop. */
int lp_ptp_event(struct lp_ptp_session *session, int timeout_ms, struct lp_ptp_event *event);

/* In words, with the number. */
const char *lp_ptp_response_text(uint16_t response, char text[64]);

#endif
