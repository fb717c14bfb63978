/* SPDX-License-Identifier: Apache-2.0 */
#include "model.h"

/* GUIDs of uncompressed formats: the FOURCC, then a fixed tail. */
#define FOURCC_GUID(a, b, c, d)                                                  \
	(const uint8_t[16])                                                      \
	{                                                                        \
		a, b, c, d, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71 \
	}

const struct camera_stream camera_streams[CAMERA_FORMATS] = {
	[CAMERA_MJPEG] = {.name = "jpg",
			  .sizes = {{1920, 960, {30, 15, 5}},
				    {1472, 736, {30, 15}},
				    {1280, 720, {30, 15}},
				    {640, 320, {30, 15, 5}}}},
	[CAMERA_YUYV] = {.name = "yuyv",
			 .guid = FOURCC_GUID('Y', 'U', 'Y', '2'),
			 .bits_per_pixel = 16,
			 .sizes = {{640, 320, {30, 15, 5}}, {1920, 960, {5}}}},
	[CAMERA_NV12] = {.name = "nv12",
			 .guid = FOURCC_GUID('N', 'V', '1', '2'),
			 .bits_per_pixel = 12,
			 .sizes = {{640, 320, {30, 15, 5}}}},
	[CAMERA_GREY] = {.name = "grey",
			 .guid = FOURCC_GUID('Y', '8', '0', '0'),
			 .bits_per_pixel = 8,
			 .sizes = {{640, 320, {30, 15, 5}}}},
};

int camera_rate_count(const struct camera_size *size)
{
	int count = 0;

	while (count < CAMERA_MAX_RATES && size->rates_hz[count])
		count++;
	return count;
}

int camera_size_count(enum camera_format format)
{
	int count = 0;

	while (count < CAMERA_MAX_SIZES && camera_streams[format].sizes[count].width_px)
		count++;
	return count;
}

size_t camera_picture_bytes(enum camera_format format, const struct camera_size *size)
{
	int bits = camera_streams[format].guid ? camera_streams[format].bits_per_pixel : 16;

	return (size_t)size->width_px * size->height_px * bits / 8;
}
