/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A rotator turns the polarizer wheel. One back end = one file drivers/wheel/<scheme>.c with one
 * `const struct lp_rotator_ops`, registered by one line in app/backends.c.
 *
 * Contract as in source.h: create() parses and allocates, start() opens; a device that is absent is
 * waited for; ops run on the loop thread and take less than 1 ms. The back end homes the wheel by
 * itself whenever its angle is not known, and tries again, more and more rarely, after a fault.
 *
 * Commanded, measured and unknown are three things. An angle is only what the device says of the
 * wheel, never what it was told to do.
 */
#ifndef LP_ROTATOR_H
#define LP_ROTATOR_H

#include <stdint.h>

#include "include/backend.h"

struct lp_connections;
struct lp_loop;
struct lp_rotator;
struct lp_uri;

/* Same values as Wheel.Phase of lightprobe.proto; serve/codec/codec.c asserts it. */
enum lp_wheel_phase {
	LP_WHEEL_UNKNOWN, /* present, angle not known */
	LP_WHEEL_HOMING,
	LP_WHEEL_MOVING,
	LP_WHEEL_SETTLED,
	LP_WHEEL_FAULT,
	LP_WHEEL_ABSENT, /* no word from the device */
};

struct lp_wheel_state {
	enum lp_wheel_phase phase;
	float commanded_deg; /* NAN: none */
	float measured_deg;  /* NAN: unknown */
	float sigma_deg;     /* 1 sigma of measured_deg; NAN: unknown */
	/* CLOCK_MONOTONIC; the phase had been entered by then, for certain. */
	int64_t t_phase_ns;
	/* CLOCK_MONOTONIC; all of this was so at some moment after it. */
	int64_t t_seen_ns;
	float clock_sigma_us; /* of the device's clock on ours; NAN: it has none, or not yet known
			       */
	uint64_t reconnects;
};

/* Callbacks into the application, all on the loop thread. */
struct lp_rotator_host {
	void *context;
	struct lp_loop *loop; /* outlives the rotator */
	/* At every change, whenever the device reports, and in answer to look(). */
	void (*state)(void *context, const struct lp_wheel_state *state);
	/* A fault by its name in docs/users/faults.md (static text). `text`: object, stage,
	 * next step; valid during the call; NULL: it is over. */
	void (*fault)(void *context, const char *id, const char *text);
	struct lp_connections *connections; /* shared with other roles; outlives the rotator */
};

struct lp_rotator_ops {
	struct lp_backend info;
	int (*create)(const struct lp_uri *uri, const struct lp_rotator_host *host,
		      struct lp_rotator **rotator);
	int (*start)(struct lp_rotator *rotator);
	/* Turn the wheel to `target_deg` (0..180), as soon as its angle is known. A newer target
	 * replaces an older one. */
	void (*move)(struct lp_rotator *rotator, float target_deg);
	/* Ask for a state with t_seen_ns of now or later. */
	void (*look)(struct lp_rotator *rotator);
	void (*destroy)(struct lp_rotator *rotator); /* accepts NULL; lets the servo go */
};

/* Base of every back end: embed it as the first member. */
struct lp_rotator {
	const struct lp_rotator_ops *ops;
	struct lp_rotator_host host;
};

#endif
