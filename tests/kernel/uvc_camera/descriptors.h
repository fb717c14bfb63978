/* SPDX-License-Identifier: Apache-2.0 */
/* The camera's descriptors, UVC 1.1 on high-speed USB 2.0 with a bulk endpoint. */
#ifndef UVC_CAMERA_DESCRIPTORS_H
#define UVC_CAMERA_DESCRIPTORS_H

#include <stddef.h>
#include <stdint.h>
#include <linux/usb/ch9.h>
#include "model.h"

enum { DESCRIPTORS_MAX_BYTES = 2048 };

/*
 * The descriptor that a GET_DESCRIPTOR request asks for, into `data` of DESCRIPTORS_MAX_BYTES.
 * Returns its size, or -EPIPE when there is none of that type and index.
 */
int descriptors_get(const struct camera_options *options, uint8_t type, uint8_t index,
		    uint8_t *data);

extern const struct usb_endpoint_descriptor descriptors_endpoint;

#endif
