/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A wheel on a bare servo, with one sensor on the comb of its rim: what is known of it by time and
 * edges. A servo says nothing; so every move, homing included, goes down below the comb's first
 * edge and comes up again at a known pace, and each edge on the way must come when it should. The
 * first one tells how far servo and wheel differ. The wheel is settled when all edges below the
 * target have come, and none after that; its angle is known to lie between two edges.
 *
 * Pure: time and edges are handed in. Angles in degrees of the wheel.
 *
 *        a target is known            below the comb, by time
 *   IDLE ------------------> DOWN --------------------------------> UP
 *    ^                       ^ ^ ^                                  |
 *    | lp_timed_forget(),    | | +--------- a new target -----------+
 *    | from every state      | |                                    | all edges below the target
 * have |                       | +--------- a new target -- REST <----+ come in their time, and no
 * more |                       |                             |        | |      after 2 s, later |
 * an edge: the wheel  |        | an edge early, late, or too soon |            up to 60 s | moved
 * by itself     v        | after the one before; too few or
 *    +-----------------------+--------------------------- FAULT <---+ too many of them
 *
 * On the way DOWN nothing is proved: edges do not count. DOWN from an unknown place takes the time
 * of 270 degrees at 120 degrees a second, and the way up, the wheel's lag and settle_ms more than
 * the angle at slew_deg_s. The angle is known in REST only.
 */
#ifndef LP_ROTATOR_TIMED_H
#define LP_ROTATOR_TIMED_H

#include <stdbool.h>
#include <stdint.h>

#include "base/backoff.h"
#include "base/param.h"
#include "include/rotator.h"

struct lp_timed_params {
	float servo_zero_us;	/* pulse at 0 degrees */
	float servo_us_per_deg; /* may be negative */
	float servo_min_us;	/* the servo's own limits: no pulse is shorter or longer */
	float servo_max_us;
	float slew_deg_s;	   /* commanded */
	float slew_physical_deg_s; /* nothing real is faster */
	float lag_ms;		   /* delay of the wheel behind the pulses */
	float settle_ms;
	float hold_s;		    /* the servo is let go so long after settling */
	float first_deg, pitch_deg; /* of the comb, one sensor's edges */
	int edges;
	float edge_error_deg; /* position error of the comb's edges */
	float tolerance_deg;  /* between servo and wheel */
};

enum lp_timed_step {
	LP_TIMED_IDLE, /* angle unknown, nothing under way */
	LP_TIMED_DOWN,
	LP_TIMED_UP,
	LP_TIMED_REST,
	LP_TIMED_FAULT,
};

struct lp_timed {
	struct lp_timed_params params;
	enum lp_timed_step step;
	bool homed; /* since IDLE: then it is MOVING, else HOMING */
	float target_deg, from_deg, offset_deg;
	int64_t t_step_ns, t_edge_ns;
	int edges;	    /* since UP began */
	int64_t t_again_ns; /* FAULT: tries again then */
	struct lp_backoff again;
	int tries;	   /* since the wheel was homed last */
	bool stopped;	   /* no more of them: there may be a finger in the gear */
	const char *fault; /* the first since then, by name; NULL: none */
	const char *next_step;
};

/* Keys of the URI that are the model's, of struct lp_timed_params. */
extern const struct lp_params lp_timed_keys;

/* False: the parameters contradict each other; logged for `object`. */
bool lp_timed_check(const struct lp_timed_params *params, const char *object);

/* "down", for messages. */
const char *lp_timed_step_name(enum lp_timed_step step);

void lp_timed_init(struct lp_timed *timed);

/* -ERANGE, with *reason: the comb cannot prove this angle, or the servo cannot go there. */
int lp_timed_move(struct lp_timed *timed, float target_deg, int64_t now_ns, const char **reason);

/* The bus was lost, or is back: the angle is not known. A fault stays, and so does what was tried:
 * a stalled servo may be what disturbs the bus. */
void lp_timed_forget(struct lp_timed *timed, int64_t now_ns);

void lp_timed_edge(struct lp_timed *timed, int64_t t_ns);

/* As often as the pulse is renewed. `sensor_on`: whether the sensor sees a tooth now. */
void lp_timed_tick(struct lp_timed *timed, int64_t now_ns, bool sensor_on);

/* 0: no pulse. */
float lp_timed_pulse_us(const struct lp_timed *timed, int64_t now_ns);

void lp_timed_state(const struct lp_timed *timed, int64_t now_ns, struct lp_wheel_state *state);

#endif
