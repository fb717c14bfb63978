/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which exposure a frame was taken with. UVC frames do not say; what is known is when a command was
 * given and how many frames late this camera obeys. Around the change, where one frame more or less
 * decides, the exposure is unknown rather than wrong.
 */
#ifndef LP_SOURCE_EXPOSURE_GUESS_H
#define LP_SOURCE_EXPOSURE_GUESS_H

#include <stdbool.h>
#include <stdint.h>

struct lp_frame;

struct lp_exposure_guess {
	int delay_frames;   /* -1: not known */
	int longest_frames; /* that it may be where it is not known; 5 */
	bool pending;	    /* the command's frame may still be to come */
	int64_t commanded_ns;
	bool seen_after; /* a frame read after the command has been seen: the one below */
	uint64_t first_after;
	float exposure_us, gain;	       /* in force once settled; NAN: unknown */
	float before_exposure_us, before_gain; /* until then */
};

/* Nothing is known of frames so far. */
void lp_exposure_guess_init(struct lp_exposure_guess *guess, int delay_frames);

/* Exposure and gain (NAN: unknown) were commanded; the call returned at `now_ns`. */
void lp_exposure_guess_command(struct lp_exposure_guess *guess, float exposure_us, float gain,
			       int64_t now_ns);

/* The command was answered only now: it may have taken effect at any time since it was given. */
void lp_exposure_guess_late(struct lp_exposure_guess *guess, int64_t now_ns);

/* Fill in exposure_us and gain of the next frame, whose t_read_ns is set. */
void lp_exposure_guess_frame(struct lp_exposure_guess *guess, struct lp_frame *frame);

#endif
