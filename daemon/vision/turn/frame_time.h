/* SPDX-License-Identifier: Apache-2.0 */
/* When a frame was exposed: what a camera that turns owes to each of its directions. */
#ifndef LP_VISION_TURN_FRAME_TIME_H
#define LP_VISION_TURN_FRAME_TIME_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_frame;

struct lp_frame_time {
	int64_t middle_ns; /* CLOCK_MONOTONIC: of the exposure of the middle row */
	float sigma_s;	   /* 1 sigma of it */
	float read_out_s;  /* from the reading of the first row to that of the last; 0: at once */
};

/*
 * The frame's time if it was exposed for exposure_us (NAN: unknown). An exposure or a row time that
 * nobody knows is anything between nothing and the frame's period: the middle of that range counts,
 * and its standard deviation is in sigma_s.
 */
struct lp_frame_time lp_frame_time(const struct lp_frame *frame, float exposure_us);

#ifdef __cplusplus
}
#endif

#endif
