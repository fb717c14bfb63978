/* SPDX-License-Identifier: Apache-2.0 */
/* What this camera is: formats, sizes, rates, and the choices made on the command line. */
#ifndef UVC_CAMERA_MODEL_H
#define UVC_CAMERA_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Numbers of the entities and of the endpoint, as the descriptors tell them. */
enum {
	CAMERA_TERMINAL = 1,
	CAMERA_PROCESSING_UNIT = 2,
	CAMERA_OUTPUT_TERMINAL = 3,
	CAMERA_VIDEO_CONTROL = 0, /* interfaces */
	CAMERA_VIDEO_STREAMING = 1,
	CAMERA_ENDPOINT = 0x81,
	CAMERA_PACKET_BYTES = 512,
	CAMERA_PAYLOAD_BYTES = 65536,
	CAMERA_CLOCK_HZ = 1000000,
	CAMERA_INTERVAL_HZ = 10000000, /* frame intervals are in 100 ns */
};

enum camera_format { CAMERA_MJPEG, CAMERA_YUYV, CAMERA_NV12, CAMERA_GREY, CAMERA_FORMATS };

enum { CAMERA_MAX_RATES = 3, CAMERA_MAX_SIZES = 6 };

struct camera_size {
	uint16_t width_px, height_px;
	uint8_t rates_hz[CAMERA_MAX_RATES]; /* ends with 0; the first is the default */
};

struct camera_stream {
	const char *name;	/* as in names of picture files: jpg, yuyv, ... */
	const uint8_t *guid;	/* 16 bytes; NULL: MJPEG */
	uint8_t bits_per_pixel; /* of the uncompressed formats */
	struct camera_size sizes[CAMERA_MAX_SIZES]; /* ends with width 0 */
};

extern const struct camera_stream camera_streams[CAMERA_FORMATS];

enum camera_exposure {
	CAMERA_EXPOSURE_SETTABLE,
	CAMERA_EXPOSURE_READ_ONLY,
	CAMERA_EXPOSURE_MISSING
};

struct camera_options {
	uint16_t vendor, product;
	const char *name;
	const char *serial; /* "": none, as cheap cameras */
	enum camera_exposure exposure;
	int delay_frames;     /* from a control's change to its first frame, 0..CAMERA_MAX_DELAY */
	const char *pictures; /* where frames come from, see pictures.h */
	const char *commands; /* path of the control socket */
	const char *controller; /* device side of the bus, "dummy_udc.0" */
	bool verbose;
};

enum { CAMERA_MAX_DELAY = 4 };

int camera_rate_count(const struct camera_size *size);
int camera_size_count(enum camera_format format);
/* Bytes of the largest picture of this size; a JPEG is never larger than YUYV here. */
size_t camera_picture_bytes(enum camera_format format, const struct camera_size *size);

#endif
