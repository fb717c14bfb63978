/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pictures in a stream of bytes: where the next one begins and ends. A file is a stream of one or
 * many pictures of one encoding; nothing here does I/O or trusts the bytes.
 */
#ifndef LP_SOURCE_FORMATS_H
#define LP_SOURCE_FORMATS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/frame.h"

#define LP_PICTURE_MAX_BYTES ((size_t)512 << 20) /* an 8K float picture is 354 MB */
#define LP_PICTURE_MAX_SIDE_PX 16384

enum lp_encoding {
	LP_ENCODING_UNKNOWN,
	LP_ENCODING_MJPEG, /* JPEGs one after the other, garbage between them is skipped */
	LP_ENCODING_YUYV,
	LP_ENCODING_NV12,
	LP_ENCODING_GREY,
	LP_ENCODING_PFM,
	LP_ENCODING_JPEG, /* a photo: its first JPEG; previews, gain maps and movies may follow */
};

struct lp_picture {
	enum lp_pixel_format format; /* of the frame it becomes */
	uint32_t width_px, height_px;
	size_t skip_bytes;     /* before the picture: no part of any */
	size_t encoded_bytes;  /* from there: the picture as it stands in the stream */
	size_t frame_bytes;    /* once copied by lp_picture_copy() */
	uint32_t stride_bytes; /* of the frame; 0 for JPEG */
	bool corrupt;	       /* cut off, or no picture can be recognised in it */
	uint32_t channels;     /* PFM: 1 or 3 */
	uint32_t header_bytes; /* PFM */
	float scale;	       /* PFM: samples are multiplied by it */
	bool big_endian;       /* PFM */
};

/* By the name's extension, else by the first bytes (may be NULL); UNKNOWN when neither tells. */
enum lp_encoding lp_encoding_of(const char *path, const uint8_t *data, size_t size_bytes);

/*
 * Find the first picture in `data`. `raw_width_px` and `raw_height_px` size the pictures of YUYV,
 * NV12 and GREY. 1: found. 0: more bytes are needed; those of `skip_bytes` may be dropped already.
 * -ENODATA (only with `at_end`): no picture is left. -EBADMSG: no picture can begin here.
 */
int lp_picture_next(enum lp_encoding encoding, uint32_t raw_width_px, uint32_t raw_height_px,
		    const uint8_t *data, size_t size_bytes, bool at_end,
		    struct lp_picture *picture);

/* Write the frame (`frame_bytes`) of a picture found at `data`. Corrupt pictures copy as they are.
 * Returns the largest finite sample of a float picture, else 0. */
float lp_picture_copy(const struct lp_picture *picture, const uint8_t *data, uint8_t *frame);

#endif
