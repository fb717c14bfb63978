/* SPDX-License-Identifier: Apache-2.0 */
#include "params.h"

#include "board/board.h"
#include "envelope.h"

#define COPY_STRIDE 256
#define VERSION 1
#define HEADER 3 /* version, generation, count */
#define SIZE(count) (HEADER + 2 * (count) + 2)

struct limits {
	int16_t initial, minimum, maximum;
};

static const BOARD_FLASH struct limits table[PARAM_COUNT] = {
#define PARAM_LIMITS(name, initial, minimum, maximum) {initial, minimum, maximum},
	PARAMS(PARAM_LIMITS)
#undef PARAM_LIMITS
};

/* A copy is counted in 8 bits. */
#define COUNT_MOST ((PARAMS_IDLE - 1 - SIZE(0)) / 2)
_Static_assert(PARAM_COUNT <= COUNT_MOST, "so many parameters have no place");

#define TRIES 2 /* to write a cell */

void params_defaults(struct params *params)
{
	params->count = PARAM_COUNT;
	for (uint8_t i = 0; i < PARAM_COUNT; i++)
		params->values[i] = table[i].initial;
}

void param_limits(enum param which, int16_t *minimum, int16_t *maximum)
{
	*minimum = table[which].minimum;
	*maximum = table[which].maximum;
}

static bool within_limits(enum param which, int16_t value)
{
	return value >= table[which].minimum && value <= table[which].maximum;
}

/* Limits that are parameters themselves: the lower one lies below the upper one. */
static bool ordered(const struct params *params)
{
	const int16_t *values = params->values;

	return values[PARAM_SERVO_MIN_US] < values[PARAM_SERVO_MAX_US] &&
	       values[PARAM_WHEEL_MIN_CDEG] < values[PARAM_WHEEL_MAX_CDEG];
}

bool param_set(struct params *params, enum param which, int16_t value)
{
	int16_t former = params->values[which];

	if (!within_limits(which, value))
		return false;
	params->values[which] = value;
	if (ordered(params))
		return true;
	params->values[which] = former;
	return false;
}

static uint8_t stored(uint8_t copy, uint8_t at)
{
	return board_eeprom_read((uint16_t)copy * COPY_STRIDE + at);
}

static bool copy_blank(uint8_t copy)
{
	for (uint8_t i = 0; i < HEADER; i++) {
		if (stored(copy, i) != 0xFF)
			return false;
	}
	return true;
}

static bool copy_good(uint8_t copy)
{
	uint8_t count = stored(copy, 2);
	uint16_t crc = CRC16_START;

	if (stored(copy, 0) != VERSION || stored(copy, 1) == 0 || count == 0 || count > COUNT_MOST)
		return false;
	for (uint8_t i = 0; i < SIZE(count) - 2; i++)
		crc = crc16(crc, stored(copy, i));
	return stored(copy, SIZE(count) - 2) == (crc & 0xFF) &&
	       stored(copy, SIZE(count) - 1) == crc >> 8;
}

/* False when a value is not allowed, as after a firmware with wider limits: then all defaults hold,
 * for the values belong together. */
static bool take(struct params *params, uint8_t copy)
{
	uint8_t count = stored(copy, 2);
	bool allowed = true;

	params->copy = copy;
	params->generation = stored(copy, 1);
	if (count > PARAM_COUNT)
		params->count = count;
	for (uint8_t i = 0; i < count && i < PARAM_COUNT; i++) {
		uint8_t at = HEADER + 2 * i;
		params->values[i] = (int16_t)(stored(copy, at) | stored(copy, at + 1) << 8);
		allowed = allowed && within_limits(i, params->values[i]);
	}
	if (allowed && ordered(params))
		return true;
	params_defaults(params);
	return false;
}

enum params_load params_load(struct params *params)
{
	bool good[2] = {copy_good(0), copy_good(1)};

	params_defaults(params);
	params->generation = 0;
	params->copy = 1;
	params->save_at = PARAMS_IDLE;
	params->worn_address = PARAMS_SAVED;
	if (!good[0] && !good[1])
		return copy_blank(0) && copy_blank(1) ? PARAMS_BLANK : PARAMS_CORRUPT;
	if (good[0] && good[1]) {
		/* Generations count up modulo 255 and differ by one. */
		if (!take(params, (int8_t)(stored(1, 1) - stored(0, 1)) > 0))
			return PARAMS_CORRUPT;
		return PARAMS_LOADED;
	}
	if (!take(params, good[1]))
		return PARAMS_CORRUPT;
	return copy_blank(!params->copy) ? PARAMS_LOADED : PARAMS_ONE_COPY;
}

static uint8_t byte_to_store(const struct params *params, uint8_t at)
{
	if (at == 0)
		return VERSION;
	if (at == 1)
		return params->generation == 0xFF ? 1 : params->generation + 1;
	if (at == 2)
		return params->count;
	if (at == SIZE(params->count) - 2)
		return params->save_crc & 0xFF;
	if (at == SIZE(params->count) - 1)
		return params->save_crc >> 8;
	if (at >= HEADER + 2 * PARAM_COUNT) /* a newer firmware's */
		return stored(params->copy, at);
	uint16_t value = (uint16_t)params->values[(at - HEADER) / 2];
	return (at - HEADER) & 1 ? value >> 8 : value & 0xFF;
}

void params_save(struct params *params)
{
	params->save_at = 0;
	params->save_tries = 0;
	params->save_crc = CRC16_START;
	params->worn_address = PARAMS_SAVED;
}

bool params_saving(const struct params *params)
{
	return params->save_at != PARAMS_IDLE;
}

static void save_failed(struct params *params, uint16_t address)
{
	params->worn_address = address;
	params->save_at = PARAMS_IDLE;
	if (params->generation == 0) /* neither copy is good: the next save tries the other one */
		params->copy = !params->copy;
}

void params_poll(struct params *params)
{
	uint8_t at = params->save_at;
	uint16_t address = (uint16_t)!params->copy * COPY_STRIDE + at;

	if (at == PARAMS_IDLE || !board_eeprom_ready())
		return;
	if (at == SIZE(params->count)) {
		params->generation = byte_to_store(params, 1);
		params->copy = !params->copy;
		params->save_at = PARAMS_IDLE;
		return;
	}
	uint8_t value = byte_to_store(params, at);
	if (board_eeprom_read(address) == value) {
		if (at < SIZE(params->count) - 2)
			params->save_crc = crc16(params->save_crc, value);
		params->save_at++;
		params->save_tries = 0;
	} else if (params->save_tries == TRIES) {
		save_failed(params, address);
	} else {
		board_eeprom_write(address, value);
		params->save_tries++;
	}
}
