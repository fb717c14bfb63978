/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The usual camera, by OpenCV's model: where it sees a ray, and back. Camera frame: +X right, +Y
 * up, -Z along the optical axis. Pixels as in vision/camera/camera.h: the centre of the first is at
 * (0.5, 0.5), where OpenCV has (0, 0).
 */
#ifndef LP_VISION_BALL_PINHOLE_H
#define LP_VISION_BALL_PINHOLE_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LP_PINHOLE_DISTORTION 5

/* Radial and tangential distortion of a pinhole camera, as OpenCV has them: k1 k2 p1 p2 k3. */
struct lp_pinhole {
	double cx_px, cy_px, fx_px, fy_px;
	double distortion[LP_PINHOLE_DISTORTION];
};

/* The pixel of a ray (camera frame); false: it does not point ahead. Rays far outside of the
 * picture may come back into it, by the distortion: see lp_pinhole_most_rad(). */
bool lp_pinhole_project(const struct lp_pinhole *pinhole, const double ray[3], double pixel[2]);

/* The ray (unit, camera frame) of a pixel. */
void lp_pinhole_ray(const struct lp_pinhole *pinhole, double x_px, double y_px, double ray[3]);

/* Solid angle of the pixel around (x, y), in sr. */
double lp_pinhole_pixel_sr(const struct lp_pinhole *pinhole, double x_px, double y_px);

/* The largest angle from the axis, in rad, that a picture of this size shows. 0: somewhere in it
 * the distortion folds, and a pixel has no ray of its own. */
double lp_pinhole_most_rad(const struct lp_pinhole *pinhole, int width_px, int height_px);

#ifdef __cplusplus
}
#endif

#endif
