/* SPDX-License-Identifier: Apache-2.0 */
/* What the microcontroller reports: its clock, the wheel, the ring and its faults, in our units. */
#include <math.h>
#include <stdio.h>

#include "base/log.h"
#include "base/macros.h"
#include "drivers/link/mcu_parts.h"

#define UNKNOWN_CDEG INT16_MIN

int lp_link_length(uint8_t id)
{
#define ROW(NAME)             \
	case LP_MCU_ID(NAME): \
		return MCU_##NAME##_LENGTH
	switch (id) {
		ROW(FAULT);
		ROW(WHEEL_STATE);
		ROW(WHEEL_TIME);
		ROW(RESULT);
		ROW(TIME_REPLY);
		ROW(HELLO);
		ROW(CAPABILITIES);
		ROW(FAULT_STATE);
		ROW(PARAM_VALUE);
		ROW(WHEEL_SERVO);
		ROW(RING0);
		ROW(RING1);
		ROW(RING2);
		ROW(COUNTERS_LINK);
		ROW(COUNTERS_WORK);
		ROW(WHEEL_REPLY);
	default:
		return -1;
	}
#undef ROW
}

/* The answer to request `count` has come. When that was sent; 0: it has been answered before. */
static int64_t answered(struct lp_mcu *mcu, int count)
{
	const int64_t sent_ns = mcu->time_sent_ns[count];

	mcu->time_sent_ns[count] = 0;
	if (sent_ns)
		mcu->t_seen_ns = sent_ns;
	return sent_ns;
}

static void on_time(struct lp_mcu *mcu, const uint8_t *payload, int64_t t_ns)
{
	struct mcu_time_reply_t reply;
	int64_t sent_ns;

	mcu_time_reply_unpack(&reply, payload, LP_LINK_MAX_BYTES);
	sent_ns = answered(mcu, reply.count);
	if (sent_ns && reply.stamped)
		(void)lp_link_clock_add(&mcu->clock, sent_ns, t_ns, reply.t_rx_us,
					reply.turnaround_us);
}

/* By when the phase had been entered, for certain: 3 sigma of the clock, at most now. */
static void note_phase(struct lp_mcu *mcu, const struct mcu_wheel_time_t *time, int64_t t_ns)
{
	int64_t entered_ns, sigma_ns;

	if (mcu->phase_known && mcu->phase.phase == time->phase &&
	    mcu->phase.token == time->token && mcu->phase.t_phase_us == time->t_phase_us)
		return;
	mcu->phase = *time;
	mcu->phase_known = true;
	mcu->t_phase_ns = t_ns;
	if (time->age_ms < UINT16_MAX &&
	    lp_link_clock_at(&mcu->clock, time->t_phase_us, &entered_ns, &sigma_ns) &&
	    entered_ns + 3 * sigma_ns < t_ns)
		mcu->t_phase_ns = entered_ns + 3 * sigma_ns;
}

static float degrees(int cdeg, int unknown)
{
	return cdeg == unknown ? NAN : (float)cdeg / 100.0F;
}

static float clock_sigma_us(const struct lp_mcu *mcu, uint32_t device_us)
{
	int64_t host_ns, sigma_ns;

	return lp_link_clock_at(&mcu->clock, device_us, &host_ns, &sigma_ns)
		       ? (float)sigma_ns / 1000.0F
		       : NAN;
}

static const enum lp_wheel_phase phases[] = {
	[MCU_WHEEL_STATE_PHASE_UNKNOWN_CHOICE] = LP_WHEEL_UNKNOWN,
	[MCU_WHEEL_STATE_PHASE_HOMING_CHOICE] = LP_WHEEL_HOMING,
	[MCU_WHEEL_STATE_PHASE_MOVING_CHOICE] = LP_WHEEL_MOVING,
	[MCU_WHEEL_STATE_PHASE_SETTLED_CHOICE] = LP_WHEEL_SETTLED,
	[MCU_WHEEL_STATE_PHASE_FAULT_CHOICE] = LP_WHEEL_FAULT,
};

/* The wheel as the newest WheelState and the WheelTime that belongs to it say. */
static void report_wheel(struct lp_mcu *mcu, uint32_t t_phase_us)
{
	const struct mcu_wheel_state_t *state = &mcu->wheel;
	const struct lp_mcu_wheel wheel = {
		.token = state->token,
		.state = {.phase = phases[state->phase],
			  .commanded_deg = degrees(state->commanded_cdeg, UNKNOWN_CDEG),
			  .measured_deg = degrees(state->measured_cdeg, UNKNOWN_CDEG),
			  .sigma_deg = degrees(state->sigma_cdeg, UINT16_MAX),
			  .t_phase_ns = mcu->t_phase_ns,
			  .t_seen_ns = mcu->t_seen_ns,
			  .clock_sigma_us = clock_sigma_us(mcu, t_phase_us),
			  .reconnects = mcu->reconnects}};

	if (wheel.state.phase == LP_WHEEL_SETTLED)
		lp_mcu_wheel_settled(mcu);
	for (struct lp_mcu_user *user = mcu->users; user; user = user->next) {
		if (user->wheel)
			user->wheel(user, &wheel);
	}
}

/* WheelTime follows the WheelState of the same counter. */
static void on_wheel_time(struct lp_mcu *mcu, const uint8_t *payload, int64_t t_ns)
{
	const struct mcu_wheel_state_t *state = &mcu->wheel;
	struct mcu_wheel_time_t time;

	mcu_wheel_time_unpack(&time, payload, LP_LINK_MAX_BYTES);
	if (!mcu->wheel_waits || time.counter != state->counter || time.phase != state->phase ||
	    time.token != state->token || state->phase >= LP_COUNT(phases))
		return;
	mcu->wheel_waits = false;
	note_phase(mcu, &time, t_ns);
	report_wheel(mcu, time.t_phase_us);
}

/* The phase and when it began are told by WheelState and WheelTime, which come at every change. */
static void on_wheel_reply(struct lp_mcu *mcu, const uint8_t *payload)
{
	struct mcu_wheel_reply_t reply;

	mcu_wheel_reply_unpack(&reply, payload, LP_LINK_MAX_BYTES);
	if (answered(mcu, reply.count) == 0 || !mcu->phase_known || mcu->wheel_waits ||
	    reply.phase != mcu->phase.phase || reply.token != mcu->phase.token)
		return;
	mcu->wheel.servo_on = reply.servo_on;
	mcu->wheel.measured_cdeg = reply.measured_cdeg;
	mcu->wheel.sigma_cdeg = reply.sigma_cdeg;
	report_wheel(mcu, mcu->phase.t_phase_us);
}

static void on_ring2(struct lp_mcu *mcu, const uint8_t *payload, int64_t t_ns)
{
	const struct mcu_ring0_t *a = &mcu->ring0;
	const struct mcu_ring1_t *b = &mcu->ring1;
	struct mcu_ring2_t c;
	int64_t sigma_ns;

	mcu_ring2_unpack(&c, payload, LP_LINK_MAX_BYTES);
	if (a->counter != c.counter || b->counter != c.counter)
		return;
	mcu->ring_sequence += mcu->ring_known ? (uint8_t)(c.counter - mcu->ring_sequence)
					      : c.counter - mcu->ring_sequence;
	mcu->ring_known = true;
	struct lp_mcu_ring ring = {.sequence = mcu->ring_sequence,
				   .t_ns = t_ns,
				   .levels = {a->level_0, a->level_1, b->level_2, b->level_3,
					      b->level_4, b->level_5, c.level_6, c.level_7,
					      c.level_8},
				   .dead = c.dead};

	(void)lp_link_clock_at(&mcu->clock, a->t_us, &ring.t_ns, &sigma_ns);
	for (struct lp_mcu_user *user = mcu->users; user; user = user->next) {
		if (user->ring)
			user->ring(user, &ring);
	}
}

static void on_fault(struct lp_mcu *mcu, const uint8_t *payload)
{
	const uint32_t latched = mcu->recovery.faults;
	struct mcu_fault_t fault;
	uint32_t bit;

	mcu_fault_unpack(&fault, payload, LP_LINK_MAX_BYTES);
	bit = UINT32_C(1) << fault.fault;
	lp_mcu_set_faults(mcu, fault.active ? latched | bit : latched & ~bit, fault.detail);
}

static void on_fault_state(struct lp_mcu *mcu, const uint8_t *payload)
{
	struct mcu_fault_state_t state;

	mcu_fault_state_unpack(&state, payload, LP_LINK_MAX_BYTES);
	lp_mcu_set_faults(mcu, state.latched, 0);
}

void lp_mcu_report(struct lp_mcu *mcu, const struct lp_link_message *message, int64_t t_ns)
{
	const uint8_t *payload = message->payload;

	switch (message->id) {
	case LP_MCU_ID(TIME_REPLY):
		on_time(mcu, payload, t_ns);
		break;
	case LP_MCU_ID(WHEEL_STATE):
		mcu_wheel_state_unpack(&mcu->wheel, payload, LP_LINK_MAX_BYTES);
		mcu->wheel_waits = true;
		break;
	case LP_MCU_ID(WHEEL_TIME):
		on_wheel_time(mcu, payload, t_ns);
		break;
	case LP_MCU_ID(WHEEL_REPLY):
		on_wheel_reply(mcu, payload);
		break;
	case LP_MCU_ID(RING0):
		mcu_ring0_unpack(&mcu->ring0, payload, LP_LINK_MAX_BYTES);
		break;
	case LP_MCU_ID(RING1):
		mcu_ring1_unpack(&mcu->ring1, payload, LP_LINK_MAX_BYTES);
		break;
	case LP_MCU_ID(RING2):
		on_ring2(mcu, payload, t_ns);
		break;
	case LP_MCU_ID(FAULT):
		on_fault(mcu, payload);
		break;
	case LP_MCU_ID(FAULT_STATE):
		on_fault_state(mcu, payload);
		break;
	default:
		break;
	}
}
