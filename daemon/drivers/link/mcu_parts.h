/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The connection from the inside, for its three parts: mcu.c (users, building, commands),
 * mcu_session.c (greeting, silence, starting again), mcu_reports.c (messages to numbers).
 *
 * The session. HelloRequest in GREETING, and Rates in SETTING, are repeated every 0.2 s.
 *
 *             open() fails: again after 0.2 s, later up to 2 s
 *             +------+
 *             v      |  open()
 *   start -> CLOSED -+--------------> GREETING <------------------------------+
 *             ^                        |   ^                                  |
 *             |   5 s without a Hello  |   |  5 s without a Result            |
 *             +------------------------+   +---------------+                  |
 *             |                        |                   |                  |
 *             |                  Hello |                   |                  |
 *             |                        +---------------> SETTING              |
 *             |   Hello of another     |                  ^   |               |
 *             |   protocol: for 10 s   |    a Hello: the  |   | Result        | 2 s of
 *             +------------------------+    device was    |   v               | silence
 *             |                             reset         +- READY -----------+
 *             |
 *             +--- from every state, when the carrier says that the device is gone
 *
 * The users hear found() when READY is entered, and lost() when it is left. The limits are named in
 * mcu_session.c and mcu.c.
 */
#ifndef LP_LINK_MCU_PARTS_H
#define LP_LINK_MCU_PARTS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/loop.h"
#include "dbc/mcu.h"
#include "drivers/link/carrier.h"
#include "drivers/link/clock.h"
#include "drivers/link/mcu.h"
#include "include/connections.h"

enum lp_mcu_state {
	LP_MCU_CLOSED,	 /* to be opened at t_next_ns */
	LP_MCU_GREETING, /* HelloRequest until Hello */
	LP_MCU_SETTING,	 /* Rates until its Result */
	LP_MCU_READY,	 /* wheel and ring are in use */
};

struct lp_mcu_recovery {
	uint32_t faults;    /* latched, as last reported */
	unsigned trouble;   /* number of the wheel's fault that began it; 0: none */
	int tries;	    /* to home it since */
	bool stopped;	    /* no more of them */
	int64_t t_clear_ns; /* 0: nothing to clear */
	struct lp_backoff clear;
};

struct lp_mcu {
	struct lp_connection base;
	struct lp_connections *connections;
	struct lp_mcu_user *users;
	char name[300]; /* "serial:/dev/ttyUSB0" */
	char object[308];
	struct lp_link *link;
	struct lp_timer tick;
	struct lp_mcu_settings settings;

	enum lp_mcu_state state;
	int64_t t_state_ns, t_next_ns, t_heard_ns, t_hello_ns, t_time_ns;
	struct lp_backoff retry; /* of opening */
	uint16_t boot_count;
	uint8_t protocol_minor; /* the microcontroller's */
	bool was_found;
	uint64_t reconnects;

	struct lp_link_clock clock;
	uint8_t time_count;
	int64_t time_sent_ns[256]; /* by count; 0: answered, or never asked */
	int64_t t_seen_ns;	   /* sending of the newest request that was answered */

	struct mcu_wheel_state_t wheel;
	bool wheel_waits; /* for the WheelTime that belongs to it */
	bool phase_known; /* the next three */
	struct mcu_wheel_time_t phase;
	int64_t t_phase_ns;

	struct mcu_ring0_t ring0;
	struct mcu_ring1_t ring1;
	bool ring_known;
	uint32_t ring_sequence;

	struct lp_mcu_recovery recovery;
};

/* Of a message of proto/mcu.dbc, as in struct lp_link_message. */
#define LP_MCU_CAN_BASE 0x500
#define LP_MCU_ID(NAME) ((uint8_t)(MCU_##NAME##_FRAME_ID - LP_MCU_CAN_BASE))

#define LP_MCU_SEND(mcu, name, NAME, signals)                                       \
	do {                                                                        \
		struct lp_link_message out = {.id = LP_MCU_ID(NAME),                \
					      .length_bytes = MCU_##NAME##_LENGTH}; \
		mcu_##name##_pack(out.payload, signals, sizeof(out.payload));       \
		(void)(mcu)->link->ops->send((mcu)->link, &out);                    \
	} while (0)

/* A fault by name to every user; text NULL: it is over. */
void lp_mcu_report_fault(struct lp_mcu *mcu, const char *id, const char *text);

/* Of the session: the timer's, and the carrier's three (struct lp_link_host). */
void lp_mcu_tick(struct lp_timer *timer);
void lp_mcu_received(void *context, const struct lp_link_message *message, int64_t t_ns);
void lp_mcu_lost(void *context, const char *stage, const char *reason);
void lp_mcu_link_fault(void *context, const char *id, const char *text);
void lp_mcu_ask_time(struct lp_mcu *mcu);
void lp_mcu_ask_status(struct lp_mcu *mcu);
void lp_mcu_ask_wheel(struct lp_mcu *mcu);

/* What only counts once rates are set: before that it may be left over from before a reset. */
void lp_mcu_report(struct lp_mcu *mcu, const struct lp_link_message *message, int64_t t_ns);

/* Recovery (mcu_recovery.c): all latched faults by bit, those that came or went are told; clearing
 * them by time; a homing that succeeded; a connection that is lost; a Hello that tells a reset. */
void lp_mcu_set_faults(struct lp_mcu *mcu, uint32_t faults, int detail);
void lp_mcu_clear_faults(struct lp_mcu *mcu, int64_t now_ns);
void lp_mcu_wheel_settled(struct lp_mcu *mcu);
void lp_mcu_forget_wheel_faults(struct lp_mcu *mcu);
void lp_mcu_was_reset(struct lp_mcu *mcu, uint8_t cause);

#endif
