/* SPDX-License-Identifier: Apache-2.0 */
/* The video streaming interface: negotiation (probe, commit) and the thread that sends frames. */
#ifndef UVC_CAMERA_STREAMING_H
#define UVC_CAMERA_STREAMING_H

#include <stdatomic.h>
#include <stdint.h>
#include <linux/usb/ch9.h>
#include "controls.h"
#include "faults.h"
#include "gadget.h"
#include "pictures.h"

struct streaming;

/* What has happened since the camera was made. Read from any thread. */
struct streaming_counts {
	atomic_uint sent;    /* frames that the host has taken whole */
	atomic_uint overrun; /* frames that never left: the host was not reading */
	atomic_uint spoiled; /* frames sent wrong, on command */
	atomic_uint broken;  /* frames cut off: stream restarted, unplugged */
};

/* All pointers are borrowed and outlive it. NULL: no memory. */
struct streaming *streaming_create(struct gadget *gadget, struct controls *controls,
				   struct pictures *pictures, struct faults *faults);
void streaming_destroy(struct streaming *streaming); /* accepts NULL; the thread has been stopped */

/* Starts the thread, which waits for the host's commit. 0 or -errno. */
int streaming_start(struct streaming *streaming);
/* Ends the thread. The gadget may be closed then. */
void streaming_stop(struct streaming *streaming);
/* The host has reset the port: no stream until it commits again. */
void streaming_reset(struct streaming *streaming);

/* A GET request to the interface: answer into `data` (64 bytes), its size or -EPIPE. */
int streaming_get(struct streaming *streaming, const struct usb_ctrlrequest *request,
		  uint8_t *data);
/* May this SET request go on to its data? 0 or -EPIPE. A commit ends the stream that runs. */
int streaming_may_set(struct streaming *streaming, const struct usb_ctrlrequest *request);
/* The data of a permitted SET request; a commit starts the stream. */
void streaming_set(struct streaming *streaming, const struct usb_ctrlrequest *request,
		   const uint8_t *data, size_t size_bytes);

const struct streaming_counts *streaming_counts(const struct streaming *streaming);

#endif
