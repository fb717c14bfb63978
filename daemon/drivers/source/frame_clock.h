/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Whether a camera's time stamps can be true, by when its frames arrive. A stamp is of
 * CLOCK_MONOTONIC, as the arrival is: a frame cannot arrive before it was read, and not long after,
 * unless nobody took frames meanwhile. How long its frames usually take is learned while its clock
 * is believed. Where it is not, the arrival less that time stands in, with a sigma. Pure logic;
 * zeroed is a new one. It outlives restarts of the stream, so that none hides a fault.
 */
#ifndef LP_SOURCE_FRAME_CLOCK_H
#define LP_SOURCE_FRAME_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

struct lp_frame;

#define LP_CLOCK_FLOORS 8

struct lp_frame_clock {
	bool has_frames;   /* what follows counts */
	uint64_t sequence; /* the highest, and its stamp */
	int64_t stamp_ns;
	int64_t arrival_ns; /* of the newest frame */
	int64_t tick_ns;    /* when `before_ns` was set */
	int64_t before_ns;  /* the arrival before that: frames since may have waited for us */
	int64_t t_late_ns;  /* since when all frames were late; 0: the newest was not */
	int64_t t_good_ns;  /* since when all stamps could be true; 0: the newest could not */
	int64_t good_ns;    /* the shortest delay since then */
	const char *fault;  /* static: why it is not believed; NULL: it is */

	/* The shortest delay in each of some spans of time, the oldest first; when all are full,
	 * the spans become twice as long. So what drifts shows, however slowly. */
	int64_t floors_ns[LP_CLOCK_FLOORS];
	int floor_count;
	int64_t span_ns, span_end_ns;
	double excess_ns2; /* mean square of what delays were longer than the first floor */
};

/*
 * Set t_read_ns, stamp_sigma_us and clock_fault of a frame whose other fields are set, by the stamp
 * that the camera gave it (CLOCK_MONOTONIC of the reading of its first row; any number; 0: none).
 * Logs once that the clock is not believed any more, or is again; `object` names the camera then.
 */
void lp_frame_clock_stamp(struct lp_frame_clock *clock, struct lp_frame *frame, int64_t stamp_ns,
			  const char *object);

#endif
