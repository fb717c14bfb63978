/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/tag.h"

#include <math.h>

#include "base/clock.h"
#include "include/frame.h"

#define LONGEST_DELAY_FRAMES 5

void lp_exposure_tag_init(struct lp_exposure_tag *tag, int delay_frames)
{
	*tag = (struct lp_exposure_tag){.delay_frames = delay_frames,
					.exposure_us = NAN,
					.gain = NAN,
					.before_exposure_us = NAN,
					.before_gain = NAN};
}

void lp_exposure_tag_command(struct lp_exposure_tag *tag, float exposure_us, float gain,
			     int64_t now_ns)
{
	/* Two changes under way: which one a frame has is not known. */
	tag->before_exposure_us = tag->pending ? NAN : tag->exposure_us;
	tag->before_gain = tag->pending ? NAN : tag->gain;
	tag->exposure_us = exposure_us;
	tag->gain = gain;
	tag->commanded_ns = now_ns;
	tag->pending = true;
	tag->seen_after = false;
}

/* Frames after the first one begun after the command: -1 for those begun before it. */
static int64_t age_frames(struct lp_exposure_tag *tag, uint64_t sequence, int64_t stamp_ns)
{
	if (!tag->seen_after && stamp_ns > tag->commanded_ns) {
		tag->seen_after = true;
		tag->first_after = sequence;
	}
	return tag->seen_after ? (int64_t)(sequence - tag->first_after) : -1;
}

static void tag_pending(struct lp_exposure_tag *tag, struct lp_frame *frame, int64_t stamp_ns)
{
	const int64_t age = age_frames(tag, frame->sequence, stamp_ns);
	const int delay = tag->delay_frames;
	const int64_t unsure_from = delay > 0 ? delay - 1 : 0;
	const int64_t unsure_to = delay >= 0 ? delay : LONGEST_DELAY_FRAMES;

	if (age > unsure_to) {
		tag->pending = false;
	} else if (age < unsure_from) {
		frame->exposure_us = tag->before_exposure_us;
		frame->gain = tag->before_gain;
	}
}

void lp_exposure_tag_frame(struct lp_exposure_tag *tag, struct lp_frame *frame)
{
	const int64_t stamp_ns = frame->t_start_ns ? frame->t_start_ns : frame->t_arrival_ns;

	frame->exposure_us = NAN;
	frame->gain = NAN;
	if (tag->pending)
		tag_pending(tag, frame, stamp_ns);
	if (!tag->pending) {
		frame->exposure_us = tag->exposure_us;
		frame->gain = tag->gain;
	}
	frame->t_start_ns = stamp_ns;
	if (!isnan(frame->exposure_us))
		frame->t_start_ns -= (int64_t)((double)frame->exposure_us * LP_NS_PER_US);
}
