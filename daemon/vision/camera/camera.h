/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Where a pixel looks, and what its value means: projection, orientation, roll-off and response of
 * a camera. Equirectangular pictures, one or more fisheye lenses on one picture (Kannala & Brandt
 * 2006), an ordinary camera (vision/ball/pinhole.h), or a mirror ball that such a one sees
 * (vision/ball/ball.h).
 *
 * Pixel coordinates: x to the right, y down, (0, 0) the upper left corner of the picture, so the
 * centre of the first pixel is (0.5, 0.5). Lens frame: +X right, +Y up, -Z along the optical axis.
 */
#ifndef LP_VISION_CAMERA_CAMERA_H
#define LP_VISION_CAMERA_CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "include/crop.h"
#include "vision/ball/ball.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LP_MAX_LENSES 4
#define LP_MAX_STUCK_PIXELS 4096

struct lp_lens {
	float cx_px, cy_px; /* where the optical axis meets the picture */
	float fx_px,
		fy_px; /* r = f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9), t from the axis in rad */
	float k[4];
	float max_theta_rad;  /* nothing is seen beyond */
	float rotation[3][3]; /* lens frame to probe frame */
	float rolloff[3];     /* relative illumination 1 + a1 t^2 + a2 t^4 + a3 t^6 */
	uint8_t *mask;	      /* picture-sized, 0 = not usable; NULL: none */
};

enum lp_projection { LP_EQUIRECT, LP_FISHEYE, LP_BALL, LP_PINHOLE };

/* Veiling glare: shares of all light of a lens' picture. */
struct lp_glare_shares {
	float even;	 /* spread over its picture evenly */
	float around;	 /* spread around where it comes from: (1 + (angle / width)^2)^-1.5 */
	float width_deg; /* of that; > 0 where `around` is */
};

struct lp_camera {
	char name[64];
	enum lp_projection projection;
	int width_px, height_px; /* that the lens numbers refer to; 0: any (equirect) */
	struct lp_crop crop;	 /* LP_EQUIRECT: what of the sphere the picture shows */
	bool crop_given;	 /* by the camera file; of lenses, always */
	int lens_count;
	struct lp_lens lens[LP_MAX_LENSES]; /* LP_BALL: of the first, rotation and mask count;
					     * LP_PINHOLE: the first, but for centre and k */
	struct lp_pinhole pinhole;	    /* or, of LP_BALL, the camera that sees the ball */
	struct lp_ball ball;
	float (*stuck_px)[2]; /* pixels that shine by themselves: the left upper corner of each */
	int stuck_count;
	struct lp_glare_shares glare;
	bool response_given;
	float response[3][256]; /* linear value 0..1 of each 8-bit code */
};

struct lp_camera_file;

/* The camera that a file (vision/camera/camera_file.h) describes, with the masks and the response
 * table that it names. NULL: equirectangular. -ENOMEM, -ENOENT, -EBADMSG: logged, with the file. */
int lp_camera_create(const struct lp_camera_file *file, struct lp_camera **camera);
void lp_camera_destroy(struct lp_camera *camera); /* accepts NULL */

/*
 * Pixel that sees `direction` (unit, probe frame) through `lens`, for a picture of width_px x
 * height_px; false when the lens does not see it. *share: how much of this direction's light to
 * take from this lens; the shares of all lenses that see it sum to 1 after division by their sum.
 * *illumination: relative illumination there, by which radiance is to be divided.
 */
bool lp_camera_project(const struct lp_camera *camera, int lens, int width_px, int height_px,
		       const double direction[3], double pixel[2], double *share,
		       double *illumination);

/* Direction that pixel (x, y) looks along, through the lens it belongs to; false: through none. */
bool lp_camera_ray(const struct lp_camera *camera, int width_px, int height_px, double x, double y,
		   double direction[3], int *lens);

/* 1 sigma of `direction` (unit, probe frame) by what the camera file says of pose and outline of a
 * ball, in degrees; 0 of other cameras. */
double lp_camera_pointing_sigma_deg(const struct lp_camera *camera, const float direction[3]);

/* Sine of the angle from straight up of a row of a picture of which each row is level; else 1. */
double lp_camera_row_sine(const struct lp_camera *camera, int height_px, double y);

/* Equirectangular, and all of the sphere: rows go around, and every direction is seen. */
static inline bool lp_camera_is_whole(const struct lp_camera *camera)
{
	return camera->projection == LP_EQUIRECT && lp_crop_is_whole(&camera->crop) &&
	       !camera->lens[0].mask;
}

/* Angle from straight up of a row of an equirectangular picture, y in 0 .. height_px. */
static inline double lp_camera_row_rad(const struct lp_camera *camera, int height_px, double y)
{
	return 3.14159265358979323846 *
	       ((double)camera->crop.top + (double)camera->crop.height * y / height_px);
}

/* Angle of a column from the picture's left edge of the whole sphere, x in 0 .. width_px. */
static inline double lp_camera_column_rad(const struct lp_camera *camera, int width_px, double x)
{
	return 2.0 * 3.14159265358979323846 *
	       ((double)camera->crop.left + (double)camera->crop.width * x / width_px);
}

/* Whether a picture of this size, scaled, may be the camera's: its shape is that of the size that
 * the camera file was measured at, within 1 % (encoders round heights up). What shows the whole
 * sphere may have any size. */
bool lp_camera_has_shape(const struct lp_camera *camera, int width_px, int height_px);

/* Width of the panorama whose pixels at the horizon are as small as those of a picture of width_px
 * on the axis of the first lens. */
int lp_camera_circle_px(const struct lp_camera *camera, int width_px);

/* Angle across a typical pixel of a picture of that size, in rad. */
double lp_camera_pixel_rad(const struct lp_camera *camera, int width_px, int height_px);

/* Solid angle of the pixel whose centre is (x, y), in sr; 0 where nothing is seen. */
double lp_camera_pixel_solid_angle_sr(const struct lp_camera *camera, int width_px, int height_px,
				      double x, double y);

#ifdef __cplusplus
}
#endif

#endif
