/* SPDX-License-Identifier: Apache-2.0 */
/* JPEGs of every kind for tests, by libjpeg-turbo's own encoder, and its own view of their blocks.
 */
#ifndef LP_TESTS_JPEG_ENCODE_H
#define LP_TESTS_JPEG_ENCODE_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>

struct jpeg_kind {
	int components; /* 1 or 3 */
	int h, v;	/* luma sampling */
	int quality;
	int restart; /* MCUs; 0: none */
	int optimize;
	int progressive;
};

/* A picture with edges, gradients and texture of all strengths. */
static inline uint8_t test_sample(int x, int y, int c)
{
	const uint32_t hash =
		(uint32_t)x * 73856093U ^ (uint32_t)y * 19349663U ^ (uint32_t)c * 83492791U;
	const int noise = (int)(hash >> 13) % ((x / 32 % 4) * 20 + 1);
	const int value = (x + 2 * y + 40 * c) % 256;

	return (uint8_t)((x / 24 + y / 24) % 5 == 0 ? 255 : (value + noise) % 256);
}

static inline uint8_t *encode_jpeg(const struct jpeg_kind *kind, int width, int height,
				   unsigned long *size)
{
	struct jpeg_compress_struct info;
	struct jpeg_error_mgr errors;
	uint8_t *out = NULL, *row = malloc((size_t)width * 3);

	*size = 0;
	info.err = jpeg_std_error(&errors);
	jpeg_create_compress(&info);
	jpeg_mem_dest(&info, &out, size);
	info.image_width = width;
	info.image_height = height;
	info.input_components = kind->components;
	info.in_color_space = kind->components == 1 ? JCS_GRAYSCALE : JCS_RGB;
	jpeg_set_defaults(&info);
	jpeg_set_quality(&info, kind->quality, TRUE);
	info.comp_info[0].h_samp_factor = kind->h;
	info.comp_info[0].v_samp_factor = kind->v;
	info.restart_interval = kind->restart;
	info.optimize_coding = kind->optimize;
	if (kind->progressive)
		jpeg_simple_progression(&info);
	jpeg_start_compress(&info, TRUE);
	for (int y = 0; y < height; y++) {
		JSAMPROW rows[1] = {row};

		for (int x = 0; x < width * kind->components; x++)
			row[x] = test_sample(x / kind->components, y, x % kind->components);
		jpeg_write_scanlines(&info, rows, 1);
	}
	jpeg_finish_compress(&info);
	jpeg_destroy_compress(&info);
	free(row);
	return out;
}

/* Take every DHT segment out, as Motion JPEG does. */
static inline void strip_dht(uint8_t *data, unsigned long *size)
{
	unsigned long at = 2;

	while (at + 4 <= *size && data[at + 1] != 0xda) {
		const unsigned long length = 2 + ((unsigned long)data[at + 2] << 8 | data[at + 3]);

		if (data[at + 1] == 0xc4) {
			memmove(data + at, data + at + length, *size - at - length);
			*size -= length;
		} else {
			at += length;
		}
	}
}

#endif
