/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/link/mcu_faults.h"

#include <stddef.h>

#include "base/macros.h"

#define ROW(number, name, passes, words) [number] = {name, words, passes},
static const struct lp_mcu_fault faults[32] = {MCU_FAULT_ROWS(ROW)};
#undef ROW
static const char *const reset_causes[] = {"cause unknown: the boot loader hides it",
					   "power on",
					   "reset pin, or the port was opened",
					   "brown-out",
					   "watchdog",
					   "stack",
					   "on request"};

const struct lp_mcu_fault *lp_mcu_fault(unsigned number)
{
	static const struct lp_mcu_fault newer = {
		"MCU_FAULT",
		"this fault belongs to newer firmware: install a newer lightprobe to see its name",
		false};

	return number < LP_COUNT(faults) && faults[number].name ? &faults[number] : &newer;
}

uint32_t lp_mcu_passing_faults(void)
{
	uint32_t passing = 0;

	for (unsigned i = 0; i < LP_COUNT(faults); i++)
		passing |= (uint32_t)faults[i].passes << i;
	return passing;
}

const char *lp_mcu_reset_cause(unsigned number)
{
	return reset_causes[number < LP_COUNT(reset_causes) ? number : 0];
}
