/* SPDX-License-Identifier: Apache-2.0 */
#include "firmware.h"

int main(void)
{
	static struct firmware firmware;

	firmware_start(&firmware);
	for (;;) {
		firmware_poll(&firmware);
		board_idle();
	}
}
