/* SPDX-License-Identifier: Apache-2.0 */
#include "safe.h"

#include "board/board.h"

void safe_init(struct safe *safe, uint8_t reset_cause)
{
	if (reset_cause == RESET_CAUSE_BROWN_OUT)
		safe_latch(safe, FAULT_RESET_BROWN_OUT, 0);
	if (reset_cause == RESET_CAUSE_WATCHDOG)
		safe_latch(safe, FAULT_RESET_WATCHDOG, 0);
	if (reset_cause == RESET_CAUSE_STACK)
		safe_latch(safe, FAULT_RESET_STACK, 0);
}

void safe_latch(struct safe *safe, enum fault number, int16_t detail)
{
	struct safe_fault *fault = &safe->faults[number];

	if (fault->latched)
		return;
	fault->latched = true;
	fault->unsent = true;
	fault->detail = detail;
	fault->t_us = board_time_us();
}

uint32_t safe_latched(const struct safe *safe)
{
	uint32_t faults = 0;

	for (uint8_t i = FAULT_COUNT; i-- > 0;)
		faults = faults << 1 | safe->faults[i].latched;
	return faults;
}

void safe_clear(struct safe *safe, uint32_t faults)
{
	for (uint8_t i = 0; i < FAULT_COUNT; i++, faults >>= 1) {
		struct safe_fault *fault = &safe->faults[i];
		if (faults & 1 && fault->latched) {
			fault->latched = false;
			fault->unsent = true;
		}
	}
}

bool safe_wheel_stopped(const struct safe *safe)
{
	for (uint8_t i = 0; i < FAULT_WHEEL_END; i++) {
		if (safe->faults[i].latched)
			return true;
	}
	return false;
}

enum fault safe_next_report(struct safe *safe)
{
	for (uint8_t i = 0; i < FAULT_COUNT; i++) {
		if (safe->faults[i].unsent) {
			safe->faults[i].unsent = false;
			return i;
		}
	}
	return FAULT_NONE;
}

void safe_check_stack(void)
{
	if (!board_stack_ok())
		board_reset(RESET_CAUSE_STACK);
}
