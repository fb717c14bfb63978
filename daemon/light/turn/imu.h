/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The IMU: what a gyroscope, or the head poses of an app, tell of how the camera is turned, and
 * whether it is used. Its frame of reference is turned against the anchor frame by a rotation that
 * nobody knows, but which stays: where it does not, the IMU contradicts the pictures and is left
 * out until it has agreed again for LP_IMU_AGREED_S. Plain data; zeroed is
 * a new one. One thread. Angles in radians.
 */
#ifndef LP_LIGHT_TURN_IMU_H
#define LP_LIGHT_TURN_IMU_H

#include <stdbool.h>
#include <stdint.h>

#include "light/math/rotation.h"

#define LP_IMU_AGREED_S 1.0

struct lp_motion;

/* Of one frame, at the middle of its exposure. */
struct lp_imu_sample {
	bool known;
	uint32_t by;		     /* who tells it, as a number */
	struct lp_rotation rotation; /* camera to the IMU's frame */
	double sigma_rad;	     /* about each axis */
};

#define LP_IMU_POINTS 4

/* How late it tells, by what pictures showed whenever the rate of the turn changed. */
struct lp_imu_delay {
	struct lp_imu_point {
		struct lp_rotation told, seen;
		double after_s;	 /* the point before */
	} points[LP_IMU_POINTS]; /* oldest first */
	int count;
	bool turned;		   /* at the newest frame */
	double steady_s;	   /* since the camera began to turn, or to hold still */
	double passed_s;	   /* since the newest point */
	double sum_s, information; /* of the delay: weighted sum, and inverse variance */
};

struct lp_imu {
	struct lp_imu_sample last; /* of the frame before */
	uint32_t by;		   /* whose samples all this is of */
	bool has_world;
	struct lp_rotation world; /* anchor frame to the IMU's, followed slowly */
	bool left_out;		  /* it contradicts the pictures */
	double agreed_s;	  /* since then, without a break */
	struct lp_imu_delay delay;
};

/* The next frame comes with this. Another IMU than before has another frame of reference, and
 * what was found out about the one before does not count against it. */
void lp_imu_take(struct lp_imu *imu, const struct lp_imu_sample *before,
		 const struct lp_imu_sample *now);

/* How the camera has turned since the frame before, in its own frame. False: that is not told, or
 * the IMU is left out. */
bool lp_imu_turn(const struct lp_imu *imu, const struct lp_imu_sample *now, double turn[3],
		 double *sigma_rad);

/* How a camera that seems to hold still at `still` (to the anchor frame) has turned since it does,
 * by what is told, in its own frame. False: that is not told, not used, or no more than its noise.
 */
bool lp_imu_turn_unseen(const struct lp_imu *imu, const struct lp_imu_sample *now,
			const struct lp_rotation *still, double turn[3], double *sigma_rad);

/* What is told as a measurement of `rotation` (to the anchor frame), for
 * lp_motion_correct_by_landmarks(): of a camera that sees too little at a time for pictures to tell
 * how its views lie beside each other. False as above. */
bool lp_imu_pull(const struct lp_imu *imu, const struct lp_imu_sample *now,
		 const struct lp_rotation *rotation, double pull[3], double information[3][3]);

/* Whether two rotations are further apart than what is told may be wrong by. */
bool lp_imu_is_apart(const struct lp_rotation *told, const struct lp_rotation *found,
		     double sigma_rad, double rate_rad_s);

/* The pictures show something else than it told of this frame. */
void lp_imu_contradict(struct lp_imu *imu);

/* The frame is done, `elapsed_s` after the one before: `motion` is what all together know. Pictures
 * may be turned by the camera's way: parallax_rad, 1 sigma. */
void lp_imu_compare(struct lp_imu *imu, const struct lp_imu_sample *now,
		    const struct lp_motion *motion, double parallax_rad, double elapsed_s);

/* 1 sigma of what it tells at this rate of the turn, from how late it may be: always as late looks
 * like another frame of reference, until the rate changes. */
double lp_imu_delay_sigma_rad(const struct lp_imu *imu, double rate_rad_s);

/* The anchor frame is that of the camera at `rotation` (camera to the old one) from now on. */
void lp_imu_anchor(struct lp_imu *imu, const struct lp_rotation *rotation);

#endif
