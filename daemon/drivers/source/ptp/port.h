/* SPDX-License-Identifier: Apache-2.0 */
/* The three pipes of a camera that speaks PTP over USB, and how an attempt at it can fail. One
 * thread. */
#ifndef LP_SOURCE_PTP_PORT_H
#define LP_SOURCE_PTP_PORT_H

#include <stddef.h>
#include <stdint.h>

#include "include/source.h"

/* A read asks for a multiple of this, the largest packet of any bus. */
#define LP_PTP_PACKET_BYTES 1024U

struct lp_ptp_settings;
struct lp_ptp_port;

/* All calls wait for at most `timeout_ms`: -ETIMEDOUT. -ENODEV: unplugged; -EPIPE: the camera has
 * refused the transfer; -EIO. Not logged. */
struct lp_ptp_port_ops {
	/* One transfer, whole, and its end. 0 or -errno. */
	int (*send)(struct lp_ptp_port *port, const uint8_t *data, size_t size_bytes,
		    int timeout_ms);
	/* Part of a transfer. Bytes, fewer than the capacity at its end (maybe 0), or -errno. */
	int (*receive)(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes,
		       int timeout_ms);
	/* One event. Bytes or -errno. */
	int (*event)(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes,
		     int timeout_ms);
	void (*close)(struct lp_ptp_port *port);
};

/* Base of every port: embed it as the first member. */
struct lp_ptp_port {
	const struct lp_ptp_port_ops *ops;
};

/* Why there are no stills now. */
struct lp_ptp_fault {
	enum lp_source_state state; /* WAITING: it may come; DOWN: not by itself */
	char stage[32];
	char reason[320]; /* with the next step */
};

/* Fill `*fault`. Returns `error`. */
__attribute__((format(printf, 5, 6))) int lp_ptp_fail(struct lp_ptp_fault *fault, int error,
						      enum lp_source_state state, const char *stage,
						      const char *format, ...);

/* Open the THETA on USB that the settings name. `serial` is its own. 0; -errno with `*fault`. */
int lp_ptp_usb_open(const struct lp_ptp_settings *settings, struct lp_ptp_port **port,
		    struct lp_ptp_fault *fault);

#endif
