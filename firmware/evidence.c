/* SPDX-License-Identifier: Apache-2.0 */
#include "evidence.h"

#include "board/board.h"
#include "params.h"
#include "ring.h"
#include "safe.h"
#include "wheel.h"

#define GUARD_CDEG 100	 /* an edge this close to the target may lie on either side of it */
#define MISMATCHES 5	 /* ticks, levels against count, until it is a fault */
#define NOISE_CHANGES 4	 /* in a millisecond: no wheel turns so fast */
#define BACKWARD_EDGES 2 /* against the leg's way: slipped */
#define DOUBTS 5	 /* ticks: contradictions outlast a disturbance on a sensor's line */
#define SLACK_CDEG 100	 /* at rest, between target and evidence */
#define JUMP_CDEG 100	 /* within the evidence's grain: no speed */
#define OVERDUE_MS 100	 /* at the end of a leg, until the wheel is late */
#define GRACE_MS 500	 /* when late, until it counts as stuck */
#define MOVED_CDEG 100	 /* in that time, to count as moving */
#define RAIL_LEVELS 20	 /* feedback closer to a rail is open or shorted */

static int16_t value(const struct wheel *wheel, enum param which)
{
	return param(wheel->params, which);
}

/* --- comb ----------------------------------------------------------------------------------- */

int16_t comb_edge_cdeg(const struct wheel *wheel, int16_t edge)
{
	if (edge < 0)
		return WHEEL_LOWEST_CDEG;
	int32_t angle_cdeg = value(wheel, PARAM_COMB_FIRST_CDEG) +
			     (int32_t)edge * value(wheel, PARAM_COMB_PITCH_CDEG);
	if (edge >= value(wheel, PARAM_COMB_EDGES) || angle_cdeg > WHEEL_HIGHEST_CDEG)
		return WHEEL_HIGHEST_CDEG;
	return angle_cdeg;
}

int16_t comb_required(const struct wheel *wheel, int16_t target_cdeg)
{
	int16_t above_first_cdeg = target_cdeg - GUARD_CDEG - value(wheel, PARAM_COMB_FIRST_CDEG);

	return above_first_cdeg < 0 ? 0
				    : above_first_cdeg / value(wheel, PARAM_COMB_PITCH_CDEG) + 1;
}

/* Upwards the sensors go 00, 01, 11, 10. */
static uint8_t levels_of(int16_t below)
{
	uint8_t quarter = below & 3;

	return quarter ^ quarter >> 1;
}

void evidence_start(struct wheel *wheel)
{
	struct board_index index;

	board_index(&index);
	wheel->count_zero = index.count;
	wheel->below = 0;
	wheel->errors = index.errors;
	wheel->changes = index.changes;
	wheel->mismatches = 0;
	wheel->seek_feedback_cdeg = wheel->feedback_cdeg;
}

/* --- where the wheel is --------------------------------------------------------------------- */

static void comb_span(const struct wheel *wheel, struct span *span)
{
	int16_t error_cdeg = value(wheel, PARAM_COMB_ERROR_CDEG);

	span->low_cdeg = comb_edge_cdeg(wheel, wheel->below - 1) - error_cdeg;
	span->high_cdeg = comb_edge_cdeg(wheel, wheel->below) + error_cdeg;
}

bool evidence_span(const struct wheel *wheel, struct span *span)
{
	int16_t error_cdeg = value(wheel, PARAM_FEEDBACK_ERROR_CDEG);

	comb_span(wheel, span);
	/* While the wheel travels the feedback is too old for this. */
	if (!wheel->feedback_known || wheel->step == STEP_TRAVEL)
		return true;
	/* Not the overlap of both: that is narrow just when one of them is wrong. */
	int16_t low_cdeg = wheel->feedback_cdeg - error_cdeg;
	int16_t high_cdeg = wheel->feedback_cdeg + error_cdeg;
	if (high_cdeg < span->low_cdeg || low_cdeg > span->high_cdeg)
		return false;
	span->low_cdeg = low_cdeg;
	span->high_cdeg = high_cdeg;
	return true;
}

/* One angle for a span; beyond the comb's ends its known end. */
static int16_t middle(const struct span *span)
{
	if (span->low_cdeg <= WHEEL_LOWEST_CDEG)
		return span->high_cdeg;
	if (span->high_cdeg >= WHEEL_HIGHEST_CDEG)
		return span->low_cdeg;
	return span->low_cdeg + (span->high_cdeg - span->low_cdeg) / 2;
}

static int16_t size(int16_t difference_cdeg)
{
	return difference_cdeg < 0 ? -difference_cdeg : difference_cdeg;
}

/* How far outside of a span an angle is: below it negative, above it positive, within 0. */
static int16_t outside(const struct span *span, int16_t angle_cdeg)
{
	if (angle_cdeg < span->low_cdeg)
		return angle_cdeg - span->low_cdeg;
	return angle_cdeg > span->high_cdeg ? angle_cdeg - span->high_cdeg : 0;
}

/* --- every tick ----------------------------------------------------------------------------- */

static bool known(const struct wheel *wheel)
{
	return wheel->phase == WHEEL_MOVING || wheel->phase == WHEEL_SETTLED;
}

void evidence_forget_speed(struct wheel *wheel, int16_t angle_cdeg)
{
	for (uint8_t i = 0; i < WHEEL_HISTORY; i++) {
		wheel->history[i].t_ms = wheel->now_ms;
		wheel->history[i].angle_cdeg = angle_cdeg;
	}
}

/* Nothing real turns so fast: the sensors are deceived, or the wheel is. */
static void watch_speed(struct wheel *wheel, const struct span *span)
{
	uint8_t at = wheel->history_at;
	uint16_t elapsed_ms = wheel->now_ms - wheel->history[at].t_ms;
	int32_t reach_cdeg =
		JUMP_CDEG + (int32_t)elapsed_ms * value(wheel, PARAM_SLEW_PHYSICAL_DDEG_S) / 100;
	int16_t gone_cdeg = outside(span, wheel->history[at].angle_cdeg);

	wheel->history[at].t_ms = wheel->now_ms;
	wheel->history[at].angle_cdeg = middle(span);
	wheel->history_at = (at + 1) % WHEEL_HISTORY;
	if (size(gone_cdeg) > reach_cdeg)
		wheel_fail(wheel, FAULT_WHEEL_TOO_FAST, gone_cdeg);
}

/* The comb tells another story than the command. If the feedback, which is the wheel's too,
 * contradicts the comb, the comb's sensors are to blame. */
static void blame(struct wheel *wheel, uint8_t fault, int16_t detail)
{
	bool fast = wheel->step == STEP_TRAVEL && !wheel_arrived(wheel);
	int16_t limit_cdeg = value(wheel, fast ? PARAM_TOLERANCE_CDEG : PARAM_FEEDBACK_ERROR_CDEG);
	struct span comb;

	comb_span(wheel, &comb);
	if (wheel->feedback_known && size(outside(&comb, wheel->feedback_cdeg)) > limit_cdeg)
		fault = wheel->levels == 0   ? FAULT_INDEX_NEVER
			: wheel->levels == 3 ? FAULT_INDEX_ALWAYS
					     : FAULT_INDEX_PATTERN;
	wheel_fail(wheel, fault, detail);
}

/* Whether the sensors' signals can be those of a comb. */
static bool noisy(struct wheel *wheel, const struct board_index *index, uint8_t elapsed_ms)
{
	uint8_t changes = index->changes - wheel->changes;

	wheel->changes = index->changes;
	wheel->levels = index->levels;
	bool match = index->levels == levels_of(wheel->below) || !known(wheel);
	wheel->mismatches = match ? 0 : wheel->mismatches + 1;
	return changes > NOISE_CHANGES * elapsed_ms || index->errors != wheel->errors ||
	       wheel->mismatches > MISMATCHES;
}

void evidence_poll(struct wheel *wheel, uint8_t elapsed_ms)
{
	struct board_index index;
	struct span span;

	board_index(&index);
	int16_t before = wheel->below;
	wheel->below = index.count - wheel->count_zero;
	if (!known(wheel) && wheel->step != STEP_SWEEP)
		return;
	if (noisy(wheel, &index, elapsed_ms)) {
		wheel_fail(wheel, FAULT_INDEX_NOISE, wheel->below);
		return;
	}
	if (wheel->below != before)
		wheel_on_edge(wheel, before);
	if (!known(wheel))
		return;
	evidence_span(wheel, &span);
	watch_speed(wheel, &span);
}

/* A contradiction is believed when it lasts: longer than a disturbance on a line, and than
 * watch_speed() takes. */
static void doubt(struct wheel *wheel, bool contradiction, uint8_t fault, int16_t detail)
{
	wheel->doubts = contradiction ? wheel->doubts + 1 : 0;
	if (wheel->doubts > DOUBTS)
		blame(wheel, fault, detail);
}

void evidence_watch_rest(struct wheel *wheel)
{
	struct span span;
	bool consistent = evidence_span(wheel, &span);
	int16_t off_cdeg = outside(&span, wheel->target_cdeg);
	/* It has never been there: between its last edge and the target it stopped. */
	bool stuck = wheel->step == STEP_SETTLE && off_cdeg > 0 && wheel->below >= wheel->farthest;

	doubt(wheel, !consistent || size(off_cdeg) > SLACK_CDEG,
	      stuck ? FAULT_WHEEL_STUCK : FAULT_WHEEL_SLIP, off_cdeg);
}

void evidence_watch_leg(struct wheel *wheel)
{
	struct span span;

	bool consistent = evidence_span(wheel, &span);
	/* Behind is positive. */
	int16_t behind_cdeg = outside(&span, wheel->expected_cdeg) * wheel->leg.way;
	int16_t tolerance_cdeg = value(wheel, PARAM_TOLERANCE_CDEG);

	if (!wheel_arrived(wheel))
		wheel->t_step_ms = wheel->now_ms;
	bool overdue =
		wheel_arrived(wheel) && (uint16_t)(wheel->now_ms - wheel->t_step_ms) > OVERDUE_MS;
	int16_t back = (wheel->farthest - wheel->below) * wheel->leg.way;

	if (back < 0)
		wheel->farthest = wheel->below;
	if (back > 0)
		wheel->went_back = true;
	doubt(wheel,
	      !consistent || wheel->misfit || -behind_cdeg > tolerance_cdeg ||
		      back >= BACKWARD_EDGES,
	      FAULT_WHEEL_SLIP, behind_cdeg);
	if (wheel->doubts)
		return;
	if (behind_cdeg <= tolerance_cdeg)
		wheel->behinds = 0;
	else if (wheel->behinds <= DOUBTS)
		wheel->behinds++;
	bool late = wheel->behinds > DOUBTS || (overdue && wheel->step == STEP_CREEP);
	if (!late || !wheel->late) {
		wheel->late = late;
		wheel->t_late_ms = wheel->now_ms;
		wheel->late_cdeg = middle(&span);
		return;
	}
	int16_t moved_cdeg = middle(&span) - wheel->late_cdeg;
	if (moved_cdeg * wheel->leg.way > MOVED_CDEG)
		blame(wheel, wheel->went_back ? FAULT_WHEEL_SLIP : FAULT_WHEEL_SLOW, behind_cdeg);
	else if ((uint16_t)(wheel->now_ms - wheel->t_late_ms) > GRACE_MS)
		blame(wheel,
		      behind_cdeg > tolerance_cdeg / 2 ? FAULT_WHEEL_STUCK : FAULT_INDEX_PATTERN,
		      behind_cdeg); /* not behind: it is there, but has not proved it */
}

/* --- feedback ------------------------------------------------------------------------------- */

void wheel_feedback(struct wheel *wheel, uint16_t level)
{
	int16_t gain = value(wheel, PARAM_FEEDBACK_DDEG_FS);

	wheel->feedback_known = false;
	if (gain == 0)
		return;
	if (level < RAIL_LEVELS || level > RING_FULL_SCALE - RAIL_LEVELS) {
		wheel_fail(wheel, FAULT_FEEDBACK_OPEN, level);
		return;
	}
	int32_t above_zero = (int32_t)level - value(wheel, PARAM_FEEDBACK_ZERO_LEVEL);
	int32_t angle_cdeg = above_zero * gain * 5 / (RING_FULL_SCALE / 2);
	if (angle_cdeg < WHEEL_LOWEST_CDEG)
		angle_cdeg = WHEEL_LOWEST_CDEG;
	if (angle_cdeg > WHEEL_HIGHEST_CDEG)
		angle_cdeg = WHEEL_HIGHEST_CDEG;
	wheel->feedback_known = true;
	wheel->feedback_cdeg = angle_cdeg;
}
