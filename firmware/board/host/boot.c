/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/boot.h"

struct boot boot_after(enum boot_loader loader, uint8_t mcusr)
{
	bool external = mcusr & BOOT_EXTERNAL;
	struct boot boot = {.mcusr = mcusr};

	switch (loader) {
	case BOOT_NONE:
		break;
	case BOOT_ATMEGABOOT:
		boot.waits = true;
		boot.hangs = mcusr & BOOT_WATCHDOG; /* it does not stop the watchdog */
		break;
	case BOOT_OPTIBOOT_4_4:
		boot.waits = external;
		boot.mcusr = 0;
		break;
	case BOOT_OPTIBOOT_4_6: /* after the wait its watchdog resets the chip once more */
		boot.waits = external;
		boot.mcusr = 0;
		boot.r2_set = true;
		boot.r2 = external ? BOOT_WATCHDOG : mcusr;
		break;
	case BOOT_OPTIBOOT_7:
		boot.waits = external;
		boot.r2_set = true;
		boot.r2 = external ? BOOT_EXTERNAL | BOOT_WATCHDOG : mcusr;
		break;
	}
	return boot;
}
