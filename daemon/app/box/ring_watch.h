/* SPDX-License-Identifier: Apache-2.0 */
/* What the estimates say of the ring, as faults of health messages: told when it has lasted, and
 * taken back when it is over. Plain data; zeroed is a new one. Loop thread. */
#ifndef LP_APP_BOX_RING_WATCH_H
#define LP_APP_BOX_RING_WATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/ring/ring_stage.h"

struct lp_health;

enum {
	LP_RING_WATCH_SENSORS,
	LP_RING_WATCH_TURNED,
	LP_RING_WATCH_DISAGREES,
	LP_RING_WATCH_SCALE,
	LP_RING_WATCH_COVERED, /* the camera's lens; no fault of the ring */
	LP_RING_WATCHED
};

struct lp_ring_watch {
	struct {
		int64_t since_ns; /* when it was first so, or first not so any more */
		bool now, told;
	} list[LP_RING_WATCHED];
	uint32_t wrong; /* sensors named */
};

/* What this estimate alone says of the ring: RING_FAULT, or 0. For pictures that are no film. */
uint32_t lp_ring_watch_once(const struct lp_ring_status *status);

/* Of every estimate. Returns enum lp_estimate_flag: RING_FAULT while something is told. */
uint32_t lp_ring_watch_update(struct lp_ring_watch *watch, const struct lp_ring_status *status,
			      struct lp_health *health, int64_t now_ns);

#endif
