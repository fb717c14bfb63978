/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/frame_clock.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "include/frame.h"

/* Chosen by hand. */
#define EARLY_NS (5 * LP_NS_PER_MS)	/* by which the kernel's own stamps may be of the future */
#define OLDEST_NS (1500 * LP_NS_PER_MS) /* no frame takes longer, unless nobody took frames */
#define LATE_NS (500 * LP_NS_PER_MS)	/* nor, beyond a period, do all frames of two seconds */
#define LATE_FOR_NS (2 * LP_NS_PER_S)
#define GOOD_FOR_NS (2 * LP_NS_PER_S) /* so long stamps must be true to be believed again, */
#define SAME_NS (12 * LP_NS_PER_MS)   /* with the same shortest delay as ever */
#define MOST_OVERTAKEN 16	      /* frames; more is a camera that counts anew */
#define TICK_NS LP_NS_PER_S
#define FIRST_SPAN_NS LP_NS_PER_S
#define DRIFT_NS (3 * LP_NS_PER_MS) /* from each span to the next */
/* Where no delay is known: it is anything within a frame's period, of 33 ms. */
#define UNKNOWN_DELAY_NS (17 * LP_NS_PER_MS)
#define UNKNOWN_SIGMA_NS 10e6
#define LEAST_SIGMA_NS 3e6
#define MOST_EXCESS_NS 100e6
#define EXCESS_GAIN 0.02

static const char none[] = "its frames carry no time stamps";
static const char stands[] = "its time stamps stand still or go back";
static const char old[] = "its time stamps are older than its frames can be";
static const char future[] = "its time stamps are of times to come";
static const char drifts[] = "its clock runs faster or slower than this machine's";

static int64_t least(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

/* ---------------------------------------------------------------- delays */

static bool rises_by_steps(const struct lp_frame_clock *clock, int sign)
{
	bool rises = true;

	for (int k = 1; k < LP_CLOCK_FLOORS; k++)
		rises &= sign * (clock->floors_ns[k] - clock->floors_ns[k - 1]) > DRIFT_NS;
	return rises;
}

/* The spans are full: whether they show a drift. Makes room for more. */
static bool close_spans(struct lp_frame_clock *clock)
{
	const bool drift = rises_by_steps(clock, 1) || rises_by_steps(clock, -1);

	for (int k = 0; k < LP_CLOCK_FLOORS / 2; k++)
		clock->floors_ns[k] = least(clock->floors_ns[2 * k], clock->floors_ns[2 * k + 1]);
	clock->floor_count = drift ? 1 : LP_CLOCK_FLOORS / 2;
	clock->span_ns *= 2;
	return drift;
}

/* A delay of a clock that is believed. True: it drifts. */
static bool learn(struct lp_frame_clock *clock, int64_t delay_ns, int64_t now_ns)
{
	bool drift = false;

	if (delay_ns > LATE_NS) /* of a machine that was busy: it says nothing of the usual */
		return false;
	if (clock->floor_count == 0) {
		clock->span_ns = FIRST_SPAN_NS;
		clock->span_end_ns = 0;
	}
	if (now_ns >= clock->span_end_ns) {
		if (clock->floor_count == LP_CLOCK_FLOORS)
			drift = close_spans(clock);
		clock->floors_ns[clock->floor_count++] = delay_ns;
		clock->span_end_ns = now_ns + clock->span_ns;
	}
	int64_t *const floor_ns = &clock->floors_ns[clock->floor_count - 1];

	*floor_ns = least(*floor_ns, delay_ns);
	const double excess_ns =
		fmin(fmax((double)(delay_ns - clock->floors_ns[0]), 0.0), MOST_EXCESS_NS);

	clock->excess_ns2 += EXCESS_GAIN * (excess_ns * excess_ns - clock->excess_ns2);
	return drift;
}

/* One span that is over, at least. */
static bool has_learned(const struct lp_frame_clock *clock)
{
	return clock->floor_count > 1;
}

/* ---------------------------------------------------------------- one stamp */

/* All frames have been late for too long. */
static bool is_always_late(struct lp_frame_clock *clock, int64_t delay_ns, int64_t now_ns)
{
	const int64_t period_ns =
		least(clock->has_frames ? now_ns - clock->arrival_ns : 0, LATE_FOR_NS);

	if (delay_ns <= LATE_NS + period_ns)
		clock->t_late_ns = 0;
	else if (clock->t_late_ns == 0)
		clock->t_late_ns = now_ns;
	return clock->t_late_ns && now_ns - clock->t_late_ns > LATE_FOR_NS;
}

/* What cannot be of this stamp; NULL: it may be true. */
static const char *contradiction(struct lp_frame_clock *clock, const struct lp_frame *frame,
				 int64_t stamp_ns)
{
	const int64_t now_ns = frame->t_arrival_ns;
	const int64_t before_ns = clock->has_frames ? clock->before_ns : now_ns;
	const int64_t oldest_ns = least(now_ns - OLDEST_NS, before_ns - LATE_NS);
	const bool is_later = clock->has_frames && frame->sequence >= clock->sequence;

	if (stamp_ns == 0)
		return none;
	if (stamp_ns > now_ns + EARLY_NS)
		return future;
	if (is_later && stamp_ns <= clock->stamp_ns)
		return stands;
	if (stamp_ns < 0 || stamp_ns < oldest_ns ||
	    is_always_late(clock, now_ns - stamp_ns, now_ns))
		return old;
	return NULL;
}

static void note_arrival(struct lp_frame_clock *clock, const struct lp_frame *frame,
			 int64_t stamp_ns)
{
	const int64_t now_ns = frame->t_arrival_ns;

	if (!clock->has_frames || now_ns - clock->tick_ns >= TICK_NS) {
		clock->tick_ns = now_ns;
		clock->before_ns = clock->has_frames ? clock->arrival_ns : now_ns;
	}
	clock->arrival_ns = now_ns;
	if (!clock->has_frames || frame->sequence >= clock->sequence ||
	    clock->sequence - frame->sequence > MOST_OVERTAKEN) {
		clock->sequence = frame->sequence;
		clock->stamp_ns = stamp_ns;
	}
	clock->has_frames = true;
}

/* ---------------------------------------------------------------- belief */

static void disbelieve(struct lp_frame_clock *clock, const char *fault, const char *object)
{
	clock->t_good_ns = 0;
	if (clock->fault)
		return;
	clock->fault = fault;
	lp_warning(object, "clock",
		   "%s: the arrival of its frames counts instead, and directions are less certain "
		   "while it turns",
		   fault);
}

/* A clock that is not believed gave a stamp that may be true. */
static void reconsider(struct lp_frame_clock *clock, int64_t delay_ns, int64_t now_ns,
		       const char *object)
{
	if (clock->t_good_ns == 0) {
		clock->t_good_ns = now_ns;
		clock->good_ns = delay_ns;
	}
	clock->good_ns = least(clock->good_ns, delay_ns);
	if (now_ns - clock->t_good_ns < GOOD_FOR_NS)
		return;
	clock->t_good_ns = 0;
	if (has_learned(clock) && llabs(clock->good_ns - clock->floors_ns[0]) > SAME_NS)
		return;
	clock->fault = NULL;
	clock->floor_count = has_learned(clock) ? 1 : 0;
	lp_info(object, "clock", "its time stamps are right again");
}

/* By the arrival. */
static void stand_in(const struct lp_frame_clock *clock, struct lp_frame *frame)
{
	const int64_t floor_ns = clock->floor_count ? clock->floors_ns[0] : UNKNOWN_DELAY_NS;
	const int64_t delay_ns = has_learned(clock) ? floor_ns : least(floor_ns, UNKNOWN_DELAY_NS);
	const double sigma_ns = has_learned(clock) ? fmax(sqrt(clock->excess_ns2), LEAST_SIGMA_NS)
						   : UNKNOWN_SIGMA_NS;

	frame->t_read_ns = frame->t_arrival_ns - (delay_ns > 0 ? delay_ns : 0);
	frame->stamp_sigma_us = (float)(sigma_ns / 1e3);
}

void lp_frame_clock_stamp(struct lp_frame_clock *clock, struct lp_frame *frame, int64_t stamp_ns,
			  const char *object)
{
	const int64_t now_ns = frame->t_arrival_ns;

	if (!(frame->flags & LP_FRAME_CORRUPT)) { /* whose stamp may be missing, or anything */
		const char *fault = contradiction(clock, frame, stamp_ns);

		note_arrival(clock, frame, stamp_ns);
		if (!fault && clock->fault)
			reconsider(clock, now_ns - stamp_ns, now_ns, object);
		else if (!fault && learn(clock, now_ns - stamp_ns, now_ns))
			fault = drifts;
		if (fault)
			disbelieve(clock, fault, object);
	}
	frame->clock_fault = clock->fault;
	frame->stamp_sigma_us = 0.0F;
	if (clock->fault || stamp_ns <= 0 || frame->flags & LP_FRAME_CORRUPT)
		stand_in(clock, frame);
	else
		frame->t_read_ns = least(stamp_ns, now_ns);
}
