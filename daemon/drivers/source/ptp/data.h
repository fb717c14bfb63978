/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Data sets of PTP (ISO 15740; little-endian over USB), as RICOH's THETA USB API v2 uses them:
 * github.com/ricohapi/theta-api-specs, folder theta-usb-api. Nothing here does I/O or trusts the
 * bytes. Pure; any thread.
 */
#ifndef LP_SOURCE_PTP_DATA_H
#define LP_SOURCE_PTP_DATA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Reads beyond the end give 0 and set `failed`. */
struct lp_ptp_reader {
	const uint8_t *at, *end;
	bool failed;
};

struct lp_ptp_reader lp_ptp_reader_of(const uint8_t *data, size_t size_bytes);
uint64_t lp_ptp_read(struct lp_ptp_reader *reader, int bytes); /* 1..8 */
/* UCS-2 with its length before it, as ASCII; other characters become '?'. */
void lp_ptp_read_text(struct lp_ptp_reader *reader, char *text, size_t size_bytes);

/* At most 8 bytes, little-endian. Returns what follows them. */
uint8_t *lp_ptp_write(uint8_t *at, uint64_t value, int bytes);

#define LP_PTP_CODES_MAX 256

/* DeviceInfo. */
struct lp_ptp_device {
	uint16_t functional_mode;
	uint16_t operations[LP_PTP_CODES_MAX], properties[LP_PTP_CODES_MAX];
	int operation_count, property_count;
	char manufacturer[64], model[64], version[32], serial[64];
};
/* False: it is no DeviceInfo. */
bool lp_ptp_device_read(const uint8_t *data, size_t size_bytes, struct lp_ptp_device *device);
bool lp_ptp_has(const uint16_t *codes, int count, uint16_t code);

#define LP_PTP_VALUES_MAX 128

/* The values that a property lists (form flag 2), of numbers of up to 8 bytes. */
struct lp_ptp_values {
	uint64_t values[LP_PTP_VALUES_MAX];
	int count;
};
/* False: no DevicePropDesc, or one without a list. */
bool lp_ptp_values_read(const uint8_t *data, size_t size_bytes, struct lp_ptp_values *values);

/* ShutterSpeed: numerator in the upper half, denominator in the lower one. 0: automatic. */
float lp_ptp_shutter_us(uint64_t value);

/* How BracketParameters are laid out. */
enum lp_ptp_family { LP_PTP_THETA_X, LP_PTP_THETA_Z1, LP_PTP_THETA_V };

struct lp_ptp_bracket {
	enum lp_ptp_family family;
	int count;
	const uint64_t *shutters; /* as ShutterSpeed */
	uint16_t iso, kelvins;
};

/* Two units of 16 bytes for each exposure, after their number. */
#define LP_PTP_BRACKET_BYTES(count) (4 + 32 * (size_t)(count))

/* The value of BracketParameters: LP_PTP_BRACKET_BYTES(count). */
void lp_ptp_bracket_write(const struct lp_ptp_bracket *bracket, uint8_t *data);

/*
 * `count` shutter speeds of a list, ascending, the first nearest to shortest_us (0: the shortest
 * there is), each as near as can be to `stops` from the one before. Returns how many there are:
 * fewer where the list ends.
 */
int lp_ptp_choose(const struct lp_ptp_values *list, float shortest_us, float stops, int count,
		  uint64_t *shutters);

#endif
