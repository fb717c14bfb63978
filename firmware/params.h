/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Parameters: 16-bit numbers with limits, kept in EEPROM in two copies. A save overwrites the older
 * copy, its CRC last, so that a power cut at any byte leaves one whole copy: all old or all new
 * values.
 *
 * A copy: version, generation, count, values (little-endian), CRC-16 over all before it. A copy
 * with fewer values than this firmware knows leaves the rest at their defaults. Of one with more,
 * written by a newer firmware, those it knows are taken; a save keeps the others as they are.
 *
 * A save reads every byte back. A cell that does not hold what was written is written once more;
 * then the save has failed, and the other copy stays the one in use.
 */
#ifndef PARAMS_H
#define PARAMS_H

#include <stdbool.h>
#include <stdint.h>

/* X(name, default, minimum, maximum): numbers and names are ParamValue.param of proto/mcu.dbc. */
#define PARAMS(X)                                                                                \
	X(SERVO_ZERO_US, 800, 300, 2700)	  /* pulse at wheel angle 0 */                   \
	X(SERVO_GAIN_NS_DEG, 7407, -20000, 20000) /* pulse per wheel degree */                   \
	X(SERVO_MIN_US, 500, 300, 2700)		  /* the servo's own limits */                   \
	X(SERVO_MAX_US, 2500, 300, 2700)                                                         \
	X(WHEEL_MIN_CDEG, 0, -2000, 20000) /* targets allowed */                                 \
	X(WHEEL_MAX_CDEG, 18000, -2000, 20000)                                                   \
	X(SLEW_MAX_DDEG_S, 2400, 50, 20000)	  /* fastest travel commanded */                 \
	X(CREEP_DDEG_S, 400, 50, 2000)		  /* speed of the last degrees and of homing */  \
	X(SLEW_PHYSICAL_DDEG_S, 9000, 100, 20000) /* nothing real is faster */                   \
	X(LAG_MS, 30, 0, 500)			  /* of the wheel behind the pulses */           \
	X(SETTLE_MS, 100, 0, 2000)		  /* rest before SETTLED */                      \
	X(HOLD_MAX_DS, 100, 1, 600)		  /* servo powered after settling */             \
	X(APPROACH_CDEG, 900, 200, 3000)	  /* crept upwards before every target */        \
	X(TOLERANCE_CDEG, 650, 100, 2000)	  /* between expectation and evidence */         \
	X(COMB_FIRST_CDEG, -1650, -6000, 6000)	  /* lowest edge of the comb */                  \
	X(COMB_PITCH_CDEG, 300, 50, 3000)	  /* from edge to edge, both sensors together */ \
	X(COMB_EDGES, 68, 4, 400)                                                                \
	X(COMB_ERROR_CDEG, 30, 0, 500)	      /* where an edge may be off */                     \
	X(FEEDBACK_DDEG_FS, 0, -30000, 30000) /* feedback's full scale; 0: not fitted */         \
	X(FEEDBACK_ZERO_LEVEL, 400, -4092, 4092)                                                 \
	X(FEEDBACK_ERROR_CDEG, 100, 10, 2000) /* 3 sigma */                                      \
	X(MAINS_HZ, 50, 50, 60)                                                                  \
	X(BANDGAP_MV, 1100, 900, 1300)	   /* the chip's reference, measured */                  \
	X(SUPPLY_MIN_MV, 3900, 2700, 5500) /* 16 MHz need 3.8 V */                               \
	X(CAN_KBIT_S, 500, 125, 500)                                                             \
	X(CAN_CRYSTAL_MHZ, 8, 8, 16)                                                             \
	X(I2C_ADDRESS, 0x2C, 0x08, 0x77)

enum param {
#define PARAM_ENUM(name, ...) PARAM_##name,
	PARAMS(PARAM_ENUM)
#undef PARAM_ENUM
		PARAM_COUNT,
};

enum params_load {
	PARAMS_LOADED,
	PARAMS_BLANK,	 /* never saved: defaults */
	PARAMS_ONE_COPY, /* the other is corrupt, as after a power cut while saving */
	PARAMS_CORRUPT,	 /* both are, or a value is not allowed: defaults */
};

struct params {
	int16_t values[PARAM_COUNT];
	uint8_t generation; /* of the newest good copy; 0: none */
	uint8_t copy;	    /* where it is: 0 or 1 */
	uint8_t count;	    /* of its values, at least PARAM_COUNT: what a save writes */
	/* A save in progress: next byte to write, PARAMS_IDLE: none; how often it was written. */
	uint8_t save_at, save_tries;
	uint16_t save_crc;
	uint16_t worn_address; /* cell at which the last save failed; PARAMS_SAVED: it did not */
};
#define PARAMS_SAVED 0xFFFF
#define PARAMS_IDLE 0xFF

enum params_load params_load(struct params *params);
void params_defaults(struct params *params);

static inline int16_t param(const struct params *params, enum param which)
{
	return params->values[which];
}

void param_limits(enum param which, int16_t *minimum, int16_t *maximum);

/* False when the value is out of range, or a minimum would not lie below its maximum. */
bool param_set(struct params *params, enum param which, int16_t value);

/* Starts writing; params_poll() goes on with it, one byte a call, until params_saving() is false;
 * then `worn_address` says whether it is stored. Values must not be set meanwhile. */
void params_save(struct params *params);
bool params_saving(const struct params *params);
void params_poll(struct params *params);

#endif
