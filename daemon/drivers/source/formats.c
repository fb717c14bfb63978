/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/formats.h"

#include <endian.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/jpeg_start.h"
#include "base/macros.h"

#define JPEG_MAX_BYTES ((size_t)64 << 20)
#define PFM_HEADER_MAX_BYTES 128

enum lp_encoding lp_encoding_of(const char *path, const uint8_t *data, size_t size_bytes)
{
	static const struct {
		const char *extension;
		enum lp_encoding encoding;
	} known[] = {
		{".jpg", LP_ENCODING_JPEG},   {".jpeg", LP_ENCODING_JPEG},
		{".mjpg", LP_ENCODING_MJPEG}, {".mjpeg", LP_ENCODING_MJPEG},
		{".yuyv", LP_ENCODING_YUYV},  {".nv12", LP_ENCODING_NV12},
		{".grey", LP_ENCODING_GREY},  {".pfm", LP_ENCODING_PFM},
	};
	const char *dot = strrchr(path, '.');

	for (size_t i = 0; dot && i < LP_COUNT(known); i++) {
		if (strcasecmp(dot, known[i].extension) == 0)
			return known[i].encoding;
	}
	if (size_bytes >= 3 && memcmp(data, "\xff\xd8\xff", 3) == 0)
		return LP_ENCODING_JPEG;
	if (size_bytes >= 3 && (memcmp(data, "PF\n", 3) == 0 || memcmp(data, "Pf\n", 3) == 0))
		return LP_ENCODING_PFM;
	return LP_ENCODING_UNKNOWN;
}

/* ---------------------------------------------------------------- JPEG (ITU T.81, B.1) */

enum { JPEG_SOI = 0xd8, JPEG_EOI = 0xd9, JPEG_SOS = 0xda, JPEG_TEM = 0x01 };

/* What a step through a JPEG's markers came to. */
enum jpeg_step { JPEG_NEXT, JPEG_MORE, JPEG_END, JPEG_BROKEN };

struct jpeg_scan {
	const uint8_t *data;
	size_t size, at;
	struct lp_picture *picture;
};

static bool jpeg_is_standalone(uint8_t marker)
{
	return marker == JPEG_TEM || (marker >= 0xd0 && marker <= 0xd7);
}

static bool jpeg_is_frame_header(uint8_t marker)
{
	return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 &&
	       marker != 0xcc;
}

/* Entropy-coded data run to the next marker that is neither stuffing nor a restart. */
static enum jpeg_step jpeg_skip_entropy(struct jpeg_scan *scan)
{
	for (;;) {
		const uint8_t *ff = memchr(scan->data + scan->at, 0xff, scan->size - scan->at);

		if (!ff || ff + 1 == scan->data + scan->size)
			return JPEG_MORE;
		scan->at = (size_t)(ff - scan->data);
		if (ff[1] != 0 && ff[1] != 0xff && !jpeg_is_standalone(ff[1]))
			return JPEG_NEXT;
		scan->at += ff[1] == 0xff ? 1 : 2;
	}
}

/* A segment with a length: note the size of the picture, and step over it. */
static enum jpeg_step jpeg_skip_segment(struct jpeg_scan *scan, uint8_t marker)
{
	const uint8_t *segment = scan->data + scan->at + 2;
	size_t length;

	if (scan->size - scan->at < 4)
		return JPEG_MORE;
	length = (size_t)segment[0] << 8 | segment[1];
	if (length < 2 || (jpeg_is_frame_header(marker) && length < 8))
		return JPEG_BROKEN;
	if (scan->size - scan->at < 2 + length)
		return JPEG_MORE;
	if (jpeg_is_frame_header(marker)) {
		scan->picture->height_px = (uint32_t)segment[3] << 8 | segment[4];
		scan->picture->width_px = (uint32_t)segment[5] << 8 | segment[6];
	}
	scan->at += 2 + length;
	return marker == JPEG_SOS ? jpeg_skip_entropy(scan) : JPEG_NEXT;
}

/* One marker, at scan->at. */
static enum jpeg_step jpeg_step(struct jpeg_scan *scan)
{
	uint8_t marker;

	if (scan->size - scan->at < 2)
		return JPEG_MORE;
	if (scan->data[scan->at] != 0xff)
		return JPEG_BROKEN;
	marker = scan->data[scan->at + 1];
	if (marker == 0xff) { /* fill byte */
		scan->at++;
		return JPEG_NEXT;
	}
	if (marker == JPEG_EOI) {
		scan->at += 2;
		return JPEG_END;
	}
	if (marker == JPEG_SOI || marker == 0)
		return JPEG_BROKEN;
	if (jpeg_is_standalone(marker)) {
		scan->at += 2;
		return JPEG_NEXT;
	}
	return jpeg_skip_segment(scan, marker);
}

static int jpeg_next(const uint8_t *data, size_t size, bool at_end, struct lp_picture *picture)
{
	const size_t start = lp_jpeg_start(data, size, 0);
	struct jpeg_scan scan = {.data = data, .size = size, .at = start + 2, .picture = picture};
	enum jpeg_step step = JPEG_NEXT;

	picture->format = LP_FORMAT_MJPEG;
	picture->skip_bytes = start;
	if (start == size) {
		/* The last two bytes may be the beginning of one. */
		picture->skip_bytes = at_end ? size : size - (size < 2 ? size : 2);
		return at_end ? -ENODATA : 0;
	}
	while (step == JPEG_NEXT)
		step = jpeg_step(&scan);
	if (step == JPEG_BROKEN) {
		scan.at = lp_jpeg_start(data, size, scan.at); /* ends where the next one begins */
		step = scan.at < size ? JPEG_END : JPEG_MORE;
		picture->corrupt = true;
	}
	if (step == JPEG_MORE) {
		if (!at_end && size - start < JPEG_MAX_BYTES)
			return 0;
		scan.at = size;
		picture->corrupt = true;
	}
	if (picture->width_px == 0 || picture->height_px == 0)
		picture->corrupt = true;
	picture->encoded_bytes = scan.at - start;
	picture->frame_bytes = picture->encoded_bytes;
	return 1;
}

/* ---------------------------------------------------------------- raw pixels */

static int raw_next(enum lp_encoding encoding, size_t size, bool at_end, struct lp_picture *picture)
{
	const size_t pixels = (size_t)picture->width_px * picture->height_px;

	picture->stride_bytes = picture->width_px;
	switch (encoding) {
	case LP_ENCODING_YUYV:
		picture->format = LP_FORMAT_YUYV;
		picture->stride_bytes = 2 * picture->width_px;
		picture->frame_bytes = 2 * pixels;
		break;
	case LP_ENCODING_NV12:
		picture->format = LP_FORMAT_NV12;
		picture->frame_bytes = pixels + 2 * (size_t)((picture->width_px + 1) / 2) *
							((picture->height_px + 1) / 2);
		break;
	default:
		picture->format = LP_FORMAT_GREY;
		picture->frame_bytes = pixels;
		break;
	}
	if (pixels == 0 || picture->frame_bytes > LP_PICTURE_MAX_BYTES)
		return -EBADMSG;
	if (size == 0 && at_end)
		return -ENODATA;
	if (size < picture->frame_bytes) {
		if (!at_end)
			return 0;
		picture->corrupt = true;
		picture->frame_bytes = size;
	}
	picture->encoded_bytes = picture->frame_bytes;
	return 1;
}

/* ---------------------------------------------------------------- PFM
 * "PF" (colour) or "Pf" (grey), width, height, scale, each after white space, one white space, then
 * float32 rows from the bottom up; a negative scale means little-endian samples. */

/* 1, 0 (header is not complete) or -EBADMSG. */
static int pfm_header(const uint8_t *data, size_t size, struct lp_picture *picture)
{
	char text[PFM_HEADER_MAX_BYTES + 1];
	unsigned int width, height;
	float scale;
	int length = 0;
	char kind, space;

	size = size < PFM_HEADER_MAX_BYTES ? size : PFM_HEADER_MAX_BYTES;
	memcpy(text, data, size);
	text[size] = '\0';
	/* The widths bound the numbers, ranges are checked below. */
	if (sscanf(text, "P%c %9u %9u %31f%c%n", &kind, &width, &height, &scale, &space, &length) !=
		    5 ||
	    length == 0)
		return size < PFM_HEADER_MAX_BYTES ? 0 : -EBADMSG;
	if ((kind != 'F' && kind != 'f') || width == 0 || height == 0 ||
	    width > LP_PICTURE_MAX_SIDE_PX || height > LP_PICTURE_MAX_SIDE_PX || !isfinite(scale) ||
	    scale == 0 || !strchr(" \n\r\t", space))
		return -EBADMSG;
	picture->width_px = width;
	picture->height_px = height;
	picture->channels = kind == 'F' ? 3 : 1;
	picture->scale = fabsf(scale);
	picture->big_endian = scale > 0;
	picture->header_bytes = (uint32_t)length;
	return 1;
}

static int pfm_next(const uint8_t *data, size_t size, bool at_end, struct lp_picture *picture)
{
	size_t samples;
	int ret;

	picture->format = LP_FORMAT_RGB_F32;
	if (size == 0 && at_end)
		return -ENODATA;
	ret = pfm_header(data, size, picture);
	if (ret <= 0)
		return ret == 0 && at_end ? -EBADMSG : ret;
	samples = (size_t)picture->width_px * picture->height_px;
	picture->stride_bytes = 12 * picture->width_px;
	picture->frame_bytes = 12 * samples;
	picture->encoded_bytes = picture->header_bytes + 4 * samples * picture->channels;
	if (picture->frame_bytes > LP_PICTURE_MAX_BYTES)
		return -EBADMSG;
	if (size >= picture->encoded_bytes)
		return 1;
	if (!at_end)
		return 0;
	picture->corrupt = true;
	picture->encoded_bytes = size;
	picture->frame_bytes = size;
	return 1;
}

static float pfm_sample(const uint8_t *data, bool big_endian)
{
	uint32_t bits;
	float value;

	memcpy(&bits, data, sizeof(bits));
	bits = big_endian ? be32toh(bits) : le32toh(bits);
	memcpy(&value, &bits, sizeof(value));
	return value;
}

/* Row 0 of the frame is up, row 0 of the file is down. Returns the largest finite sample. */
static float pfm_copy(const struct lp_picture *picture, const uint8_t *data, float *frame)
{
	const size_t row_samples = (size_t)picture->width_px * picture->channels;
	float brightest = 0.0F;

	data += picture->header_bytes;
	for (uint32_t row = 0; row < picture->height_px; row++) {
		const uint8_t *in = data + (picture->height_px - 1 - row) * row_samples * 4;

		for (size_t i = 0; i < row_samples; i++, in += 4) {
			const float value = picture->scale * pfm_sample(in, picture->big_endian);

			if (value > brightest && value <= FLT_MAX)
				brightest = value;
			*frame++ = value;
			if (picture->channels == 1) {
				*frame++ = value;
				*frame++ = value;
			}
		}
	}
	return brightest;
}

/* ---------------------------------------------------------------- any */

int lp_picture_next(enum lp_encoding encoding, uint32_t raw_width_px, uint32_t raw_height_px,
		    const uint8_t *data, size_t size_bytes, bool at_end, struct lp_picture *picture)
{
	*picture = (struct lp_picture){0};
	switch (encoding) {
	case LP_ENCODING_MJPEG:
	case LP_ENCODING_JPEG:
		return jpeg_next(data, size_bytes, at_end, picture);
	case LP_ENCODING_PFM:
		return pfm_next(data, size_bytes, at_end, picture);
	case LP_ENCODING_YUYV:
	case LP_ENCODING_NV12:
	case LP_ENCODING_GREY:
		picture->width_px = raw_width_px;
		picture->height_px = raw_height_px;
		return raw_next(encoding, size_bytes, at_end, picture);
	case LP_ENCODING_UNKNOWN:
		break;
	}
	return -EBADMSG;
}

float lp_picture_copy(const struct lp_picture *picture, const uint8_t *data, uint8_t *frame)
{
	data += picture->skip_bytes;
	if (picture->format == LP_FORMAT_RGB_F32 && !picture->corrupt)
		return pfm_copy(picture, data, (float *)(void *)frame);
	memcpy(frame, data, picture->frame_bytes);
	return 0.0F;
}
