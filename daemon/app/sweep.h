/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which way the polarizer stood during a frame's exposure. A frame gets an angle only when the
 * wheel's device, asked after the frame had come, says that the wheel has been settled since before
 * the exposure began. Until the answer comes the frame waits; a frame exposed while the wheel moved
 * is left out; where nothing is known of the wheel the frame passes without an angle.
 *
 * Besides, it goes round the angles that were asked for, and stays at each as long as it was told,
 * or until the bracket's exposures have been there. No I/O: time and states are handed in.
 */
#ifndef LP_APP_SWEEP_H
#define LP_APP_SWEEP_H

#include <stdbool.h>
#include <stdint.h>

#include "app/health.h"
#include "include/rotator.h"

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
	bool is_whole; /* one has come again, after others: all have been there */
};

struct lp_sweep {
	struct lp_sweep_host host;
	struct lp_wheel_report *report; /* counted into; borrowed */
	/* Frames exposed while the wheel turns are good for all but polarization: they pass without
	 * an angle. Else they are left out. */
	bool pass_turning;
	int angle_count;
	float angles_deg[LP_SWEEP_ANGLES];
	int64_t dwell_ns;
	int64_t rest_ns;   /* after each round at the first angle, unless one is wanted */
	int64_t t_rest_ns; /* since when; 0: no round is over yet */
	bool wanted;
	int at; /* angles_deg[at] is commanded */
	struct lp_sweep_exposures exposures;
	int64_t t_arrived_ns; /* 0: not there yet */
	struct lp_frame *held;
	int64_t t_held_ns;
};

/* Commands the first angle. */
void lp_sweep_start(struct lp_sweep *sweep);
void lp_sweep_state(struct lp_sweep *sweep, const struct lp_wheel_state *state, int64_t now_ns);
/* Go round the angles now, even if it is time to rest. */
void lp_sweep_want(struct lp_sweep *sweep);
/* The same. A whole round that begins after now is over when report->sweeps has reached the result.
 */
uint64_t lp_sweep_request(struct lp_sweep *sweep);
/* Takes over the reference to `frame`. */
void lp_sweep_frame(struct lp_sweep *sweep, struct lp_frame *frame, int64_t now_ns);
/* Several times a second. */
void lp_sweep_tick(struct lp_sweep *sweep, int64_t now_ns);
void lp_sweep_finish(struct lp_sweep *sweep); /* releases what waits */

/* The wheel is not where it should be, or nobody knows. */
bool lp_sweep_lost(const struct lp_sweep *sweep);

#endif
