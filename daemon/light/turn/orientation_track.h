/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The last orientations that a sensor or an app told, and what they say of any instant: between
 * two of them by the shortest turn (slerp), a little beyond the newest by its rate. Rates of a
 * gyroscope are added up to orientations against an arbitrary frame. Plain data; zeroed is a new
 * one. One thread.
 */
#ifndef LP_LIGHT_TURN_ORIENTATION_TRACK_H
#define LP_LIGHT_TURN_ORIENTATION_TRACK_H

#include <stdbool.h>
#include <stdint.h>

#include "include/orientation.h"
#include "light/math/rotation.h"

#define LP_TRACK_POINTS 128 /* a quarter of a second of the fastest sensors */
/* What is older than the newest sample by more than this is not known. */
#define LP_TRACK_MOST_PREDICTED_NS (50 * INT64_C(1000000))

struct lp_track_point {
	int64_t t_ns;
	struct lp_rotation rotation; /* body to the frame that does not move */
	double rate_rad_s[3];	     /* TURN_RATE only */
	double variance;	     /* rad^2, about each axis, of its own */
	double time_sigma_s;
	double walk; /* rad^2: what has been added up; two points differ by its difference */
	double position_m[3], position_sigma_m; /* sigma 0: not told */
};

struct lp_orientation_track {
	struct lp_track_point points[LP_TRACK_POINTS];
	uint64_t count; /* ever; the newest is at (count - 1) % LP_TRACK_POINTS */
};

/* What is told of one instant. */
struct lp_track_reading {
	struct lp_rotation rotation;
	/* Between two readings: sqrt(variance a + variance b + difference of walk). */
	double variance, walk;
	/* Of the body, in the frame that does not move; sigma 0: not known. */
	double position_m[3], position_sigma_m;
};

/*
 * 0: it is kept. -EINVAL: a number is not finite or above 1e9, a sigma is not above 0, or the
 * quaternion is no rotation. -ESTALE: it is not newer than the last one. Neither changes anything.
 */
int lp_orientation_track_add(struct lp_orientation_track *track,
			     const struct lp_orientation_sample *sample);

/* Forget everything: another sensor or app tells from now on. */
void lp_orientation_track_clear(struct lp_orientation_track *track);

/* Whether nothing goes from a to b in that time, whose places are known so well: another unit, or a
 * world that jumps. */
bool lp_track_jumps(const double a_m[3], const double b_m[3], double sigma_m, double span_s);

/*
 * 0: `reading` is filled. -ENODATA: nothing was told of that time: it is before all that is kept,
 * or in a gap. -EAGAIN: it is too far beyond the newest; later samples may tell.
 */
int lp_orientation_track_at(const struct lp_orientation_track *track, int64_t t_ns,
			    struct lp_track_reading *reading);

#endif
