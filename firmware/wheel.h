/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The polarizer wheel: a hobby servo, a comb on the wheel's rim under two sensors, and if fitted a
 * feedback voltage of the wheel's angle.
 *
 * What is known. A servo does not say where it is. So three things are kept apart: `commanded`,
 * what the pulses ask for; `expected`, the command as it was LAG_MS ago, where a healthy wheel is
 * now; and the evidence. The comb's edges, COMB_PITCH apart, are counted up and down from the first
 * one, which homing finds: the count says between which two edges the wheel is, whatever the servo
 * did. The feedback says it finer, and must agree. This bound is what is reported; when it and the
 * expectation part by more than TOLERANCE, that is a fault with a name.
 *
 * Every move arrives from below: fast to APPROACH below the target, then creeping. The edges passed
 * while creeping correct the servo's zero on the way, so gain errors and crooked servos do not add
 * up; at least two of them, one of each sensor, must fit each other, so that no dying sensor passes
 * for an arrival.
 *
 * Angles in 0.01 degree, times in ms modulo 2^16: moves that would last longer are refused.
 */
#ifndef WHEEL_H
#define WHEEL_H

#include <stdbool.h>
#include <stdint.h>

#include "board/board.h"
#include "safe.h"

struct params;

/* Same values as WheelState.phase. */
enum wheel_phase { WHEEL_UNKNOWN, WHEEL_HOMING, WHEEL_MOVING, WHEEL_SETTLED, WHEEL_FAULT };

enum wheel_step {
	STEP_REST,
	STEP_SEEK,   /* homing: the servo runs to the low end, from wherever it was */
	STEP_SWEEP,  /* homing: creeping up to the comb and over its first edges */
	STEP_TRAVEL, /* to the start of the approach */
	STEP_CREEP,
	STEP_SETTLE,
	STEP_PULSE, /* the servo stands where the host said, whatever the wheel does */
};

/* Same values as Result.result. */
enum wheel_answer {
	ANSWER_OK = 0,
	ANSWER_OUT_OF_RANGE = 3,
	ANSWER_NOT_HOMED = 4,
	ANSWER_IN_FAULT = 5,
	ANSWER_BUSY = 6,
};

#define WHEEL_HOME_EDGES 4
#define WHEEL_HISTORY 4 /* ticks */

/* A ramp of the command. */
struct leg {
	int16_t from_cdeg, to_cdeg;
	uint16_t slew_ddeg_s;
	uint16_t t0_ms;
	int8_t way; /* +1 upwards, -1 downwards */
};

struct wheel {
	const struct params *params;
	struct safe *safe;
	uint8_t phase, step;
	uint8_t token;
	bool changed; /* phase changed and not yet reported */
	uint16_t now_ms;
	uint16_t age_ms; /* of the phase; stays at its maximum */
	uint32_t t_phase_us;

	/* Command. */
	struct leg leg;
	int16_t expected_cdeg; /* where a healthy wheel is now */
	int16_t target_cdeg;
	uint16_t slew_ddeg_s, hold_ds;
	int16_t offset_cdeg, home_offset_cdeg; /* command minus wheel angle, found on the comb */
	bool servo_on;
	uint16_t host_half_us; /* the pulses of STEP_PULSE */
	uint16_t t_step_ms;

	/* Evidence of the comb. */
	int16_t count_zero;	 /* the board's count with the wheel below the comb */
	int16_t below;		 /* edges below the wheel */
	int16_t farthest;	 /* edges below the wheel at its farthest on this leg */
	bool went_back;		 /* by an edge, on this leg */
	uint16_t t_edge_ms;	 /* of the last edge */
	uint8_t proofs;		 /* edges passed while creeping, each where the one before says */
	bool misfit;		 /* one came elsewhere */
	uint8_t levels;		 /* of the sensors */
	uint8_t changes, errors; /* of the sensors, seen so far */
	uint8_t mismatches;	 /* ticks that the levels contradict the count */
	uint8_t doubts; /* ticks that the evidence contradicts itself, or the target at rest */
	int16_t home_cdeg[WHEEL_HOME_EDGES]; /* expected angles as the first edges came */
	int16_t seek_feedback_cdeg;

	/* Evidence of the feedback. */
	bool feedback_known;
	int16_t feedback_cdeg;

	/* Where the wheel was at the last ticks, for its speed. */
	struct {
		uint16_t t_ms;
		int16_t angle_cdeg;
	} history[WHEEL_HISTORY];
	uint8_t history_at;
	uint8_t behinds; /* ticks that the evidence is behind */
	/* It is so for longer than a disturbance lasts, since t_late. */
	bool late;
	uint16_t t_late_ms;
	int16_t late_cdeg;
};

struct wheel_report {
	int16_t commanded_cdeg; /* WHEEL_NO_ANGLE: none */
	int16_t measured_cdeg;	/* WHEEL_NO_ANGLE: unknown */
	uint16_t sigma_cdeg;	/* WHEEL_NO_SIGMA: unknown */
};
#define WHEEL_NO_ANGLE INT16_MIN
#define WHEEL_NO_SIGMA UINT16_MAX

void wheel_init(struct wheel *wheel, const struct params *params, struct safe *safe);

/* Commands; what they start, wheel_tick() carries out. 0 for slew or hold: the parameter's value.
 * A command repeated with its token while it is under way is answered OK and starts nothing. */
enum wheel_answer wheel_home(struct wheel *wheel, uint8_t token);
enum wheel_answer wheel_move(struct wheel *wheel, uint8_t token, int16_t target_cdeg,
			     uint16_t slew_ddeg_s, uint16_t hold_ds);
void wheel_release(struct wheel *wheel);

/* Puts the servo to this pulse, in half microseconds, for HOLD_MAX: to set the gear, before there
 * is a comb to see. The wheel is UNKNOWN then. */
enum wheel_answer wheel_pulse(struct wheel *wheel, uint16_t half_us);

/* Faults were cleared, or the geometry was changed: what was known is not known any more. */
void wheel_forget(struct wheel *wheel);

/* One feedback level (RING_FULL_SCALE), as often as there are new ones. */
void wheel_feedback(struct wheel *wheel, uint16_t level);

/* As often as possible, at least every few milliseconds: how many have passed. */
void wheel_tick(struct wheel *wheel, uint8_t elapsed_ms);

/* Width of the servo's pulses now, in half microseconds; 0: none. */
uint16_t wheel_pulse_half_us(const struct wheel *wheel);

void wheel_report(const struct wheel *wheel, struct wheel_report *report);

#endif
