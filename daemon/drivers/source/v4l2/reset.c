/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/reset.h"

#include <errno.h>

#include "drivers/source/v4l2/nodes.h"

#if WITH_LIBUSB

#include <libusb-1.0/libusb.h>

static int to_errno(int error)
{
	switch (error) {
	case LIBUSB_SUCCESS:
	case LIBUSB_ERROR_NOT_FOUND: /* reset, and it came back as a new device */
		return 0;
	case LIBUSB_ERROR_ACCESS:
		return -EACCES;
	case LIBUSB_ERROR_NO_DEVICE:
		return -ENODEV;
	case LIBUSB_ERROR_NO_MEM:
		return -ENOMEM;
	default:
		return -EIO;
	}
}

static int reset_device(libusb_device *device)
{
	libusb_device_handle *handle;
	int ret = libusb_open(device, &handle);

	if (ret != LIBUSB_SUCCESS)
		return to_errno(ret);
	ret = libusb_reset_device(handle);
	libusb_close(handle);
	return to_errno(ret);
}

/* Bus and address alone could be another device by now: its identity must agree. */
static int is_node(libusb_device *device, const struct lp_v4l2_node *node)
{
	struct libusb_device_descriptor descriptor;

	return libusb_get_bus_number(device) == node->bus &&
	       libusb_get_device_address(device) == node->address &&
	       libusb_get_device_descriptor(device, &descriptor) == LIBUSB_SUCCESS &&
	       descriptor.idVendor == node->vendor && descriptor.idProduct == node->product;
}

int lp_v4l2_reset_port(const struct lp_v4l2_node *node)
{
	libusb_device **devices;
	libusb_context *context;
	int ret = -ENODEV;
	ssize_t count;

	if (!node->usb)
		return -EOPNOTSUPP;
	if (libusb_init(&context) != LIBUSB_SUCCESS)
		return -EIO;
	count = libusb_get_device_list(context, &devices);
	for (ssize_t i = 0; i < count; i++) {
		if (is_node(devices[i], node)) {
			ret = reset_device(devices[i]);
			break;
		}
	}
	if (count >= 0)
		libusb_free_device_list(devices, 1);
	libusb_exit(context);
	return ret;
}

#else

int lp_v4l2_reset_port(const struct lp_v4l2_node *node)
{
	(void)node;
	return -EOPNOTSUPP;
}

#endif
