/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/exposure_guess.h"

#include <math.h>

#include "include/frame.h"

/* Where the delay is not known: longer than the 1 to 4 frames that cameras take
 * (estimate/exposures/bracket.c). */
#define LONGEST_DELAY_FRAMES 5

void lp_exposure_guess_init(struct lp_exposure_guess *guess, int delay_frames)
{
	*guess = (struct lp_exposure_guess){.delay_frames = delay_frames,
					    .longest_frames = LONGEST_DELAY_FRAMES,
					    .exposure_us = NAN,
					    .gain = NAN,
					    .before_exposure_us = NAN,
					    .before_gain = NAN};
}

void lp_exposure_guess_command(struct lp_exposure_guess *guess, float exposure_us, float gain,
			       int64_t now_ns)
{
	/* Two changes under way: which one a frame has is not known. */
	guess->before_exposure_us = guess->pending ? NAN : guess->exposure_us;
	guess->before_gain = guess->pending ? NAN : guess->gain;
	guess->exposure_us = exposure_us;
	guess->gain = gain;
	guess->commanded_ns = now_ns;
	guess->pending = true;
	guess->seen_after = false;
}

void lp_exposure_guess_late(struct lp_exposure_guess *guess, int64_t now_ns)
{
	if (!guess->pending)
		return;
	guess->commanded_ns = now_ns;
	guess->seen_after = false;
}

/* Frames after the first one read after the command: -1 for those read before it. */
static int64_t age_frames(struct lp_exposure_guess *guess, uint64_t sequence, int64_t read_ns)
{
	if (!guess->seen_after && read_ns > guess->commanded_ns) {
		guess->seen_after = true;
		guess->first_after = sequence;
	}
	return guess->seen_after ? (int64_t)(sequence - guess->first_after) : -1;
}

static void guess_pending(struct lp_exposure_guess *guess, struct lp_frame *frame)
{
	const int64_t age = age_frames(guess, frame->sequence, frame->t_read_ns);
	const int delay = guess->delay_frames;
	const int64_t unsure_from = delay > 0 ? delay - 1 : 0;
	const int64_t unsure_to = delay >= 0 ? delay : guess->longest_frames;

	if (age > unsure_to) {
		guess->pending = false;
	} else if (age < unsure_from) {
		frame->exposure_us = guess->before_exposure_us;
		frame->gain = guess->before_gain;
	}
}

void lp_exposure_guess_frame(struct lp_exposure_guess *guess, struct lp_frame *frame)
{
	frame->exposure_us = NAN;
	frame->gain = NAN;
	if (guess->pending)
		guess_pending(guess, frame);
	if (!guess->pending) {
		frame->exposure_us = guess->exposure_us;
		frame->gain = guess->gain;
	}
}
