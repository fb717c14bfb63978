/* SPDX-License-Identifier: Apache-2.0 */
#include "camera.h"
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <linux/usb/video.h>
#include "descriptors.h"
#include "gadget.h"

enum { MUTE_S = 6 }; /* longer than the host's five seconds */

struct camera {
	const struct camera_options *options;
	struct gadget gadget;
	struct faults faults;
	struct controls *controls;
	struct streaming *streaming;
	char controller[32];
	bool plugged;
	pthread_t thread; /* answers control requests while plugged */
	atomic_bool unplugging;
};

static int reply_at_most(struct camera *camera, const void *data, int size,
			 const struct usb_ctrlrequest *request)
{
	if (size > request->wLength)
		size = request->wLength;
	return gadget_reply(&camera->gadget, data, (size_t)size);
}

static int get_descriptor(struct camera *camera, const struct usb_ctrlrequest *request)
{
	uint8_t data[DESCRIPTORS_MAX_BYTES];
	uint8_t type = (uint8_t)(request->wValue >> 8);
	int size;

	if (type == USB_DT_DEVICE) {
		/* Read at no other time than after a reset of the port, which cures a hang. */
		atomic_store(&camera->faults.values[FAULT_HANG], 0);
		streaming_reset(camera->streaming);
	}
	size = descriptors_get(camera->options, type, (uint8_t)request->wValue, data);
	if (size < 0)
		return gadget_refuse(&camera->gadget);
	return reply_at_most(camera, data, size, request);
}

static int standard_request(struct camera *camera, const struct usb_ctrlrequest *request)
{
	static const uint8_t alternate = 0;

	switch (request->bRequest) {
	case USB_REQ_GET_DESCRIPTOR:
		return get_descriptor(camera, request);
	case USB_REQ_SET_CONFIGURATION:
		gadget_configure(&camera->gadget, &descriptors_endpoint);
		return gadget_acknowledge(&camera->gadget);
	case USB_REQ_SET_INTERFACE:
		return gadget_acknowledge(&camera->gadget);
	case USB_REQ_GET_INTERFACE:
		return reply_at_most(camera, &alternate, 1, request);
	default:
		return gadget_refuse(&camera->gadget);
	}
}

static int class_get(struct camera *camera, const struct usb_ctrlrequest *request)
{
	bool streaming = (request->wIndex & 0xff) == CAMERA_VIDEO_STREAMING;
	uint8_t data[64] = {0};
	int size = streaming ? streaming_get(camera->streaming, request, data)
			     : controls_get(camera->controls, request, data);

	if (size < 0)
		return gadget_refuse(&camera->gadget);
	return reply_at_most(camera, data, size, request);
}

static int class_set(struct camera *camera, const struct usb_ctrlrequest *request)
{
	bool streaming = (request->wIndex & 0xff) == CAMERA_VIDEO_STREAMING;
	uint8_t data[64] = {0};
	int ret = streaming ? streaming_may_set(camera->streaming, request)
			    : controls_may_set(camera->controls, request);

	if (ret < 0 || request->bRequest != UVC_SET_CUR || request->wLength > sizeof(data))
		return gadget_refuse(&camera->gadget);
	ret = gadget_receive(&camera->gadget, data, request->wLength);
	if (ret < 0)
		return ret;
	if (streaming)
		streaming_set(camera->streaming, request, data, (size_t)ret);
	else
		controls_set(camera->controls, request, data);
	return 0;
}

static int class_request(struct camera *camera, const struct usb_ctrlrequest *request)
{
	if (fault_is_on(&camera->faults, FAULT_HANG))
		return gadget_refuse(&camera->gadget);
	if (fault_is_on(&camera->faults, FAULT_MUTE)) {
		/* The host has given up by then; the refusal is for ourselves, to go on. */
		nanosleep(&(struct timespec){.tv_sec = MUTE_S}, NULL);
		return gadget_refuse(&camera->gadget);
	}
	return request->bRequestType & USB_DIR_IN ? class_get(camera, request)
						  : class_set(camera, request);
}

static void serve(struct camera *camera, const struct usb_ctrlrequest *request)
{
	int ret;

	switch (request->bRequestType & USB_TYPE_MASK) {
	case USB_TYPE_STANDARD:
		ret = standard_request(camera, request);
		break;
	case USB_TYPE_CLASS:
		ret = class_request(camera, request);
		break;
	default:
		ret = gadget_refuse(&camera->gadget);
	}
	if (camera->options->verbose)
		fprintf(stderr, "uvc_camera: request %02x %02x value %04x index %04x size %d: %s\n",
			request->bRequestType, request->bRequest, request->wValue, request->wIndex,
			request->wLength, ret < 0 ? strerror(-ret) : "answered");
}

static int connect_to_bus(struct camera *camera)
{
	int ret = gadget_open(&camera->gadget, camera->controller);

	if (ret < 0)
		return ret;
	ret = streaming_start(camera->streaming);
	if (ret < 0)
		gadget_close(&camera->gadget);
	return ret;
}

static void disconnect_from_bus(struct camera *camera)
{
	if (camera->gadget.fd < 0)
		return;
	streaming_stop(camera->streaming);
	gadget_close(&camera->gadget);
}

/* raw_gadget gives a device up for ever when its endpoint goes while a frame is being written, as
 * may happen in a reset of the port. A camera would go on; this one connects anew. */
static int recover(struct camera *camera)
{
	fprintf(stderr, "uvc_camera: the kernel has given it up: connecting anew\n");
	disconnect_from_bus(camera);
	return connect_to_bus(camera);
}

static void *control_main(void *argument)
{
	struct camera *camera = argument;
	struct usb_ctrlrequest request;
	int ret = 0;

	while (!atomic_load(&camera->unplugging) && ret == 0) {
		ret = gadget_next_request(&camera->gadget, &request);
		if (ret == 0)
			serve(camera, &request);
		else if (ret == -EINTR)
			ret = 0;
		else if (!atomic_load(&camera->unplugging))
			ret = recover(camera);
	}
	return NULL;
}

struct camera *camera_create(const struct camera_options *options, struct pictures *pictures)
{
	struct camera *camera = calloc(1, sizeof(*camera));

	if (!camera)
		return NULL;
	camera->options = options;
	camera->gadget.fd = -1;
	camera->controls = controls_create(options, &camera->faults);
	if (!camera->controls)
		goto err_free;
	camera->streaming =
		streaming_create(&camera->gadget, camera->controls, pictures, &camera->faults);
	if (!camera->streaming)
		goto err_destroy_controls;
	return camera;

err_destroy_controls:
	controls_destroy(camera->controls);
err_free:
	free(camera);
	return NULL;
}

void camera_destroy(struct camera *camera)
{
	if (!camera)
		return;
	camera_unplug(camera);
	streaming_destroy(camera->streaming);
	controls_destroy(camera->controls);
	free(camera);
}

int camera_plug(struct camera *camera, const char *controller)
{
	int ret;

	if (camera->plugged)
		return -EALREADY;
	snprintf(camera->controller, sizeof(camera->controller), "%s", controller);
	controls_power_on(camera->controls);
	ret = connect_to_bus(camera);
	if (ret < 0)
		return ret;
	atomic_store(&camera->unplugging, false);
	ret = -pthread_create(&camera->thread, NULL, control_main, camera);
	if (ret < 0)
		disconnect_from_bus(camera);
	camera->plugged = ret == 0;
	return ret;
}

int camera_unplug(struct camera *camera)
{
	struct timespec until;

	if (!camera->plugged)
		return -EALREADY;
	camera->plugged = false;
	atomic_store(&camera->unplugging, true);
	do {
		/* It may be about to wait in the kernel: nudge it until it has gone. */
		pthread_kill(camera->thread, SIGUSR1);
		clock_gettime(CLOCK_REALTIME, &until);
		until.tv_nsec += 10000000;
		until.tv_sec += until.tv_nsec / 1000000000;
		until.tv_nsec %= 1000000000;
	} while (pthread_timedjoin_np(camera->thread, NULL, &until) != 0);
	disconnect_from_bus(camera);
	return 0;
}

struct faults *camera_faults(struct camera *camera)
{
	return &camera->faults;
}

struct controls *camera_controls(struct camera *camera)
{
	return camera->controls;
}

const struct streaming_counts *camera_counts(const struct camera *camera)
{
	return streaming_counts(camera->streaming);
}
