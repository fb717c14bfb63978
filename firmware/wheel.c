/* SPDX-License-Identifier: Apache-2.0 */
#include "wheel.h"

#include "board/board.h"
#include "evidence.h"
#include "params.h"
#include "safe.h"

#define NOT_YET_MS 64000  /* since the start of a leg: it lies in the future */
#define LEG_MOST_MS 60000 /* longest leg that the clock can hold, with its lag */
#define TRAVEL_CDEG 27000 /* of a servo with its gear, end to end */
#define SEEK_MARGIN_MS 300
#define BELOW_COMB_CDEG 900 /* homing starts this far below the comb */
#define HOME_ERROR_CDEG 200 /* of the distance between edges, as homing sees it */
#define QUIET_MS 60	    /* without an edge: the wheel stands, or creeps at most */
#define WAKE_MS 100	    /* of a servo that was not supplied: its slow switch, its start */
#define PROOFS 2	    /* edges that must fit each other before an arrival */
#define PROOF_CDEG 100	    /* how well */

static int16_t value(const struct wheel *wheel, enum param which)
{
	return param(wheel->params, which);
}

/* --- command -------------------------------------------------------------------------------- */

static int16_t leg_at(const struct leg *leg, uint16_t t_ms)
{
	uint16_t elapsed_ms = t_ms - leg->t0_ms;
	int16_t distance_cdeg = leg->to_cdeg - leg->from_cdeg;

	if (elapsed_ms > NOT_YET_MS || distance_cdeg == 0)
		return leg->from_cdeg;
	uint32_t passed_cdeg = (uint32_t)elapsed_ms * leg->slew_ddeg_s / 100;
	if (passed_cdeg >= (uint16_t)(distance_cdeg < 0 ? -distance_cdeg : distance_cdeg))
		return leg->to_cdeg;
	return leg->from_cdeg + (distance_cdeg < 0 ? -(int16_t)passed_cdeg : (int16_t)passed_cdeg);
}

/* Once a tick, and when the leg changes: long divisions are dear here. */
static void expect(struct wheel *wheel)
{
	wheel->expected_cdeg = leg_at(&wheel->leg, wheel->now_ms - value(wheel, PARAM_LAG_MS));
}

bool wheel_arrived(const struct wheel *wheel)
{
	return wheel->expected_cdeg == wheel->leg.to_cdeg;
}

/* Pulse for a wheel angle, in half microseconds; not yet limited to the servo's range. */
static int32_t pulse_half_us(const struct wheel *wheel, int16_t angle_cdeg)
{
	int32_t servo_cdeg = (int32_t)angle_cdeg + wheel->offset_cdeg;
	int32_t half_us = servo_cdeg * value(wheel, PARAM_SERVO_GAIN_NS_DEG) / 50000;

	return 2 * (int32_t)value(wheel, PARAM_SERVO_ZERO_US) + half_us;
}

static bool within_servo(const struct wheel *wheel, int32_t half_us)
{
	return half_us >= 2 * (int32_t)value(wheel, PARAM_SERVO_MIN_US) &&
	       half_us <= 2 * (int32_t)value(wheel, PARAM_SERVO_MAX_US);
}

static bool reachable(const struct wheel *wheel, int16_t angle_cdeg)
{
	return within_servo(wheel, pulse_half_us(wheel, angle_cdeg));
}

uint16_t wheel_pulse_half_us(const struct wheel *wheel)
{
	if (!wheel->servo_on)
		return 0;
	if (wheel->step == STEP_PULSE)
		return wheel->host_half_us;
	int32_t half_us = pulse_half_us(wheel, leg_at(&wheel->leg, wheel->now_ms));
	int32_t least = 2 * (int32_t)value(wheel, PARAM_SERVO_MIN_US);
	int32_t most = 2 * (int32_t)value(wheel, PARAM_SERVO_MAX_US);

	return half_us < least ? least : half_us > most ? most : half_us;
}

static void drive(const struct wheel *wheel)
{
	if (wheel->servo_on)
		board_servo(wheel_pulse_half_us(wheel));
}

static void start_leg(struct wheel *wheel, int16_t from_cdeg, int16_t to_cdeg, uint16_t slew_ddeg_s)
{
	wheel->leg.from_cdeg = from_cdeg;
	wheel->leg.to_cdeg = to_cdeg;
	wheel->leg.slew_ddeg_s = slew_ddeg_s;
	wheel->leg.t0_ms = wheel->now_ms;
	wheel->leg.way = to_cdeg < from_cdeg ? -1 : 1;
	wheel->farthest = wheel->below;
	wheel->went_back = false;
	wheel->misfit = false;
	wheel->proofs = 0;
	wheel->t_step_ms = wheel->now_ms;
	expect(wheel);
}

/* --- phases --------------------------------------------------------------------------------- */

static void enter(struct wheel *wheel, enum wheel_phase phase, enum wheel_step step)
{
	wheel->step = step;
	wheel->t_step_ms = wheel->now_ms;
	if (wheel->phase == phase)
		return;
	wheel->phase = phase;
	wheel->age_ms = 0;
	wheel->t_phase_us = board_time_us();
	wheel->changed = true;
}

static void let_go(struct wheel *wheel)
{
	wheel->servo_on = false;
	board_servo(0);
}

void wheel_fail(struct wheel *wheel, uint8_t fault, int16_t detail)
{
	safe_latch(wheel->safe, fault, detail);
	let_go(wheel);
	enter(wheel, WHEEL_FAULT, STEP_REST);
}

void wheel_init(struct wheel *wheel, const struct params *params, struct safe *safe)
{
	wheel->params = params;
	wheel->safe = safe;
	wheel->changed = true;
	let_go(wheel);
}

void wheel_forget(struct wheel *wheel)
{
	let_go(wheel);
	enter(wheel, WHEEL_UNKNOWN, STEP_REST);
}

void wheel_release(struct wheel *wheel)
{
	let_go(wheel);
	if (wheel->phase != WHEEL_SETTLED && wheel->phase != WHEEL_FAULT)
		enter(wheel, WHEEL_UNKNOWN, STEP_REST);
}

enum wheel_answer wheel_pulse(struct wheel *wheel, uint16_t half_us)
{
	if (wheel->phase == WHEEL_FAULT)
		return ANSWER_IN_FAULT;
	if (wheel->phase == WHEEL_HOMING || wheel->phase == WHEEL_MOVING)
		return ANSWER_BUSY;
	if (!within_servo(wheel, half_us))
		return ANSWER_OUT_OF_RANGE;
	enter(wheel, WHEEL_UNKNOWN, STEP_PULSE);
	wheel->host_half_us = half_us;
	wheel->servo_on = true;
	return ANSWER_OK;
}

static void hold_pulse(struct wheel *wheel)
{
	uint16_t held_ms = wheel->now_ms - wheel->t_step_ms;

	if (held_ms >= (uint16_t)value(wheel, PARAM_HOLD_MAX_DS) * 100)
		wheel_forget(wheel);
}

/* --- homing --------------------------------------------------------------------------------- */

enum wheel_answer wheel_home(struct wheel *wheel, uint8_t token)
{
	int16_t low_cdeg = comb_edge_cdeg(wheel, 0) - BELOW_COMB_CDEG;

	if (wheel->phase == WHEEL_FAULT)
		return ANSWER_IN_FAULT;
	if (wheel->phase == WHEEL_HOMING && token == wheel->token)
		return ANSWER_OK; /* repeated: the host has not seen our answer */
	wheel->token = token;
	wheel->offset_cdeg = 0;
	wheel->target_cdeg = value(wheel, PARAM_WHEEL_MIN_CDEG);
	if (wheel->target_cdeg < 0 && value(wheel, PARAM_WHEEL_MAX_CDEG) >= 0)
		wheel->target_cdeg = 0;
	wheel->slew_ddeg_s = value(wheel, PARAM_SLEW_MAX_DDEG_S);
	wheel->hold_ds = value(wheel, PARAM_HOLD_MAX_DS);
	start_leg(wheel, low_cdeg, low_cdeg, wheel->slew_ddeg_s);
	wheel->servo_on = true;
	enter(wheel, WHEEL_HOMING, STEP_SEEK);
	wheel->changed = true;
	return ANSWER_OK;
}

static void seek(struct wheel *wheel)
{
	uint16_t longest_ms = (uint32_t)TRAVEL_CDEG * 100 / wheel->slew_ddeg_s + SEEK_MARGIN_MS;

	if ((uint16_t)(wheel->now_ms - wheel->t_step_ms) < longest_ms)
		return;
	enter(wheel, WHEEL_HOMING, STEP_SWEEP);
	evidence_start(wheel);
	start_leg(wheel, wheel->leg.to_cdeg,
		  comb_edge_cdeg(wheel, WHEEL_HOME_EDGES - 1) + value(wheel, PARAM_TOLERANCE_CDEG),
		  value(wheel, PARAM_CREEP_DDEG_S));
}

/* The sweep has ended without the edges it looked for. */
static void homing_failed(struct wheel *wheel)
{
	struct board_index index;
	int16_t moved_cdeg = wheel->feedback_cdeg - wheel->seek_feedback_cdeg;

	board_index(&index);
	if (wheel->feedback_known && moved_cdeg < BELOW_COMB_CDEG / 2)
		wheel_fail(wheel, FAULT_WHEEL_STUCK, moved_cdeg);
	else if (index.count != wheel->count_zero)
		wheel_fail(wheel, FAULT_INDEX_PATTERN, wheel->below);
	else if (index.levels)
		wheel_fail(wheel, FAULT_INDEX_ALWAYS, index.levels);
	else
		wheel_fail(wheel, FAULT_INDEX_NEVER, 0);
}

static void start_approach(struct wheel *wheel, int16_t from_cdeg);

/* The first edges have come: is it the comb, and where it should be? */
static void home_found(struct wheel *wheel)
{
	int16_t limit_cdeg = value(wheel, PARAM_TOLERANCE_CDEG);
	int16_t pitch_cdeg = value(wheel, PARAM_COMB_PITCH_CDEG);
	int32_t sum_cdeg = 0;

	for (uint8_t i = 0; i < WHEEL_HOME_EDGES; i++) {
		sum_cdeg += wheel->home_cdeg[i] - comb_edge_cdeg(wheel, i);
		int16_t apart_cdeg = i ? wheel->home_cdeg[i] - wheel->home_cdeg[i - 1] : pitch_cdeg;
		if (apart_cdeg > pitch_cdeg + HOME_ERROR_CDEG ||
		    apart_cdeg < pitch_cdeg - HOME_ERROR_CDEG) {
			wheel_fail(wheel, FAULT_INDEX_PATTERN, i);
			return;
		}
	}
	wheel->offset_cdeg = wheel->home_offset_cdeg = sum_cdeg / WHEEL_HOME_EDGES;
	if (wheel->offset_cdeg > limit_cdeg || wheel->offset_cdeg < -limit_cdeg) {
		wheel_fail(wheel, FAULT_INDEX_PATTERN, wheel->offset_cdeg);
		return;
	}
	start_approach(wheel, leg_at(&wheel->leg, wheel->now_ms) - wheel->offset_cdeg);
}

static void home_edge(struct wheel *wheel, int16_t before)
{
	if (wheel->below != before + 1 || before < 0) {
		wheel_fail(wheel, FAULT_INDEX_PATTERN, wheel->below);
		return;
	}
	wheel->home_cdeg[before] = wheel->expected_cdeg;
	if (wheel->below == WHEEL_HOME_EDGES)
		home_found(wheel);
}

/* --- moving --------------------------------------------------------------------------------- */

static void start_approach(struct wheel *wheel, int16_t from_cdeg)
{
	start_leg(wheel, from_cdeg, wheel->target_cdeg - value(wheel, PARAM_APPROACH_CDEG),
		  wheel->slew_ddeg_s);
	if (!wheel->servo_on)
		wheel->leg.t0_ms += WAKE_MS;
	evidence_forget_speed(wheel, from_cdeg);
	wheel->late = false;
	wheel->behinds = 0;
	wheel->doubts = 0;
	wheel->servo_on = true;
	enter(wheel, WHEEL_MOVING, STEP_TRAVEL);
	wheel->changed = true;
}

/* Whether the clock can hold the longest leg of a move: the travel, or the creep with what it may
 * have to go further. */
static bool fast_enough(const struct wheel *wheel, int16_t target_cdeg, uint16_t slew_ddeg_s)
{
	int32_t approach_cdeg = value(wheel, PARAM_APPROACH_CDEG);
	int32_t longest_cdeg = approach_cdeg + value(wheel, PARAM_TOLERANCE_CDEG) +
			       value(wheel, PARAM_COMB_PITCH_CDEG);
	int32_t travel_cdeg = target_cdeg - approach_cdeg - wheel->leg.to_cdeg;

	if (travel_cdeg < 0)
		travel_cdeg = -travel_cdeg;
	if (travel_cdeg > longest_cdeg)
		longest_cdeg = travel_cdeg;
	return longest_cdeg * 100 <= (int32_t)LEG_MOST_MS * slew_ddeg_s;
}

static bool move_allowed(const struct wheel *wheel, int16_t target_cdeg, uint16_t slew_ddeg_s,
			 uint16_t hold_ds)
{
	int16_t edges = comb_required(wheel, target_cdeg);

	return target_cdeg >= value(wheel, PARAM_WHEEL_MIN_CDEG) &&
	       target_cdeg <= value(wheel, PARAM_WHEEL_MAX_CDEG) && reachable(wheel, target_cdeg) &&
	       edges >= PROOFS && edges <= value(wheel, PARAM_COMB_EDGES) &&
	       slew_ddeg_s <= (uint16_t)value(wheel, PARAM_SLEW_MAX_DDEG_S) &&
	       hold_ds <= (uint16_t)value(wheel, PARAM_HOLD_MAX_DS) &&
	       fast_enough(wheel, target_cdeg, slew_ddeg_s);
}

/* The same move again: the host has not seen our answer. */
static bool repeated(const struct wheel *wheel, uint8_t token, int16_t target_cdeg)
{
	return token == wheel->token && target_cdeg == wheel->target_cdeg &&
	       (wheel->phase == WHEEL_MOVING || wheel->phase == WHEEL_SETTLED);
}

enum wheel_answer wheel_move(struct wheel *wheel, uint8_t token, int16_t target_cdeg,
			     uint16_t slew_ddeg_s, uint16_t hold_ds)
{
	if (!slew_ddeg_s)
		slew_ddeg_s = value(wheel, PARAM_SLEW_MAX_DDEG_S);
	if (!hold_ds)
		hold_ds = value(wheel, PARAM_HOLD_MAX_DS);
	if (repeated(wheel, token, target_cdeg))
		return ANSWER_OK;
	if (wheel->phase == WHEEL_FAULT)
		return ANSWER_IN_FAULT;
	if (wheel->phase == WHEEL_UNKNOWN)
		return ANSWER_NOT_HOMED;
	if (wheel->phase != WHEEL_SETTLED)
		return ANSWER_BUSY;
	if (!move_allowed(wheel, target_cdeg, slew_ddeg_s, hold_ds))
		return ANSWER_OUT_OF_RANGE;
	wheel->token = token;
	wheel->slew_ddeg_s = slew_ddeg_s;
	wheel->hold_ds = hold_ds;
	wheel->target_cdeg = target_cdeg;
	start_approach(wheel, wheel->leg.to_cdeg);
	return ANSWER_OK;
}

/* The wheel is below all edges that must prove its arrival, or has passed them. */
static bool proven(const struct wheel *wheel)
{
	return wheel->below >= comb_required(wheel, wheel->target_cdeg) &&
	       wheel->proofs >= PROOFS && !wheel->misfit;
}

/* While creeping, an edge tells where the wheel really is: the rest of the leg is counted from
 * there. The command itself does not jump: what the angle loses, the offset gains. The first edge
 * may be off by what the servo is crooked, the next ones hardly. */
static void correct(struct wheel *wheel)
{
	int16_t error_cdeg = wheel->expected_cdeg - comb_edge_cdeg(wheel, wheel->below - 1);
	int16_t drift_cdeg = wheel->offset_cdeg + error_cdeg - wheel->home_offset_cdeg;
	int16_t limit_cdeg = value(wheel, PARAM_TOLERANCE_CDEG);

	wheel->misfit = drift_cdeg > limit_cdeg || drift_cdeg < -limit_cdeg ||
			(wheel->proofs && (error_cdeg > PROOF_CDEG || error_cdeg < -PROOF_CDEG));
	if (wheel->misfit)
		return;
	wheel->proofs++;
	wheel->offset_cdeg += error_cdeg;
	wheel->leg.from_cdeg -= error_cdeg;
	if (proven(wheel))
		wheel->leg.to_cdeg = wheel->target_cdeg;
	expect(wheel);
}

void wheel_on_edge(struct wheel *wheel, int16_t before)
{
	wheel->t_edge_ms = wheel->now_ms;
	if (wheel->step == STEP_SWEEP)
		home_edge(wheel, before);
	else if (wheel->step != STEP_CREEP)
		return;
	else if (wheel->below == before + 1)
		correct(wheel);
	else
		wheel->misfit = false; /* it was a disturbance and has gone */
}

/* Until the edges below the target have come, the creep goes on beyond it: the servo may be
 * crooked. */
static void start_creep(struct wheel *wheel)
{
	uint16_t creep = value(wheel, PARAM_CREEP_DDEG_S);

	enter(wheel, WHEEL_MOVING, STEP_CREEP);
	start_leg(wheel, wheel->leg.to_cdeg,
		  wheel->target_cdeg + value(wheel, PARAM_TOLERANCE_CDEG),
		  wheel->slew_ddeg_s < creep ? wheel->slew_ddeg_s : creep);
}

static void move_on(struct wheel *wheel)
{
	evidence_watch_leg(wheel);
	if (wheel->phase != WHEEL_MOVING || !wheel_arrived(wheel) || wheel->late)
		return;
	if (wheel->step == STEP_CREEP) {
		if (proven(wheel))
			enter(wheel, WHEEL_MOVING, STEP_SETTLE);
	} else if ((uint16_t)(wheel->now_ms - wheel->t_edge_ms) < QUIET_MS) {
		return; /* a slow wheel is still on its way */
	} else if (wheel->below + PROOFS <= comb_required(wheel, wheel->target_cdeg)) {
		start_creep(wheel);
	} else { /* the servo is so crooked that the proofs lie below: further down */
		start_leg(wheel, wheel->leg.to_cdeg,
			  wheel->leg.to_cdeg - value(wheel, PARAM_COMB_PITCH_CDEG),
			  wheel->slew_ddeg_s);
	}
}

static void settle(struct wheel *wheel)
{
	evidence_watch_rest(wheel);
	if (wheel->phase == WHEEL_MOVING && wheel->doubts == 0 &&
	    (uint16_t)(wheel->now_ms - wheel->t_step_ms) >= (uint16_t)value(wheel, PARAM_SETTLE_MS))
		enter(wheel, WHEEL_SETTLED, STEP_REST);
}

static void hold(struct wheel *wheel)
{
	evidence_watch_rest(wheel);
	if (wheel->servo_on && wheel->age_ms >= wheel->hold_ds * 100)
		wheel_release(wheel);
}

void wheel_tick(struct wheel *wheel, uint8_t elapsed_ms)
{
	uint16_t age_left_ms = UINT16_MAX - wheel->age_ms;

	wheel->now_ms += elapsed_ms;
	wheel->age_ms += elapsed_ms < age_left_ms ? elapsed_ms : age_left_ms;
	expect(wheel);
	if (wheel_arrived(wheel)) /* for good, though the clock wraps round */
		wheel->leg.from_cdeg = wheel->leg.to_cdeg;
	if (safe_wheel_stopped(wheel->safe) && wheel->phase != WHEEL_FAULT) {
		let_go(wheel);
		enter(wheel, WHEEL_FAULT, STEP_REST);
	}
	evidence_poll(wheel, elapsed_ms);
	if (wheel->step == STEP_SEEK) {
		seek(wheel);
	} else if (wheel->step == STEP_SWEEP) {
		if (wheel_arrived(wheel))
			homing_failed(wheel);
	} else if (wheel->step == STEP_TRAVEL || wheel->step == STEP_CREEP) {
		move_on(wheel);
	} else if (wheel->step == STEP_SETTLE) {
		settle(wheel);
	} else if (wheel->step == STEP_PULSE) {
		hold_pulse(wheel);
	} else if (wheel->phase == WHEEL_SETTLED) {
		hold(wheel);
	}
	drive(wheel);
}

/* --- report --------------------------------------------------------------------------------- */

void wheel_report(const struct wheel *wheel, struct wheel_report *report)
{
	bool known = wheel->phase == WHEEL_SETTLED || wheel->phase == WHEEL_MOVING;
	struct span span;

	report->commanded_cdeg = known ? wheel->target_cdeg : WHEEL_NO_ANGLE;
	report->measured_cdeg = WHEEL_NO_ANGLE;
	report->sigma_cdeg = WHEEL_NO_SIGMA;
	if (!known || wheel->doubts || !evidence_span(wheel, &span))
		return;
	int16_t best_cdeg = wheel->feedback_known ? wheel->feedback_cdeg : wheel->expected_cdeg;
	if (best_cdeg < span.low_cdeg)
		best_cdeg = span.low_cdeg;
	if (best_cdeg > span.high_cdeg)
		best_cdeg = span.high_cdeg;
	int16_t under_cdeg = best_cdeg - span.low_cdeg;
	int16_t over_cdeg = span.high_cdeg - best_cdeg;
	report->measured_cdeg = best_cdeg;
	report->sigma_cdeg = ((under_cdeg > over_cdeg ? under_cdeg : over_cdeg) + 2) / 3;
}
