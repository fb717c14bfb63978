/* SPDX-License-Identifier: Apache-2.0 */
/* Names of the microcontroller's faults and what to do about them (docs/faults.md). */
#ifndef LP_LINK_MCU_FAULTS_H
#define LP_LINK_MCU_FAULTS_H

struct lp_mcu_fault {
	const char *name;
	const char *next_step;
};

/* By number; never NULL. */
const struct lp_mcu_fault *lp_mcu_fault(unsigned number);

const char *lp_mcu_reset_cause(unsigned number);

#endif
