/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A mirror ball that an ordinary camera sees: which way the light came that it mirrors to a pixel.
 *
 * Camera frame: +X right, +Y up, -Z along the optical axis, its origin the centre of the lens.
 * Everything about the ball turns about the line from the lens to its centre: a ray at the angle
 * alpha from that line meets the ball at the incidence i, sin i = D sin alpha / R, and comes from
 * the direction at the angle 2 i - alpha from the line's reverse.
 */
#ifndef LP_VISION_BALL_BALL_H
#define LP_VISION_BALL_BALL_H

#include <stdbool.h>

#include "vision/ball/pinhole.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lp_ball {
	double axis[3];	     /* unit, camera frame: towards the centre */
	double ratio;	     /* radius over distance, < 1 */
	double rim_sine;     /* largest sine of the incidence that is used */
	double index;	     /* refractive, of the surface */
	double extinction;   /* imaginary part of it: of metals; 0: of a clear or black surface */
	double radius_px;    /* of its outline, about */
	double outline_px;   /* 1 sigma of the outline's centre, each way, and of its radius */
	double rotation_deg; /* 1 sigma of the camera's rotation to the probe frame */
};

/*
 * The ball at `centre` (camera frame) with `radius` (the same unit, > 0). The outermost `rim_px`
 * pixels of its picture are not used. False: the lens is in the ball, the ball is not ahead, or
 * nothing is left of it. Sets all but the sigmas.
 */
bool lp_ball_init(struct lp_ball *ball, const struct lp_pinhole *pinhole, const double centre[3],
		  double radius, double rim_px);

/* Pixel whose light came from `direction` (unit, towards it, camera frame). *reflectance: the share
 * that the ball mirrors there. False: the ball does not show this direction. */
bool lp_ball_project(const struct lp_ball *ball, const struct lp_pinhole *pinhole,
		     const double direction[3], double pixel[2], double *reflectance);

/* Direction (unit, camera frame) that the light of pixel (x, y) came from; false: it shows no ball,
 * or its rim. */
bool lp_ball_ray(const struct lp_ball *ball, const struct lp_pinhole *pinhole, double x, double y,
		 double direction[3]);

/* Solid angle of the surroundings that the pixel around (x, y) mirrors, in sr; 0: none. */
double lp_ball_pixel_sr(const struct lp_ball *ball, const struct lp_pinhole *pinhole, double x,
			double y);

/* Share of unpolarized light that the surface mirrors at the cosine of the incidence. */
double lp_ball_reflectance(double index, double extinction, double cosine);

/* 1 sigma of a direction (unit, camera frame), in degrees, by what is not known of ball and camera:
 * the root mean square of the angle. Largest at the rim. */
double lp_ball_sigma_deg(const struct lp_ball *ball, const double direction[3]);

#ifdef __cplusplus
}
#endif

#endif
