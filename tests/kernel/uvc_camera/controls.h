/* SPDX-License-Identifier: Apache-2.0 */
/* Controls of the camera terminal and the processing unit, and when their changes take effect. */
#ifndef UVC_CAMERA_CONTROLS_H
#define UVC_CAMERA_CONTROLS_H

#include <stddef.h>
#include <stdint.h>
#include <linux/usb/ch9.h>
#include "faults.h"
#include "model.h"

struct controls;

/* Picture-making settings. Gain is linear: 1 is the lowest. */
struct settings {
	double exposure_us;
	double gain;
};

struct controls *controls_create(const struct camera_options *options, struct faults *faults);
void controls_destroy(struct controls *controls);

/* The camera gets power: all values are the initial ones. */
void controls_power_on(struct controls *controls);

/* A GET request to an entity: its answer into `data` (8 bytes); returns the size or -EPIPE. */
int controls_get(struct controls *controls, const struct usb_ctrlrequest *request, uint8_t *data);
/* May this SET request go on to its data? 0 or -EPIPE; the reason can be asked for by the host. */
int controls_may_set(struct controls *controls, const struct usb_ctrlrequest *request);
/* The data of a permitted SET request; out-of-range values are clamped, as cameras do. */
void controls_set(struct controls *controls, const struct usb_ctrlrequest *request,
		  const uint8_t *data);

/*
 * A frame begins: returns the settings it is exposed with, those that were in force `delay` frames
 * ago. Any thread.
 */
struct settings controls_next_frame(struct controls *controls);
void controls_set_delay(struct controls *controls, int delay_frames);
/* Current value by its name in the table ("exposure", "gain", ...) for the state report; -1: none.
 */
int controls_value(struct controls *controls, const char *name);

#endif
