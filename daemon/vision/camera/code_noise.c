/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/code_noise.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "include/frame.h"
#include "vision/camera/response.h"

#define DQT 0xdb
#define SOS 0xda
/* Decoded luma, chroma and green are each rounded to whole codes: squares of what of these errors
 * reaches green, which stands for luminance (1, then .344 and .714 of the two chromas, then 1). */
#define DECODED 2.63F

/* Quantisers of table 0 within one DQT segment. */
static bool table_0(const uint8_t *data, size_t size, float steps[64])
{
	while (size) {
		const int bytes = data[0] >> 4 ? 2 : 1;
		const size_t need = 1 + 64 * (size_t)bytes;

		if (size < need)
			return false;
		for (int k = 0; (data[0] & 15) == 0 && k < 64; k++)
			steps[k] = bytes == 2 ? (float)(data[1 + 2 * k] << 8 | data[2 + 2 * k])
					      : (float)data[1 + k];
		if ((data[0] & 15) == 0)
			return true;
		data += need;
		size -= need;
	}
	return false;
}

static bool quantisers(const uint8_t *data, size_t size, float steps[64])
{
	size_t at = 2;

	while (at + 4 <= size && data[at] == 0xff && data[at + 1] != SOS) {
		const size_t length = (size_t)(data[at + 2] << 8 | data[at + 3]);

		if (length < 2 || at + 2 + length > size)
			return false;
		if (data[at + 1] == DQT && table_0(data + at + 4, length - 2, steps))
			return true;
		at += 2 + length;
	}
	return false;
}

struct lp_code_noise lp_code_noise_of(const struct lp_frame *frame, bool decoded)
{
	struct lp_code_noise noise = {.common = sqrtf(1.0F / 12.0F)};
	float steps[64] = {0.0F}, squares = 0.0F;

	if (frame->format == LP_FORMAT_RGB_F32)
		return (struct lp_code_noise){0};
	if (frame->format != LP_FORMAT_MJPEG || !quantisers(frame->data, frame->size_bytes, steps))
		return noise;
	for (int k = 1; k < 64; k++)
		squares += steps[k] * steps[k];
	noise.pixel = sqrtf(squares / 64.0F / 12.0F);
	noise.common = sqrtf((1.0F + steps[0] * steps[0] / 64.0F) / 12.0F);
	noise.even = sqrtf(((decoded ? DECODED : 0.0F) + steps[0] * steps[0] / 64.0F) / 12.0F);
	return noise;
}

float lp_relative_slope(const struct lp_response *response, float linear)
{
	const float *green = response->pixel[1];
	int v = 1;

	while (v < 254 && green[v] < linear)
		v++;
	return (green[v + 1] - green[v - 1]) / (2.0F * fmaxf(green[v], 1e-6F));
}
