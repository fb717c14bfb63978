/* SPDX-License-Identifier: Apache-2.0 */
/* The device side of a USB cable, by the kernel's raw_gadget. Results are 0, a size, or -errno. */
#ifndef UVC_CAMERA_GADGET_H
#define UVC_CAMERA_GADGET_H

#include <stddef.h>
#include <stdint.h>
#include <linux/usb/ch9.h>

/* `fd` -1: unplugged. All calls that wait end with -EINTR when their thread gets a signal. */
struct gadget {
	int fd;
	int endpoint; /* of pictures; -1 before the host has configured us */
};

/* Plugs in, at `controller` ("dummy_udc.0"). */
int gadget_open(struct gadget *gadget, const char *controller);
/* Unplugs. No other thread may be inside a call. */
void gadget_close(struct gadget *gadget);

/* Waits for the host's next control request; every one must be answered by one of the four below.
 */
int gadget_next_request(struct gadget *gadget, struct usb_ctrlrequest *request);
int gadget_reply(struct gadget *gadget, const void *data, size_t size_bytes);
int gadget_receive(struct gadget *gadget, void *data, size_t size_bytes);
int gadget_acknowledge(struct gadget *gadget);
int gadget_refuse(struct gadget *gadget);

/* The host has chosen the configuration: the endpoint of pictures goes to work. */
int gadget_configure(struct gadget *gadget, const struct usb_endpoint_descriptor *endpoint);

/* Memory for one write of up to `capacity_bytes` of pictures; fill gadget_data(). */
struct gadget_buffer;
struct gadget_buffer *gadget_buffer_create(size_t capacity_bytes);
uint8_t *gadget_data(struct gadget_buffer *buffer);
/* Waits until the host has taken all of it. A last packet that is full is followed by an empty one.
 */
int gadget_write(struct gadget *gadget, struct gadget_buffer *buffer, size_t size_bytes);
/* Halts the endpoint of pictures: the host's transfers fail until it clears the halt. */
int gadget_halt(struct gadget *gadget);

#endif
