/* SPDX-License-Identifier: Apache-2.0 */
/* Names of the microcontroller's faults and what to do about them (proto/mcu_faults.toml). */
#ifndef LP_LINK_MCU_FAULTS_H
#define LP_LINK_MCU_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "dbc/mcu_faults.h"

struct lp_mcu_fault {
	const char *name;
	const char *words; /* what was seen: what to do */
	bool passes;	   /* the daemon may clear it; others stay until a person has */
};

/* By number; never NULL. */
const struct lp_mcu_fault *lp_mcu_fault(unsigned number);

/* Bits of the faults that release the servo, and of those that the daemon may clear. */
#define LP_MCU_WHEEL_FAULTS ((UINT32_C(1) << MCU_FAULTS_WHEEL_END) - 1)
uint32_t lp_mcu_passing_faults(void);

const char *lp_mcu_reset_cause(unsigned number);

#endif
