/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How the camera is turned against the anchor frame, and how fast it turns: a Kalman filter of
 * constant rate, the acceleration its noise. It holds exactly still until something shows that the
 * camera turns. Pure logic; zeroed and started with lp_motion_init(). Angles in radians, rates in
 * radians per second, in the camera's frame.
 */
#ifndef LP_LIGHT_TURN_MOTION_H
#define LP_LIGHT_TURN_MOTION_H

#include <math.h>
#include <stdbool.h>

#include "light/math/rotation.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Angular acceleration of a head, 1 sigma; and how fast it turns, 1 sigma. Radians and seconds. */
#define LP_HEAD_ACCELERATION (600.0 * M_PI / 180.0)
#define LP_HEAD_RATE (60.0 * M_PI / 180.0)

struct lp_motion {
	struct lp_rotation rotation; /* camera to anchor */
	double rate[3];
	double covariance[6][6]; /* of a rotation vector after `rotation`, and of the rate */
	bool turning;
	struct lp_rotation quiet_at; /* it has stayed near here for quiet_s */
	double quiet_s;
};

void lp_motion_init(struct lp_motion *motion);

/* The anchor frame is that of the camera from now on. */
void lp_motion_anchor(struct lp_motion *motion);

/* elapsed_s later: where the rate leads, or still the same place. */
void lp_motion_predict(struct lp_motion *motion, double elapsed_s);

/* The same where something else tells by which rotation vector it has turned meanwhile (camera
 * frame at the beginning), with `sigma_rad` about each axis: weighed against the rate. It turns. */
void lp_motion_predict_turn(struct lp_motion *motion, double elapsed_s, const double turn[3],
			    double sigma_rad);

/* Inverse covariance of the rotation, and the root mean square of its sigma over the axes. */
void lp_motion_prior(const struct lp_motion *motion, double information[3][3]);
double lp_motion_sigma_rad(const struct lp_motion *motion);
/* The rotation's covariance in the anchor frame, rad^2; 0 of a camera that holds still. */
void lp_motion_covariance(const struct lp_motion *motion, double covariance[3][3]);

/*
 * It has been seen that the camera is at rotation * exp(turn), which already weighs what was
 * predicted against the information (per rad^2) of the picture alone. Of a camera that holds still
 * only a turn beyond its uncertainty counts.
 */
void lp_motion_correct(struct lp_motion *motion, const double turn[3],
		       const double information[3][3]);

/* The smallest turn of a camera that holds still which information (per rad^2) of one picture would
 * show for certain, about the axis that it tells least of; more than a turn: none. */
double lp_motion_shown_turn_rad(const double information[3][3]);

/* The same as lp_motion_correct() from landmarks, of a camera that turns
 * (lp_lamp_memory_landmarks(), anchor frame). */
void lp_motion_correct_by_landmarks(struct lp_motion *motion, const double pull[3],
				    const double information[3][3]);

/* It has hardly turned for a while: the caller may anchor anew and hold still. */
bool lp_motion_at_rest(const struct lp_motion *motion);

#ifdef __cplusplus
}
#endif

#endif
