/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The microcontroller, over any carrier: greets it, checks its version, matches the clocks, turns
 * messages of proto/mcu.dbc into numbers and back, and starts again when it was reset, unplugged or
 * silent. One connection serves every back end that names it. Loop thread.
 */
#ifndef LP_LINK_MCU_H
#define LP_LINK_MCU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/ring_sample.h"
#include "include/rotator.h"

struct lp_connections;
struct lp_loop;
struct lp_mcu;
struct lp_params;
struct lp_uri;

struct lp_mcu_wheel {
	uint8_t token; /* of the command that this is the state of */
	struct lp_wheel_state state;
};

struct lp_mcu_ring {
	uint32_t sequence;		  /* gaps are rings lost on the link */
	int64_t t_ns;			  /* CLOCK_MONOTONIC, middle of the averaging window */
	uint16_t levels[LP_RING_SENSORS]; /* 1/4092 of the supply */
	uint16_t dead;			  /* bit k: sensor k is open or shorted */
};
#define LP_RING_FULL_SCALE 4092

/* Whoever uses the connection: embed it. Callbacks may be NULL. */
struct lp_mcu_user {
	struct lp_mcu_user *next;
	/* It speaks our protocol, and was just started or found: nothing is known of the wheel. */
	void (*found)(struct lp_mcu_user *user);
	void (*lost)(struct lp_mcu_user *user);
	void (*wheel)(struct lp_mcu_user *user, const struct lp_mcu_wheel *wheel);
	void (*ring)(struct lp_mcu_user *user, const struct lp_mcu_ring *ring);
	/* A command for the wheel was refused for good. */
	void (*refused)(struct lp_mcu_user *user, uint8_t token, const char *reason);
	/* Never NULL; as in rotator.h. */
	void (*fault)(struct lp_mcu_user *user, const char *id, const char *text);
};

/* Keys of the URI that are the connection's. */
struct lp_mcu_settings {
	int baud, address, ring_scans;
};
extern const struct lp_params lp_mcu_params;

/*
 * Join the connection that `uri` names (mcu:CARRIER:DEVICE), or make it, on `loop`. `settings` are
 * what the URI says; where several URIs name one connection, a key counts that any of them has.
 * -EINVAL (also: another one has said otherwise before), -ENOMEM, logged.
 */
int lp_mcu_join(struct lp_connections *connections, struct lp_loop *loop, const struct lp_uri *uri,
		const struct lp_mcu_settings *settings, struct lp_mcu_user *user,
		struct lp_mcu **mcu);
void lp_mcu_leave(struct lp_mcu *mcu, struct lp_mcu_user *user); /* the last one closes it */

/* Opens it, or begins to wait for it; the second call does nothing. */
void lp_mcu_start(struct lp_mcu *mcu);

/* Commands; a lost one shows in the wheel's state, which keeps its old token. */
void lp_mcu_home(struct lp_mcu *mcu, uint8_t token);
void lp_mcu_move(struct lp_mcu *mcu, uint8_t token, float target_deg); /* 0..180 */
void lp_mcu_release(struct lp_mcu *mcu);
/* The wheel is not turned any more: it failed three times in a row, and a person must look. */
bool lp_mcu_wheel_stopped(const struct lp_mcu *mcu);
/* Ask for a wheel state seen from now on. */
void lp_mcu_look(struct lp_mcu *mcu);

#endif
