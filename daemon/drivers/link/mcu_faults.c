/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/link/mcu_faults.h"

#include <stddef.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* Numbers: Fault.fault of proto/mcu.dbc; unit/test_link_mcu.c compares them with the schema. */
static const struct lp_mcu_fault faults[32] = {
	[1] = {"WHEEL_STUCK", "the wheel does not follow: free it; servo's plug and supply?"},
	[2] = {"WHEEL_SLOW", "the wheel follows late: friction, or a weak supply?"},
	[3] = {"WHEEL_SLIP", "the wheel moved by itself: horn, gear, something touching it?"},
	[4] = {"WHEEL_TOO_FAST", "faster than anything real: the sensors' wiring, stray light?"},
	[5] = {"INDEX_NEVER", "no tooth was seen: the sensors' plug; does the wheel turn?"},
	[6] = {"INDEX_ALWAYS", "a sensor always sees a tooth: its plug, dirt?"},
	[7] = {"INDEX_PATTERN", "not the comb's pattern: one sensor dead or exchanged, horn off?"},
	[8] = {"INDEX_NOISE", "more changes than a wheel makes: cable, screening?"},
	[9] = {"FEEDBACK_OPEN", "the feedback voltage is at a rail: its plug?"},
	[10] = {"SUPPLY_LOW",
		"the supply is low: a supply of its own for the servo, thicker wires"},
	[16] = {"LDR_OPEN", "a light sensor is open: its plug?"},
	[17] = {"LDR_SHORTED", "a light sensor is shorted"},
	[18] = {"PARAMS_LOST",
		"both copies of the parameters are damaged: defaults hold; calibrate"},
	[19] = {"PARAMS_COPY_LOST", "one copy of the parameters is damaged: save them"},
	[20] = {"CAN_ABSENT", "the CAN controller does not answer: its wiring?"},
	[21] = {"CAN_BUS_OFF", "the CAN bus was off: wiring, terminators, bit rate?"},
	[22] = {"I2C_BUS", "an error on the I2C bus: pull-ups, length?"},
	[23] = {"RESET_BROWN_OUT", "the supply broke down: a supply of its own for the servo"},
	[24] = {"RESET_WATCHDOG", "the firmware hung and was reset: report it"},
	[25] = {"RESET_STACK", "the firmware's stack overflowed: report it"},
};
static const char *const reset_causes[] = {"cause unknown", "power on", "reset pin", "brown-out",
					   "watchdog",	    "stack",	"on request"};

const struct lp_mcu_fault *lp_mcu_fault(unsigned number)
{
	static const struct lp_mcu_fault newer = {"MCU_FAULT",
						  "a fault of newer firmware: install a newer "
						  "lightprobe to know its name"};

	return number < COUNT(faults) && faults[number].name ? &faults[number] : &newer;
}

const char *lp_mcu_reset_cause(unsigned number)
{
	return reset_causes[number < COUNT(reset_causes) ? number : 0];
}
