/* SPDX-License-Identifier: Apache-2.0 */
#include "gadget.h"
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <linux/usb/raw_gadget.h>

enum { CONTROL_MAX_BYTES = 4096, FLAG_ZERO_PACKET = 1 };

struct gadget_buffer {
	struct usb_raw_ep_io io; /* its data follows */
};

static int call(struct gadget *gadget, unsigned long request, void *argument)
{
	int ret = ioctl(gadget->fd, request, argument);

	return ret < 0 ? -errno : ret;
}

int gadget_open(struct gadget *gadget, const char *controller)
{
	struct usb_raw_init init = {.driver_name = "dummy_udc", .speed = USB_SPEED_HIGH};
	int ret;

	gadget->endpoint = -1;
	strncpy((char *)init.device_name, controller, sizeof(init.device_name) - 1);
	gadget->fd = open("/dev/raw-gadget", O_RDWR | O_CLOEXEC);
	if (gadget->fd < 0)
		return -errno;
	ret = call(gadget, USB_RAW_IOCTL_INIT, &init);
	if (ret == 0)
		ret = call(gadget, USB_RAW_IOCTL_RUN, NULL);
	if (ret < 0)
		gadget_close(gadget);
	return ret;
}

void gadget_close(struct gadget *gadget)
{
	if (gadget->fd >= 0)
		close(gadget->fd);
	gadget->fd = -1;
	gadget->endpoint = -1;
}

int gadget_next_request(struct gadget *gadget, struct usb_ctrlrequest *request)
{
	struct {
		struct usb_raw_event head;
		struct usb_ctrlrequest request;
	} event;
	int ret;

	do {
		event.head.type = 0;
		event.head.length = sizeof(event.request);
		ret = call(gadget, USB_RAW_IOCTL_EVENT_FETCH, &event);
		if (ret < 0)
			return ret;
	} while (event.head.type != USB_RAW_EVENT_CONTROL);
	*request = event.request;
	return 0;
}

static int control_transfer(struct gadget *gadget, unsigned long request, void *data,
			    size_t size_bytes)
{
	struct {
		struct usb_raw_ep_io io;
		uint8_t data[CONTROL_MAX_BYTES];
	} transfer = {.io = {.length = (uint32_t)size_bytes}};
	int ret;

	if (size_bytes > sizeof(transfer.data))
		return -EMSGSIZE;
	if (request == USB_RAW_IOCTL_EP0_WRITE && size_bytes)
		memcpy(transfer.data, data, size_bytes);
	ret = call(gadget, request, &transfer);
	if (request == USB_RAW_IOCTL_EP0_READ && data && ret > 0)
		memcpy(data, transfer.data, (size_t)ret);
	return ret;
}

int gadget_reply(struct gadget *gadget, const void *data, size_t size_bytes)
{
	return control_transfer(gadget, USB_RAW_IOCTL_EP0_WRITE, (void *)(uintptr_t)data,
				size_bytes);
}

int gadget_receive(struct gadget *gadget, void *data, size_t size_bytes)
{
	return control_transfer(gadget, USB_RAW_IOCTL_EP0_READ, data, size_bytes);
}

int gadget_acknowledge(struct gadget *gadget)
{
	return control_transfer(gadget, USB_RAW_IOCTL_EP0_READ, NULL, 0);
}

int gadget_refuse(struct gadget *gadget)
{
	return call(gadget, USB_RAW_IOCTL_EP0_STALL, NULL);
}

int gadget_configure(struct gadget *gadget, const struct usb_endpoint_descriptor *endpoint)
{
	struct usb_endpoint_descriptor copy = *endpoint;
	int ret;

	if (gadget->endpoint >= 0)
		return 0; /* configured again, after a reset of the port */
	ret = call(gadget, USB_RAW_IOCTL_EP_ENABLE, &copy);
	if (ret < 0)
		return ret;
	gadget->endpoint = ret;
	call(gadget, USB_RAW_IOCTL_VBUS_DRAW, (void *)250);
	return call(gadget, USB_RAW_IOCTL_CONFIGURE, NULL);
}

struct gadget_buffer *gadget_buffer_create(size_t capacity_bytes)
{
	return malloc(sizeof(struct gadget_buffer) + capacity_bytes);
}

uint8_t *gadget_data(struct gadget_buffer *buffer)
{
	return buffer->io.data;
}

int gadget_write(struct gadget *gadget, struct gadget_buffer *buffer, size_t size_bytes)
{
	buffer->io.ep = (uint16_t)gadget->endpoint;
	buffer->io.flags = FLAG_ZERO_PACKET;
	buffer->io.length = (uint32_t)size_bytes;
	return call(gadget, USB_RAW_IOCTL_EP_WRITE, &buffer->io);
}

int gadget_halt(struct gadget *gadget)
{
	return call(gadget, USB_RAW_IOCTL_EP_SET_HALT, (void *)(uintptr_t)gadget->endpoint);
}
