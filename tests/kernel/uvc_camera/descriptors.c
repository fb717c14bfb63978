/* SPDX-License-Identifier: Apache-2.0 */
#include "descriptors.h"
#include <errno.h>
#include <string.h>
#include <linux/usb/video.h>
#include "bytes.h"

enum { STRING_MAKER = 1, STRING_NAME, STRING_SERIAL };

const struct usb_endpoint_descriptor descriptors_endpoint = {
	.bLength = USB_DT_ENDPOINT_SIZE,
	.bDescriptorType = USB_DT_ENDPOINT,
	.bEndpointAddress = CAMERA_ENDPOINT,
	.bmAttributes = USB_ENDPOINT_XFER_BULK,
	.wMaxPacketSize = CAMERA_PACKET_BYTES,
};

/* Starts a descriptor whose length is filled in by close_descriptor(). */
static uint8_t *open_descriptor(uint8_t *at, uint8_t type, uint8_t subtype)
{
	at = put8(at, 0);
	at = put8(at, type);
	return type == USB_DT_CS_INTERFACE ? put8(at, subtype) : at;
}

static uint8_t *close_descriptor(uint8_t *start, uint8_t *end)
{
	*start = (uint8_t)(end - start);
	return end;
}

static uint8_t *put_interface(uint8_t *at, uint8_t number, uint8_t endpoints, uint8_t subclass)
{
	const uint8_t body[] = {number, 0, endpoints, USB_CLASS_VIDEO, subclass, 0, STRING_NAME};
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_INTERFACE, 0);
	return close_descriptor(start, put_bytes(at, body, sizeof(body)));
}

static uint8_t *put_camera_terminal(uint8_t *at, const struct camera_options *options)
{
	bool exposure = options->exposure != CAMERA_EXPOSURE_MISSING;
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VC_INPUT_TERMINAL);
	at = put8(at, CAMERA_TERMINAL);
	at = put16(at, UVC_ITT_CAMERA);
	at = put16(at, 0); /* associated terminal, name */
	at = put16(at, 0); /* no zoom lens: focal lengths, multiplier */
	at = put16(at, 0);
	at = put16(at, 0);
	at = put8(at, 2); /* bytes of the bit map: D1 auto-exposure mode, D3 exposure time */
	at = put16(at, exposure ? 1 << 1 | 1 << 3 : 0);
	return close_descriptor(start, at);
}

static uint8_t *put_processing_unit(uint8_t *at)
{
	/* D0 brightness, D4 sharpness, D6 white balance, D8 backlight, D9 gain, D10 power line,
	 * D12 automatic white balance */
	uint16_t controls = 1 << 0 | 1 << 4 | 1 << 6 | 1 << 8 | 1 << 9 | 1 << 10 | 1 << 12;
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VC_PROCESSING_UNIT);
	at = put8(at, CAMERA_PROCESSING_UNIT);
	at = put8(at, CAMERA_TERMINAL); /* its input */
	at = put16(at, 0);		/* no digital zoom */
	at = put8(at, 2);
	at = put16(at, controls);
	at = put16(at, 0); /* name, analog video standards */
	return close_descriptor(start, at);
}

static uint8_t *put_output_terminal(uint8_t *at)
{
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VC_OUTPUT_TERMINAL);
	at = put8(at, CAMERA_OUTPUT_TERMINAL);
	at = put16(at, UVC_TT_STREAMING);
	at = put8(at, 0);
	at = put8(at, CAMERA_PROCESSING_UNIT); /* its input */
	at = put8(at, 0);
	return close_descriptor(start, at);
}

static uint8_t *put_video_control(uint8_t *at, const struct camera_options *options)
{
	uint8_t *start, *header;

	at = put_interface(at, CAMERA_VIDEO_CONTROL, 0, UVC_SC_VIDEOCONTROL);
	start = header = at;
	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VC_HEADER);
	at = put16(at, 0x0110); /* UVC 1.1 */
	at = put16(at, 0);	/* total length, below */
	at = put32(at, CAMERA_CLOCK_HZ);
	at = put8(at, 1);
	at = put8(at, CAMERA_VIDEO_STREAMING);
	at = close_descriptor(header, at);
	at = put_camera_terminal(at, options);
	at = put_processing_unit(at);
	at = put_output_terminal(at);
	put16(start + 5, (uint16_t)(at - start));
	return at;
}

static uint8_t *put_frame(uint8_t *at, enum camera_format format, int index)
{
	const struct camera_size *size = &camera_streams[format].sizes[index];
	bool jpeg = format == CAMERA_MJPEG;
	size_t picture_bytes = camera_picture_bytes(format, size);
	int rates = camera_rate_count(size);
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_CS_INTERFACE,
			     jpeg ? UVC_VS_FRAME_MJPEG : UVC_VS_FRAME_UNCOMPRESSED);
	at = put8(at, (uint8_t)(index + 1));
	at = put8(at, 0); /* no still pictures */
	at = put16(at, size->width_px);
	at = put16(at, size->height_px);
	at = put32(at, (uint32_t)(picture_bytes * 8 * size->rates_hz[rates - 1] / (jpeg ? 10 : 1)));
	at = put32(at, (uint32_t)(picture_bytes * 8 * size->rates_hz[0]));
	at = put32(at, (uint32_t)picture_bytes);
	at = put32(at, CAMERA_INTERVAL_HZ / size->rates_hz[0]);
	at = put8(at, (uint8_t)rates);
	for (int i = 0; i < rates; i++)
		at = put32(at, CAMERA_INTERVAL_HZ / size->rates_hz[i]);
	return close_descriptor(start, at);
}

static uint8_t *put_format(uint8_t *at, enum camera_format format)
{
	const struct camera_stream *stream = &camera_streams[format];
	uint8_t *start = at;

	at = open_descriptor(at, USB_DT_CS_INTERFACE,
			     stream->guid ? UVC_VS_FORMAT_UNCOMPRESSED : UVC_VS_FORMAT_MJPEG);
	at = put8(at, (uint8_t)(format + 1));
	at = put8(at, (uint8_t)camera_size_count(format));
	if (stream->guid) {
		at = put_bytes(at, stream->guid, 16);
		at = put8(at, stream->bits_per_pixel);
	} else {
		at = put8(at, 0); /* samples of no fixed size */
	}
	at = put8(at, 1);  /* default size */
	at = put16(at, 0); /* aspect ratio: square pixels */
	at = put16(at, 0); /* not interlaced, copying allowed */
	at = close_descriptor(start, at);
	for (int i = 0; i < camera_size_count(format); i++)
		at = put_frame(at, format, i);
	start = at;
	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VS_COLORFORMAT);
	at = put8(at, 1); /* primaries of BT.709, its transfer, matrix of BT.601 */
	at = put8(at, 1);
	at = put8(at, 4);
	return close_descriptor(start, at);
}

static uint8_t *put_video_streaming(uint8_t *at)
{
	const uint8_t tail[] = {CAMERA_ENDPOINT, 0, CAMERA_OUTPUT_TERMINAL, 0, 0, 0, 1};
	uint8_t *start, *header;

	at = put_interface(at, CAMERA_VIDEO_STREAMING, 1, UVC_SC_VIDEOSTREAMING);
	start = header = at;
	at = open_descriptor(at, USB_DT_CS_INTERFACE, UVC_VS_INPUT_HEADER);
	at = put8(at, CAMERA_FORMATS);
	at = put16(at, 0); /* total length, below */
	at = put_bytes(at, tail, sizeof(tail));
	for (int i = 0; i < CAMERA_FORMATS; i++)
		at = put8(at, 0); /* no controls per format */
	at = close_descriptor(header, at);
	for (int i = 0; i < CAMERA_FORMATS; i++)
		at = put_format(at, i);
	put16(start + 4, (uint16_t)(at - start));
	return put_bytes(at, &descriptors_endpoint, USB_DT_ENDPOINT_SIZE);
}

static int configuration(const struct camera_options *options, uint8_t *data)
{
	const uint8_t head[] = {USB_DT_CONFIG_SIZE, USB_DT_CONFIG, 0, 0, 2, 1, 0, 0x80, 250};
	const uint8_t association[] = {8,
				       USB_DT_INTERFACE_ASSOCIATION,
				       CAMERA_VIDEO_CONTROL,
				       2,
				       USB_CLASS_VIDEO,
				       UVC_SC_VIDEO_INTERFACE_COLLECTION,
				       0,
				       STRING_NAME};
	uint8_t *at = put_bytes(data, head, sizeof(head));

	at = put_bytes(at, association, sizeof(association));
	at = put_video_control(at, options);
	at = put_video_streaming(at);
	put16(data + 2, (uint16_t)(at - data));
	return (int)(at - data);
}

static int device(const struct camera_options *options, uint8_t *data)
{
	const struct usb_device_descriptor descriptor = {
		.bLength = USB_DT_DEVICE_SIZE,
		.bDescriptorType = USB_DT_DEVICE,
		.bcdUSB = 0x0200,
		.bDeviceClass = USB_CLASS_MISC,
		.bDeviceSubClass = 2, /* with interface association */
		.bDeviceProtocol = 1,
		.bMaxPacketSize0 = 64,
		.idVendor = options->vendor,
		.idProduct = options->product,
		.bcdDevice = 0x0100,
		.iManufacturer = STRING_MAKER,
		.iProduct = STRING_NAME,
		.iSerialNumber = *options->serial ? STRING_SERIAL : 0,
		.bNumConfigurations = 1,
	};

	memcpy(data, &descriptor, USB_DT_DEVICE_SIZE);
	return USB_DT_DEVICE_SIZE;
}

static int qualifier(uint8_t *data)
{
	const uint8_t body[] = {10, USB_DT_DEVICE_QUALIFIER, 0, 2, USB_CLASS_MISC, 2, 1, 64, 1, 0};

	memcpy(data, body, sizeof(body));
	return sizeof(body);
}

static int string(const struct camera_options *options, uint8_t index, uint8_t *data)
{
	const char *texts[] = {
		[STRING_MAKER] = "lightprobe",
		[STRING_NAME] = options->name,
		[STRING_SERIAL] = options->serial,
	};
	uint8_t *at = data + 2;

	if (index >= sizeof(texts) / sizeof(texts[0]))
		return -EPIPE;
	if (index == 0)
		at = put16(at, 0x0409); /* the one language: English */
	else
		for (const char *c = texts[index]; *c; c++)
			at = put16(at, (uint8_t)*c);
	data[0] = (uint8_t)(at - data);
	data[1] = USB_DT_STRING;
	return data[0];
}

int descriptors_get(const struct camera_options *options, uint8_t type, uint8_t index,
		    uint8_t *data)
{
	switch (type) {
	case USB_DT_DEVICE:
		return device(options, data);
	case USB_DT_DEVICE_QUALIFIER:
		return qualifier(data);
	case USB_DT_CONFIG:
		return configuration(options, data);
	case USB_DT_STRING:
		return string(options, index, data);
	default:
		return -EPIPE;
	}
}
