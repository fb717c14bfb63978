/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which way the polarizer stood during a frame's exposure. A frame gets an angle only when the
 * wheel's device, asked after the frame had come, says that the wheel has been settled since before
 * the exposure began. Until the answer comes the frame waits; a frame exposed while the wheel moved
 * is left out; where nothing is known of the wheel the frame passes without an angle.
 *
 * Besides, it visits the angles that were asked for, and stays at each as long as it was told, or
 * until the bracket's exposures have been there. Angles in rising order are visited to and fro: the
 * shortest way, which begins where it has ended. No I/O: time and states are handed in.
 */
#ifndef LP_APP_BOX_SWEEP_H
#define LP_APP_BOX_SWEEP_H

#include <stdbool.h>
#include <stdint.h>

#include "include/rotator.h"
#include "serve/health.h"

#define LP_SWEEP_ANGLES 16
#define LP_SWEEP_EXPOSURES 8

struct lp_frame;

struct lp_sweep_host {
	void *context;
	void (*frame)(void *context, struct lp_frame *frame); /* takes over the reference */
	void (*move)(void *context, float target_deg);
	void (*look)(void *context);
};

/* What the frames at one angle were exposed for, times gain. */
struct lp_sweep_exposures {
	float us[LP_SWEEP_EXPOSURES];
	int count;
	float last_us;
	/* All have been there: one has come again, after others; or all that there were at the
	 * angle before. */
	bool is_whole;
};

struct lp_sweep {
	struct lp_sweep_host host;
	struct lp_wheel_report *report; /* counted into; borrowed */
	/* Frames exposed while the wheel turns are good for all but polarization: they pass without
	 * an angle. Else they are left out. */
	bool pass_turning;
	int angle_count;
	float angles_deg[LP_SWEEP_ANGLES];
	bool to_and_fro;   /* from end to end and back, not from the last to the first */
	bool by_exposures; /* leave an angle as soon as each exposure has been there */
	int64_t dwell_ns;  /* at an angle; by_exposures: at most */
	int64_t rest_ns;   /* after each sweep where it ends, unless one is wanted */
	int64_t t_rest_ns; /* since when; 0: no sweep is over yet */
	bool wanted;
	bool backwards;
	bool is_lost;	   /* it failed, or fell silent, and has not settled since */
	bool is_under_way; /* a sweep has left its first angle and is not over */
	int at;		   /* angles_deg[at] is commanded */
	struct lp_sweep_exposures exposures, before; /* here, and at the angle before */
	int64_t t_arrived_ns;			     /* 0: not there yet */
	struct lp_frame *held;
	int64_t t_held_ns;
};

/* Commands the first angle. */
void lp_sweep_start(struct lp_sweep *sweep);
void lp_sweep_state(struct lp_sweep *sweep, const struct lp_wheel_state *state, int64_t now_ns);
/* Sweep now, even if it is time to rest. */
void lp_sweep_want(struct lp_sweep *sweep);
/* The same. A whole sweep that begins after now is over when report->sweeps has reached the result.
 */
uint64_t lp_sweep_request(struct lp_sweep *sweep);
/* Takes over the reference to `frame`. */
void lp_sweep_frame(struct lp_sweep *sweep, struct lp_frame *frame, int64_t now_ns);
/* Several times a second. */
void lp_sweep_tick(struct lp_sweep *sweep, int64_t now_ns);
void lp_sweep_finish(struct lp_sweep *sweep); /* releases what waits */

/* The wheel is not where it should be, or nobody knows. Once lost it stays so until it has settled:
 * a stuck wheel that turns to try again is as lost as before. */
bool lp_sweep_lost(const struct lp_sweep *sweep);

#endif
