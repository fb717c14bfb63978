/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A last act on a device, for when this program has died. A servo hat goes on sending its last
 * pulse for ever; a process of its own waits for the end of this one, however it comes about, and
 * acts then. Only a cut of the power, or killing that process too, escapes it.
 */
#ifndef LP_WHEEL_GUARD_H
#define LP_WHEEL_GUARD_H

#include <stdint.h>

/*
 * `act` runs in the other process, with a copy of all memory as it is now: async-signal-safe calls
 * only. `device_fd` stays open there. Returns the descriptor that holds it back, 0 or more, or
 * -errno.
 */
int lp_guard_start(int device_fd, void (*act)(int device_fd, const void *context),
		   const void *context);

/* Lets it act, and end, now. Does nothing for a negative descriptor. */
void lp_guard_release(int guard_fd);

#endif
