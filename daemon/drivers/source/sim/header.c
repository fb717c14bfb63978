/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/sim/header.h"

#include <endian.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/macros.h"

#define MAX_SIDE_PX 16384
#define FLAG_CORRUPT 1U
#define MOST_NOT_UNIT 0.01F /* by which a quaternion's square may differ from 1: it is scaled */
#define LONGEST_EXPOSURE_US 3.6e9F /* an hour: what comes of it is never too large a number */

static uint32_t read_u32(const uint8_t *data)
{
	uint32_t value;

	memcpy(&value, data, sizeof(value));
	return le32toh(value);
}

static uint64_t read_u64(const uint8_t *data)
{
	uint64_t value;

	memcpy(&value, data, sizeof(value));
	return le64toh(value);
}

static float read_float(const uint8_t *data)
{
	const uint32_t bits = read_u32(data);
	float value;

	memcpy(&value, &bits, sizeof(value));
	return value;
}

/* Positive and finite, or unknown. */
static float read_positive(const uint8_t *data)
{
	const float value = read_float(data);

	return isfinite(value) && value > 0 ? value : NAN;
}

static bool read_format(const uint8_t *data, enum lp_pixel_format *format)
{
	static const struct {
		char name[4];
		enum lp_pixel_format format;
	} known[] = {
		{{'M', 'J', 'P', 'G'}, LP_FORMAT_MJPEG},   {{'Y', 'U', 'Y', 'V'}, LP_FORMAT_YUYV},
		{{'N', 'V', '1', '2'}, LP_FORMAT_NV12},	   {{'G', 'R', 'E', 'Y'}, LP_FORMAT_GREY},
		{{'R', 'G', 'B', 'F'}, LP_FORMAT_RGB_F32},
	};

	for (size_t i = 0; i < LP_COUNT(known); i++) {
		if (memcmp(data, known[i].name, 4) == 0) {
			*format = known[i].format;
			return true;
		}
	}
	return false;
}

static uint32_t packed_stride(const struct lp_sim_header *header)
{
	switch (header->format) {
	case LP_FORMAT_MJPEG:
		return 0;
	case LP_FORMAT_YUYV:
		return 2 * header->width_px;
	case LP_FORMAT_RGB_F32:
		return 12 * header->width_px;
	default:
		return header->width_px;
	}
}

/* A raw picture of this size and stride has exactly so many bytes; a JPEG at least some. */
static bool size_is_right(const struct lp_sim_header *header)
{
	uint64_t rows = header->height_px;

	if (header->format == LP_FORMAT_MJPEG)
		return header->payload_bytes > 0;
	if (header->format == LP_FORMAT_NV12)
		rows += (header->height_px + 1) / 2;
	return header->stride_bytes >= packed_stride(header) &&
	       header->payload_bytes == rows * header->stride_bytes;
}

static void read_orientation(const uint8_t *data, float orientation[4])
{
	float square = 0;

	for (int i = 0; i < 4; i++) {
		orientation[i] = read_float(data + 4 * (size_t)i);
		square += orientation[i] * orientation[i];
	}
	/* NAN in one is no rotation either */
	const bool is_rotation = fabsf(square - 1.0F) < MOST_NOT_UNIT;

	for (int i = 0; i < 4; i++)
		orientation[i] = is_rotation ? orientation[i] / sqrtf(square) : NAN;
}

#define FARTHEST_M 1e6F

static void read_position(const uint8_t *data, struct lp_sim_header *header)
{
	const float sigma_m = read_positive(data + 12);
	bool is_place = sigma_m > 0.0F;

	for (int a = 0; a < 3; a++) {
		header->position_m[a] = read_float(data + 4 * (size_t)a);
		is_place = is_place && fabsf(header->position_m[a]) < FARTHEST_M;
	}
	header->position_sigma_m = is_place ? sigma_m : 0.0F;
}

static bool has(const struct lp_sim_header *header, uint32_t end)
{
	return header->header_bytes >= end;
}

void lp_sim_header_parse_more(const uint8_t data[LP_SIM_HEADER_KNOWN_BYTES],
			      struct lp_sim_header *header)
{
	if (has(header, 84)) {
		read_orientation(data + 64, header->orientation);
		if (!isnan(header->orientation[0]))
			header->orientation_sigma_deg = read_positive(data + 80);
	}
	if (has(header, 88)) {
		const float row_time_us = read_float(data + 84);

		if (row_time_us >= 0 && row_time_us <= LONGEST_EXPOSURE_US)
			header->row_time_us = row_time_us;
	}
	if (has(header, 116))
		read_position(data + 100, header);
	if (has(header, 100)) {
		const float least_us = read_positive(data + 88), most_us = read_positive(data + 92);

		header->exposure_fixed = read_float(data + 92) == 0.0F;
		if (least_us <= most_us && most_us <= LONGEST_EXPOSURE_US) {
			header->exposure_min_us = least_us;
			header->exposure_max_us = most_us;
			header->exposure_step_us = read_positive(data + 96);
		}
	}
}

bool lp_sim_header_is_busy(const uint8_t data[LP_SIM_HEADER_BYTES])
{
	return memcmp(data, "BUSY", 4) == 0;
}

const char *lp_sim_header_parse(const uint8_t data[LP_SIM_HEADER_BYTES],
				struct lp_sim_header *header)
{
	if (memcmp(data, "LPF1", 4) != 0)
		return "does not begin with LPF1";
	*header = (struct lp_sim_header){
		.header_bytes = read_u32(data + 4),
		.payload_bytes = read_u64(data + 8),
		.width_px = read_u32(data + 20),
		.height_px = read_u32(data + 24),
		.stride_bytes = read_u32(data + 28),
		.sequence = read_u64(data + 32),
		.t_start_ns = (int64_t)read_u64(data + 40),
		.exposure_us = read_positive(data + 48),
		.gain = read_positive(data + 52),
		.orientation = {NAN, NAN, NAN, NAN},
		.orientation_sigma_deg = NAN,
		.row_time_us = NAN,
		.exposure_min_us = NAN,
		.exposure_max_us = NAN,
		.exposure_step_us = NAN,
	};
	if (header->header_bytes < LP_SIM_HEADER_BYTES ||
	    header->header_bytes > LP_SIM_HEADER_MAX_BYTES)
		return "header_bytes is not within 64..4096";
	if (header->payload_bytes > LP_SIM_PAYLOAD_MAX_BYTES)
		return "payload_bytes is above 128 MiB";
	if (!read_format(data + 16, &header->format))
		return "format is not MJPG, YUYV, NV12, GREY or RGBF";
	if (header->width_px == 0 || header->width_px > MAX_SIDE_PX || header->height_px == 0 ||
	    header->height_px > MAX_SIDE_PX)
		return "width_px or height_px is not within 1..16384";
	if (header->stride_bytes == 0 || header->format == LP_FORMAT_MJPEG)
		header->stride_bytes = packed_stride(header);
	if ((read_u32(data + 56) & FLAG_CORRUPT) || !size_is_right(header) ||
	    header->exposure_us > LONGEST_EXPOSURE_US)
		header->flags |= LP_FRAME_CORRUPT;
	if (header->exposure_us > LONGEST_EXPOSURE_US)
		header->exposure_us = NAN;
	return NULL;
}
