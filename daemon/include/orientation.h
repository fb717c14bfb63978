/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How the probe is turned, and where it is, told by something else than its own frames: an inertial
 * sensor, or the head pose of an app. One back end = one file drivers/orientation/<scheme>.c with
 * one `const struct lp_orientation_ops`, registered by one line in app/backends.c. Contract as in
 * source.h. What clients send (client:) and what frames carry (sim:) needs no device and is no back
 * end of this role; it goes the same way from lp_orientation_track_add() on
 * (light/turn/orientation_track.h).
 *
 * A sensor has a body frame of its own. How the probe sits on it, the mount, is not its business:
 * the application knows it.
 */
#ifndef LP_ORIENTATION_H
#define LP_ORIENTATION_H

#include <stdint.h>

#include "include/backend.h"

struct lp_loop;
struct lp_orientation;
struct lp_uri;

/* By so much the square of a quaternion may differ from 1: it is scaled. */
#define LP_MOST_NOT_UNIT 0.02

enum lp_orientation_sample_kind {
	LP_ATTITUDE, /* how the body is turned against a frame that does not move */
	LP_TURN_RATE /* how fast it turns, about its own axes */
};

/* One sensor gives one kind, in the order of time. */
struct lp_orientation_sample {
	enum lp_orientation_sample_kind kind;
	int64_t t_ns; /* CLOCK_MONOTONIC, when it was so: not when it arrived */
	/* ATTITUDE: x y z w, turns the body's frame into that which does not move; a unit
	 * quaternion within one percent. */
	double quaternion[4];
	double rate_rad_s[3]; /* TURN_RATE: right-handed, body axes; offsets already removed */
	/* 1 sigma about each axis, independent from sample to sample: of the attitude in rad, or of
	 * the rate in rad/s. > 0. */
	double sigma;
	double time_sigma_s; /* 1 sigma of t_ns, the same error for all of them; 0: exact */
	/* ATTITUDE: where the body is in that frame. 1 sigma along each axis; 0: nobody tells. */
	double position_m[3], position_sigma_m;
};

/* Callbacks into the application, all on the loop thread. */
struct lp_orientation_host {
	void *context;
	struct lp_loop *loop; /* outlives the sensor */
	void (*sample)(void *context, const struct lp_orientation_sample *sample);
	/* As in rotator.h. */
	void (*fault)(void *context, const char *id, const char *text);
};

struct lp_orientation_ops {
	struct lp_backend info;
	int (*create)(const struct lp_uri *uri, const struct lp_orientation_host *host,
		      struct lp_orientation **orientation);
	int (*start)(struct lp_orientation *orientation);
	void (*destroy)(struct lp_orientation *orientation); /* accepts NULL */
};

/* Base of every back end: embed it as the first member. */
struct lp_orientation {
	const struct lp_orientation_ops *ops;
	struct lp_orientation_host host;
};

#endif
