/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Keeps a latency goal, a budget of processor time, or both: lowers the preset by one step when a
 * window of time has missed them, and raises it again, up to the one that was chosen, after several
 * windows with room to spare; the more of them, the more often raising has failed. Pure logic on
 * times that it is told.
 */
#ifndef LP_APP_RUN_GOVERNOR_H
#define LP_APP_RUN_GOVERNOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LP_GOVERNOR_WINDOW_NS (2 * (int64_t)1000000000)

struct lp_governor_goals {
	float latency_ms;  /* frame arrival to packet handed out, of nine in ten; 0: any */
	float cpu_percent; /* of one core, the whole daemon; 0: any */
};

struct lp_governor {
	struct lp_governor_goals goals;
	int chosen, preset; /* steps of speed against accuracy; 0: the fastest */

	int64_t window_ns, window_cpu_ns; /* at the window's begin */
	int estimates, late, close;	  /* in it: all, beyond the goal, not far below it */
	bool settling;	 /* the preset has just changed: this window does not count */
	int spare;	 /* windows in a row with room to spare */
	int patience;	 /* so many are wanted before the preset is raised */
	int since_raise; /* windows; how soon raising turns out to be a mistake */
};

/* The preset begins as `chosen`. */
void lp_governor_init(struct lp_governor *governor, const struct lp_governor_goals *goals,
		      int chosen, int64_t now_ns, int64_t cpu_ns);

/* An estimate has been handed out, so long after its frame's arrival. */
void lp_governor_estimate(struct lp_governor *governor, int64_t latency_ns);

/*
 * Call it several times a second, with the processor time used so far. True: governor->preset has
 * changed, and `reason` says why. A window without estimates judges nothing.
 */
bool lp_governor_tick(struct lp_governor *governor, int64_t now_ns, int64_t cpu_ns, char *reason,
		      size_t reason_bytes);

/* The preset that it has changed to cannot be had: this one stays in force. */
void lp_governor_refused(struct lp_governor *governor, int preset);

#endif
