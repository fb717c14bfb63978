/* SPDX-License-Identifier: Apache-2.0 */
#include "app/box/sweep.h"

#include <math.h>
#include <stddef.h>

#include "base/clock.h"
#include "include/frame.h"
#include "vision/map/radiance_map.h" /* LP_SAME_EXPOSURE */

#define ANSWER_NS (100 * LP_NS_PER_MS) /* a frame waits no longer for its angle */
#define SAME_DEG 0.02F

static bool turning(const struct lp_sweep *sweep)
{
	const enum lp_wheel_phase phase = sweep->report->state.phase;

	return phase == LP_WHEEL_MOVING || phase == LP_WHEEL_HOMING;
}

bool lp_sweep_lost(const struct lp_sweep *sweep)
{
	return sweep->is_lost ||
	       (sweep->report->state.phase != LP_WHEEL_SETTLED && !turning(sweep));
}

/* A wheel that failed turns while it tries again. It is lost until it has settled. */
static bool still_lost(const struct lp_sweep *sweep)
{
	const enum lp_wheel_phase phase = sweep->report->state.phase;

	return phase == LP_WHEEL_FAULT || phase == LP_WHEEL_ABSENT ||
	       (sweep->is_lost && phase != LP_WHEEL_SETTLED);
}

/* ---------------------------------------------------------------- exposures */

static bool alike(float one_us, float other_us)
{
	return one_us < LP_SAME_EXPOSURE * other_us && other_us < LP_SAME_EXPOSURE * one_us;
}

static bool has(const struct lp_sweep_exposures *seen, float exposure_us)
{
	bool found = false;

	for (int k = 0; k < seen->count; k++)
		found |= alike(exposure_us, seen->us[k]);
	return found;
}

static bool has_all(const struct lp_sweep_exposures *seen, const struct lp_sweep_exposures *before)
{
	bool all = before->is_whole;

	for (int k = 0; k < before->count; k++)
		all &= has(seen, before->us[k]);
	return all;
}

/* A frame at this angle had this exposure; NAN: it does not tell. */
static void note_exposure(struct lp_sweep *sweep, float exposure_us)
{
	struct lp_sweep_exposures *seen = &sweep->exposures;

	if (isnan(exposure_us) || (seen->count && alike(exposure_us, seen->last_us)))
		return;
	seen->last_us = exposure_us;
	if (has(seen, exposure_us))
		seen->is_whole = true;
	else if (seen->count < LP_SWEEP_EXPOSURES)
		seen->us[seen->count++] = exposure_us;
	seen->is_whole |= has_all(seen, &sweep->before);
}

/* ---------------------------------------------------------------- frames */

static void pass(struct lp_sweep *sweep, struct lp_frame *frame, float wheel_deg, float sigma_deg)
{
	frame->wheel_deg = wheel_deg;
	frame->wheel_sigma_deg = sigma_deg;
	if (isnan(wheel_deg))
		sweep->report->frames_unknown++;
	else
		sweep->report->frames_stamped++;
	sweep->host.frame(sweep->host.context, frame);
}

static void leave_out(struct lp_sweep *sweep, struct lp_frame *frame)
{
	if (sweep->pass_turning) {
		pass(sweep, frame, NAN, NAN);
		return;
	}
	sweep->report->frames_moving++;
	lp_frame_release(frame);
}

static struct lp_frame *take_held(struct lp_sweep *sweep)
{
	struct lp_frame *frame = sweep->held;

	sweep->held = NULL;
	return frame;
}

/* The end of the last row's exposure, or later. */
static int64_t end_ns(const struct lp_frame *frame)
{
	const double rows_us = (double)frame->row_time_us * frame->height_px;

	return isnan(rows_us) || frame->clock_fault ? frame->t_arrival_ns
						    : frame->t_read_ns + (int64_t)(1e3 * rows_us);
}

/* No answer came, or none that says anything: without an angle, unless it was turning. */
static void give_up(struct lp_sweep *sweep)
{
	struct lp_frame *frame = take_held(sweep);

	if (!frame)
		return;
	if (turning(sweep))
		leave_out(sweep, frame);
	else
		pass(sweep, frame, NAN, NAN);
}

static void judge(struct lp_sweep *sweep)
{
	const struct lp_wheel_state *state = &sweep->report->state;
	struct lp_frame *frame = sweep->held;

	if (!frame)
		return;
	if (lp_sweep_lost(sweep) || turning(sweep)) {
		give_up(sweep);
		return;
	}
	if (state->t_seen_ns < end_ns(frame))
		return;
	frame = take_held(sweep);
	if (state->t_phase_ns > lp_frame_start_ns(frame))
		leave_out(sweep, frame);
	else if (isnan(state->sigma_deg))
		pass(sweep, frame, NAN, NAN);
	else {
		if (sweep->t_arrived_ns)
			note_exposure(sweep, lp_frame_exposure_us(frame));
		pass(sweep, frame, state->measured_deg, state->sigma_deg);
	}
}

void lp_sweep_frame(struct lp_sweep *sweep, struct lp_frame *frame, int64_t now_ns)
{
	give_up(sweep); /* the one before */
	if (frame->flags & LP_FRAME_LAST) {
		pass(sweep, frame, NAN, NAN);
	} else if (turning(sweep)) {
		leave_out(sweep, frame);
	} else if (lp_sweep_lost(sweep)) {
		pass(sweep, frame, NAN, NAN);
	} else {
		sweep->held = frame;
		sweep->t_held_ns = now_ns;
		sweep->host.look(sweep->host.context);
	}
}

/* ---------------------------------------------------------------- angles */

static bool arrived(const struct lp_sweep *sweep)
{
	const struct lp_wheel_state *state = &sweep->report->state;

	return state->phase == LP_WHEEL_SETTLED &&
	       fabsf(state->commanded_deg - sweep->angles_deg[sweep->at]) < SAME_DEG;
}

static bool rests(const struct lp_sweep *sweep, int64_t now_ns)
{
	return !sweep->is_under_way && sweep->t_rest_ns && !sweep->wanted &&
	       now_ns - sweep->t_rest_ns < sweep->rest_ns;
}

static void arrive(struct lp_sweep *sweep, int64_t now_ns)
{
	sweep->t_arrived_ns = now_ns;
	sweep->before = sweep->exposures;
	sweep->exposures = (struct lp_sweep_exposures){0};
	sweep->report->moves++;
}

/* A sweep to and fro is over when all has been seen at its last angle; round the angles, when the
 * wheel leaves that: the first one follows. */
static void end_sweep(struct lp_sweep *sweep, int64_t now_ns)
{
	sweep->is_under_way = false;
	sweep->backwards = sweep->to_and_fro && sweep->at > 0;
	sweep->t_rest_ns = now_ns;
	sweep->report->sweeps++;
}

static void leave(struct lp_sweep *sweep, int64_t now_ns)
{
	const int last = sweep->angle_count - 1;

	if (!sweep->is_under_way)
		sweep->wanted = false;
	sweep->is_under_way = true;
	if (!sweep->to_and_fro && sweep->at == last)
		end_sweep(sweep, now_ns);
	sweep->at = sweep->backwards ? sweep->at - 1 : (sweep->at + 1) % sweep->angle_count;
	sweep->t_arrived_ns = 0;
	sweep->host.move(sweep->host.context, sweep->angles_deg[sweep->at]);
}

static void go_on(struct lp_sweep *sweep, int64_t now_ns)
{
	if (!arrived(sweep)) {
		sweep->t_arrived_ns = 0;
		return;
	}
	if (sweep->t_arrived_ns == 0)
		arrive(sweep, now_ns);
	const bool is_done = now_ns - sweep->t_arrived_ns >= sweep->dwell_ns ||
			     (sweep->by_exposures && sweep->exposures.is_whole);
	const int end = sweep->backwards ? 0 : sweep->angle_count - 1;

	if (sweep->angle_count < 2 || !is_done)
		return;
	if (sweep->to_and_fro && sweep->is_under_way && sweep->at == end)
		end_sweep(sweep, now_ns);
	if (!rests(sweep, now_ns))
		leave(sweep, now_ns);
}

void lp_sweep_want(struct lp_sweep *sweep)
{
	sweep->wanted = true;
}

uint64_t lp_sweep_request(struct lp_sweep *sweep)
{
	lp_sweep_want(sweep);
	/* The sweep on its way has begun before. */
	return sweep->report->sweeps + (sweep->is_under_way ? 2 : 1);
}

void lp_sweep_start(struct lp_sweep *sweep)
{
	sweep->host.move(sweep->host.context, sweep->angles_deg[0]);
}

void lp_sweep_state(struct lp_sweep *sweep, const struct lp_wheel_state *state, int64_t now_ns)
{
	sweep->report->state = *state;
	sweep->is_lost = still_lost(sweep);
	judge(sweep);
	go_on(sweep, now_ns);
}

void lp_sweep_tick(struct lp_sweep *sweep, int64_t now_ns)
{
	if (sweep->held && now_ns - sweep->t_held_ns > ANSWER_NS)
		give_up(sweep);
	go_on(sweep, now_ns);
}

void lp_sweep_finish(struct lp_sweep *sweep)
{
	lp_frame_release(take_held(sweep));
}
