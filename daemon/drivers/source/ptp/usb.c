/* SPDX-License-Identifier: Apache-2.0 */
/* The port over libusb. */
#include <errno.h>
#include <libusb-1.0/libusb.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/source/ptp/port.h"
#include "drivers/source/ptp/settings.h"

#define RICOH 0x05ca
/* Still Image Capture Device Definition 1.0, 4.1 */
#define SUBCLASS_CAPTURE 1
#define PROTOCOL_PIMA_15740 1

struct usb_port {
	struct lp_ptp_port base;
	libusb_context *context;
	libusb_device_handle *handle;
	int interface;
	uint8_t in, out, events; /* endpoints */
	int out_packet_bytes;
};

static struct usb_port *self_of(struct lp_ptp_port *port)
{
	return (struct usb_port *)port;
}

static int to_errno(int error)
{
	switch (error) {
	case LIBUSB_SUCCESS:
		return 0;
	case LIBUSB_ERROR_TIMEOUT:
		return -ETIMEDOUT;
	case LIBUSB_ERROR_NO_DEVICE:
	case LIBUSB_ERROR_NOT_FOUND:
		return -ENODEV;
	case LIBUSB_ERROR_PIPE:
		return -EPIPE;
	case LIBUSB_ERROR_ACCESS:
		return -EACCES;
	case LIBUSB_ERROR_BUSY:
		return -EBUSY;
	case LIBUSB_ERROR_NO_MEM:
		return -ENOMEM;
	default:
		return -EIO;
	}
}

/* ---------------------------------------------------------------- transfers */

static int usb_send(struct lp_ptp_port *port, const uint8_t *data, size_t size_bytes,
		    int timeout_ms)
{
	struct usb_port *self = self_of(port);
	unsigned char empty = 0;
	int sent = 0;
	/* libusb does not write to what goes out */
	int ret = to_errno(libusb_bulk_transfer(self->handle, self->out, (unsigned char *)data,
						(int)size_bytes, &sent, (unsigned)timeout_ms));

	if (ret == 0 && (size_t)sent != size_bytes)
		ret = -EIO;
	if (ret == 0 && size_bytes % (size_t)self->out_packet_bytes == 0)
		ret = to_errno(libusb_bulk_transfer(self->handle, self->out, &empty, 0, &sent,
						    (unsigned)timeout_ms));
	return ret;
}

/* What came before the time was over counts. */
static int bytes_or_error(int ret, int got)
{
	return ret == 0 || (ret == -ETIMEDOUT && got > 0) ? got : ret;
}

static int usb_receive(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes,
		       int timeout_ms)
{
	struct usb_port *self = self_of(port);
	int got = 0;
	const int ret =
		to_errno(libusb_bulk_transfer(self->handle, self->in, data, (int)capacity_bytes,
					      &got, (unsigned)timeout_ms));

	return bytes_or_error(ret, got);
}

static int usb_event(struct lp_ptp_port *port, uint8_t *data, size_t capacity_bytes, int timeout_ms)
{
	struct usb_port *self = self_of(port);
	int got = 0;
	const int ret = to_errno(libusb_interrupt_transfer(self->handle, self->events, data,
							   (int)capacity_bytes, &got,
							   (unsigned)timeout_ms));

	return bytes_or_error(ret, got);
}

static void usb_close(struct lp_ptp_port *port)
{
	struct usb_port *self = self_of(port);

	if (self->handle) {
		(void)libusb_release_interface(self->handle, self->interface);
		libusb_close(self->handle);
	}
	libusb_exit(self->context);
	free(self);
}

/* ---------------------------------------------------------------- which device */

/* Interface and endpoints of stills. False: it has none. */
static bool read_interface(struct usb_port *self, const struct libusb_interface_descriptor *d)
{
	if (d->bInterfaceClass != LIBUSB_CLASS_IMAGE || d->bInterfaceSubClass != SUBCLASS_CAPTURE ||
	    d->bInterfaceProtocol != PROTOCOL_PIMA_15740)
		return false;
	self->in = self->out = self->events = 0;
	for (int i = 0; i < d->bNumEndpoints; i++) {
		const struct libusb_endpoint_descriptor *endpoint = &d->endpoint[i];
		const bool is_in = endpoint->bEndpointAddress & LIBUSB_ENDPOINT_IN;
		const int type = endpoint->bmAttributes & LIBUSB_TRANSFER_TYPE_MASK;

		if (type == LIBUSB_TRANSFER_TYPE_INTERRUPT && is_in) {
			self->events = endpoint->bEndpointAddress;
		} else if (type == LIBUSB_TRANSFER_TYPE_BULK && is_in) {
			self->in = endpoint->bEndpointAddress;
		} else if (type == LIBUSB_TRANSFER_TYPE_BULK) {
			self->out = endpoint->bEndpointAddress;
			self->out_packet_bytes = endpoint->wMaxPacketSize & 0x7ff;
		}
	}
	self->interface = d->bInterfaceNumber;
	return self->in && self->out && self->events && self->out_packet_bytes;
}

static bool has_stills(struct usb_port *self, libusb_device *device)
{
	struct libusb_config_descriptor *configuration;
	bool found = false;

	if (libusb_get_active_config_descriptor(device, &configuration) != LIBUSB_SUCCESS)
		return false;
	for (int i = 0; i < configuration->bNumInterfaces && !found; i++) {
		const struct libusb_interface *interface = &configuration->interface[i];

		found = interface->num_altsetting > 0 &&
			read_interface(self, &interface->altsetting[0]);
	}
	libusb_free_config_descriptor(configuration);
	return found;
}

/* What was seen among the devices. */
struct search {
	libusb_device *found;
	int ricoh, stills, matches, denied;
	int error; /* of the device that could not be opened */
};

static bool serial_matches(const struct lp_ptp_settings *settings, libusb_device *device,
			   struct search *search)
{
	struct libusb_device_descriptor descriptor;
	libusb_device_handle *handle;
	char serial[64] = "";
	int ret;

	if (!*settings->serial)
		return true;
	ret = libusb_open(device, &handle);
	if (ret != LIBUSB_SUCCESS) {
		search->denied++;
		search->error = to_errno(ret);
		return false;
	}
	if (libusb_get_device_descriptor(device, &descriptor) == LIBUSB_SUCCESS)
		(void)libusb_get_string_descriptor_ascii(handle, descriptor.iSerialNumber,
							 (unsigned char *)serial, sizeof(serial));
	libusb_close(handle);
	return strcmp(serial, settings->serial) == 0;
}

static void look_at(struct usb_port *self, const struct lp_ptp_settings *settings,
		    libusb_device *device, struct search *search)
{
	struct libusb_device_descriptor descriptor;

	if (libusb_get_device_descriptor(device, &descriptor) != LIBUSB_SUCCESS ||
	    descriptor.idVendor != RICOH)
		return;
	search->ricoh++;
	if (!has_stills(self, device))
		return;
	search->stills++;
	if (!serial_matches(settings, device, search))
		return;
	search->matches++;
	search->found = device;
}

static int claim(struct usb_port *self, libusb_device *device)
{
	int ret = libusb_open(device, &self->handle);

	if (ret != LIBUSB_SUCCESS) {
		self->handle = NULL;
		return to_errno(ret);
	}
	ret = libusb_claim_interface(self->handle, self->interface);
	if (ret == LIBUSB_SUCCESS)
		return 0;
	libusb_close(self->handle);
	self->handle = NULL;
	return to_errno(ret);
}

static int explain_claim(int ret, struct lp_ptp_fault *fault)
{
	switch (ret) {
	case -EACCES:
		return lp_ptp_fail(fault, ret, LP_SOURCE_WAITING, "open",
				   "no permission — install packaging/udev/70-lightprobe.rules and "
				   "join the group video");
	case -EBUSY:
		return lp_ptp_fail(fault, ret, LP_SOURCE_WAITING, "open",
				   "another program has it — unmount it (gvfs), and end gphoto2");
	default:
		return lp_ptp_fail(fault, ret, LP_SOURCE_WAITING, "open", "%s", strerror(-ret));
	}
}

static int explain_search(const struct lp_ptp_settings *settings, const struct search *search,
			  struct lp_ptp_fault *fault)
{
	if (search->matches > 1)
		return lp_ptp_fail(fault, -ENOTUNIQ, LP_SOURCE_WAITING, "find",
				   "%d THETA match — name one: ptp:SERIAL (lsusb -v, iSerial)",
				   search->matches);
	if (search->denied)
		return explain_claim(search->error, fault);
	if (search->stills)
		return lp_ptp_fail(fault, -ENODEV, LP_SOURCE_WAITING, "find",
				   "no THETA with the serial number %s among %d on USB",
				   settings->serial, search->stills);
	if (search->ricoh)
		return lp_ptp_fail(fault, -ENODEV, LP_SOURCE_WAITING, "find",
				   "a RICOH camera is there, but offers no stills over USB: in its "
				   "live streaming mode? — press its mode button");
	return lp_ptp_fail(fault, -ENODEV, LP_SOURCE_WAITING, "find",
			   "no RICOH THETA on USB — connect it, and switch it on");
}

static int find(struct usb_port *self, const struct lp_ptp_settings *settings,
		struct lp_ptp_fault *fault)
{
	struct search search = {.found = NULL};
	libusb_device **devices;
	const ssize_t count = libusb_get_device_list(self->context, &devices);
	int ret;

	if (count < 0)
		return explain_claim(to_errno((int)count), fault);
	for (ssize_t i = 0; i < count; i++)
		look_at(self, settings, devices[i], &search);
	if (search.matches != 1) {
		ret = explain_search(settings, &search, fault);
	} else {
		(void)has_stills(self, search.found);
		ret = claim(self, search.found);
		ret = ret < 0 ? explain_claim(ret, fault) : 0;
	}
	libusb_free_device_list(devices, 1);
	return ret;
}

int lp_ptp_usb_open(const struct lp_ptp_settings *settings, struct lp_ptp_port **port,
		    struct lp_ptp_fault *fault)
{
	static const struct lp_ptp_port_ops ops = {.send = usb_send,
						   .receive = usb_receive,
						   .event = usb_event,
						   .close = usb_close};
	struct usb_port *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return explain_claim(-ENOMEM, fault);
	self->base.ops = &ops;
	ret = libusb_init(&self->context);
	if (ret != LIBUSB_SUCCESS) {
		free(self);
		return explain_claim(to_errno(ret), fault);
	}
	ret = find(self, settings, fault);
	if (ret < 0) {
		usb_close(&self->base);
		return ret;
	}
	*port = &self->base;
	return 0;
}
