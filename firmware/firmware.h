/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware's state: one static object in main.c, passed down. */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stdbool.h>
#include <stdint.h>

#include "board/board.h"
#include "link.h"
#include "params.h"
#include "ring.h"
#include "safe.h"
#include "wheel.h"

#define FIRMWARE_MAJOR 0
#define FIRMWARE_MINOR 1
#define FIRMWARE_PATCH 0
#define PROTOCOL_MAJOR 1
#define PROTOCOL_MINOR 3 /* 1: WheelRequest. 2: NOT_STORED. 3: WheelPulse */

struct firmware {
	struct board_info info;
	struct params params;
	struct safe safe;
	struct wheel wheel;
	struct ring ring;
	struct link link;

	uint32_t tick_us; /* of the last millisecond tick */
	uint32_t now_ms;

	/* What the host is owed and how often it wants more: messages.c. */
	uint8_t owed;
	bool host_known; /* Rates came since the reset */
	bool saving;	 /* a save was asked for and not yet answered */
	uint16_t wheel_ms, counters_ms, wheel_due_ms, counters_due_ms, hello_due_ms;
	uint8_t ring_counter, wheel_counter, fault_counter, rx_unknown;
	uint16_t rings_dropped;
};

/* Before and in the main loop. */
void firmware_start(struct firmware *firmware);
void firmware_poll(struct firmware *firmware);

#endif
