/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/data.h"

#include <math.h>
#include <string.h>

#define TYPE_UINT64 0x0008
#define TYPE_ARRAY 0x4000
#define FORM_LIST 2
#define MANUAL 0x0001  /* ExposureProgramMode */
#define KELVINS 0x8007 /* WhiteBalance: by ColorTemperature */
#define Z1_F5_6 0x0003 /* F-number: the smallest, for the brightest light */

/* ---------------------------------------------------------------- numbers and texts */

struct lp_ptp_reader lp_ptp_reader_of(const uint8_t *data, size_t size_bytes)
{
	return (struct lp_ptp_reader){.at = data, .end = data + size_bytes};
}

static bool has(struct lp_ptp_reader *reader, size_t bytes)
{
	if ((size_t)(reader->end - reader->at) < bytes) {
		reader->failed = true;
		reader->at = reader->end;
		return false;
	}
	return true;
}

uint64_t lp_ptp_read(struct lp_ptp_reader *reader, int bytes)
{
	uint64_t value = 0;

	if (!has(reader, (size_t)bytes))
		return 0;
	for (int i = 0; i < bytes; i++)
		value |= (uint64_t)reader->at[i] << 8 * i;
	reader->at += bytes;
	return value;
}

void lp_ptp_read_text(struct lp_ptp_reader *reader, char *text, size_t size_bytes)
{
	const int length = (int)lp_ptp_read(reader, 1);
	size_t used = 0;

	for (int i = 0; i < length; i++) {
		const uint64_t c = lp_ptp_read(reader, 2);

		if (c && used + 1 < size_bytes)
			text[used++] = (char)(c >= ' ' && c < 0x7f ? c : '?');
	}
	text[used] = '\0';
}

uint8_t *lp_ptp_write(uint8_t *at, uint64_t value, int bytes)
{
	for (int i = 0; i < bytes; i++)
		*at++ = (uint8_t)(value >> 8 * i);
	return at;
}

/* ---------------------------------------------------------------- data sets */

/* An array of codes; those beyond LP_PTP_CODES_MAX are passed over. */
static int read_codes(struct lp_ptp_reader *reader, uint16_t codes[LP_PTP_CODES_MAX])
{
	const uint32_t count = (uint32_t)lp_ptp_read(reader, 4);
	int kept = 0;

	for (uint32_t i = 0; i < count && !reader->failed; i++) {
		const uint16_t code = (uint16_t)lp_ptp_read(reader, 2);

		if (kept < LP_PTP_CODES_MAX)
			codes[kept++] = code;
	}
	return kept;
}

bool lp_ptp_device_read(const uint8_t *data, size_t size_bytes, struct lp_ptp_device *device)
{
	struct lp_ptp_reader reader = lp_ptp_reader_of(data, size_bytes);
	uint16_t passed_over[LP_PTP_CODES_MAX];
	char extension[8];

	memset(device, 0, sizeof(*device));
	(void)lp_ptp_read(&reader, 8); /* versions and the vendor's extension */
	lp_ptp_read_text(&reader, extension, sizeof(extension));
	device->functional_mode = (uint16_t)lp_ptp_read(&reader, 2);
	device->operation_count = read_codes(&reader, device->operations);
	(void)read_codes(&reader, passed_over); /* events */
	device->property_count = read_codes(&reader, device->properties);
	(void)read_codes(&reader, passed_over); /* formats of captures */
	(void)read_codes(&reader, passed_over); /* formats of pictures */
	lp_ptp_read_text(&reader, device->manufacturer, sizeof(device->manufacturer));
	lp_ptp_read_text(&reader, device->model, sizeof(device->model));
	lp_ptp_read_text(&reader, device->version, sizeof(device->version));
	lp_ptp_read_text(&reader, device->serial, sizeof(device->serial));
	return !reader.failed;
}

bool lp_ptp_has(const uint16_t *codes, int count, uint16_t code)
{
	for (int i = 0; i < count; i++)
		if (codes[i] == code)
			return true;
	return false;
}

/* Bytes of a number's type; 0: no number, or a larger one. */
static int bytes_of(uint16_t type)
{
	return type == 0 || type > TYPE_UINT64 ? 0 : 1 << (type - 1) / 2;
}

bool lp_ptp_values_read(const uint8_t *data, size_t size_bytes, struct lp_ptp_values *values)
{
	struct lp_ptp_reader reader = lp_ptp_reader_of(data, size_bytes);
	int bytes, count;

	values->count = 0;
	(void)lp_ptp_read(&reader, 2); /* the property */
	bytes = bytes_of((uint16_t)lp_ptp_read(&reader, 2));
	if (!bytes)
		return false;
	(void)lp_ptp_read(&reader, 1); /* whether it can be set */
	(void)lp_ptp_read(&reader, bytes);
	(void)lp_ptp_read(&reader, bytes);
	if (lp_ptp_read(&reader, 1) != FORM_LIST)
		return false;
	count = (int)lp_ptp_read(&reader, 2);
	for (int i = 0; i < count && !reader.failed; i++) {
		const uint64_t value = lp_ptp_read(&reader, bytes);

		if (values->count < LP_PTP_VALUES_MAX && !reader.failed)
			values->values[values->count++] = value;
	}
	return !reader.failed && values->count > 0;
}

float lp_ptp_shutter_us(uint64_t value)
{
	const uint32_t numerator = (uint32_t)(value >> 32), denominator = (uint32_t)value;

	return denominator ? (float)(1e6 * numerator / denominator) : 0.0F;
}

void lp_ptp_bracket_write(const struct lp_ptp_bracket *bracket, uint8_t *data)
{
	uint8_t *at = lp_ptp_write(data, 2 * (uint64_t)bracket->count, 4);

	for (int i = 0; i < bracket->count; i++) {
		at = lp_ptp_write(at, 0, 2); /* ExposureBiasCompensation */
		at = lp_ptp_write(at, bracket->iso, 2);
		at = lp_ptp_write(at, bracket->shutters[i], 8);
		at = lp_ptp_write(at, bracket->family == LP_PTP_THETA_Z1 ? Z1_F5_6 : 0, 2);
		at = lp_ptp_write(at, MANUAL, 2);
		at = lp_ptp_write(at, 0, 8); /* reserved: 12 bytes */
		at = lp_ptp_write(at, 0, 4);
		at = lp_ptp_write(at, bracket->kelvins, 2);
		at = lp_ptp_write(at, bracket->family == LP_PTP_THETA_X ? 0 : KELVINS, 2);
	}
}

/* ---------------------------------------------------------------- exposures */

/* The listed one nearest to exposure_us of those longer than above_us. 0: there is none. */
static uint64_t nearest(const struct lp_ptp_values *list, float exposure_us, float above_us)
{
	float least = INFINITY;
	uint64_t found = 0;

	for (int i = 0; i < list->count; i++) {
		const float us = lp_ptp_shutter_us(list->values[i]);
		const float stops = fabsf(log2f(us / exposure_us));

		if (us > above_us && stops < least) {
			least = stops;
			found = list->values[i];
		}
	}
	return found;
}

static float shortest_of(const struct lp_ptp_values *list)
{
	float shortest_us = INFINITY;

	for (int i = 0; i < list->count; i++) {
		const float us = lp_ptp_shutter_us(list->values[i]);

		if (us > 0.0F && us < shortest_us)
			shortest_us = us;
	}
	return shortest_us;
}

int lp_ptp_choose(const struct lp_ptp_values *list, float shortest_us, float stops, int count,
		  uint64_t *shutters)
{
	float wanted_us = shortest_us > 0.0F ? shortest_us : shortest_of(list), last_us = 0.0F;
	float longest_us = 0.0F;

	for (int i = 0; i < list->count; i++)
		longest_us = fmaxf(longest_us, lp_ptp_shutter_us(list->values[i]));
	for (int k = 0; k < count; k++) {
		/* lists go in thirds of a stop */
		if (wanted_us > longest_us * 1.2F)
			return k;
		shutters[k] = nearest(list, wanted_us, last_us);
		if (!shutters[k])
			return k;
		last_us = lp_ptp_shutter_us(shutters[k]);
		wanted_us *= exp2f(stops);
	}
	return count;
}
