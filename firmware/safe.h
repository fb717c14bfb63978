/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Faults: latched until the host clears them, reported by name (proto/mcu_faults.toml). And the
 * stack guard. Faults below FAULT_WHEEL_END stop the wheel; the others only speak.
 */
#ifndef SAFE_H
#define SAFE_H

#include <stdbool.h>
#include <stdint.h>

#include "dbc/mcu_faults.h"

enum fault {
	FAULT_NONE = 0,
#define FAULT_ENUM(name, number) FAULT_##name = (number),
	MCU_FAULTS(FAULT_ENUM)
#undef FAULT_ENUM
		FAULT_COUNT,
	FAULT_WHEEL_END = MCU_FAULTS_WHEEL_END,
};

struct safe_fault {
	bool latched;
	bool unsent; /* the host has not been told of the latest change */
	int16_t detail;
	uint32_t t_us;
};

struct safe {
	struct safe_fault faults[FAULT_COUNT];
};

/* Latches the faults that `reset_cause` (board.h) names. */
void safe_init(struct safe *safe, uint8_t reset_cause);

/* Latches a fault; the first detail and time stay until it is cleared. */
void safe_latch(struct safe *safe, enum fault fault, int16_t detail);

/* The latched faults; clears those of a mask. Bit = fault number. */
uint32_t safe_latched(const struct safe *safe);
void safe_clear(struct safe *safe, uint32_t faults);

/* True when a fault that stops the wheel is latched. */
bool safe_wheel_stopped(const struct safe *safe);

/* Takes the next unreported change; FAULT_NONE when there is none. */
enum fault safe_next_report(struct safe *safe);

/* Once per main loop: resets the chip when the stack guard is gone. */
void safe_check_stack(void);

#endif
