/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/camera.h"

#include <math.h>
#include <stdlib.h>

/* What rounding may take from the angle of a picture's corner. */
#define ROUNDING_RAD 1e-6
/* By how much the shape of a camera's pictures may differ from that of its file. */
#define MOST_OFF 0.01

void lp_camera_destroy(struct lp_camera *camera)
{
	if (!camera)
		return;
	for (int k = 0; k < camera->lens_count; k++)
		free(camera->lens[k].mask);
	free(camera->stuck_px);
	free(camera);
}

bool lp_camera_has_shape(const struct lp_camera *camera, int width_px, int height_px)
{
	const double as_wide = (double)camera->height_px * width_px;
	const bool whole = camera->projection == LP_EQUIRECT && !camera->crop_given;

	return whole || fabs(as_wide - (double)camera->width_px * height_px) < MOST_OFF * as_wide;
}

int lp_camera_circle_px(const struct lp_camera *camera, int width_px)
{
	if (camera->projection == LP_EQUIRECT)
		return (int)((float)width_px / camera->crop.width);
	if (camera->projection == LP_BALL) /* in its middle, a pixel is 2 / radius across */
		return (int)(M_PI * camera->ball.radius_px * width_px / camera->width_px);
	return (int)(2.0 * M_PI * (double)camera->lens[0].fx_px * width_px / camera->width_px);
}

double lp_camera_pixel_rad(const struct lp_camera *camera, int width_px, int height_px)
{
	if (camera->projection == LP_BALL)
		return 2.0 * camera->width_px / (camera->ball.radius_px * width_px);
	if (camera->projection == LP_PINHOLE)
		return camera->width_px / (camera->pinhole.fx_px * width_px);
	return sqrt(4.0 * M_PI / ((double)width_px * height_px));
}

/* From the probe frame to that of the lens. */
static void to_lens(const struct lp_lens *lens, const double direction[3], double d[3])
{
	for (int a = 0; a < 3; a++)
		d[a] = lens->rotation[0][a] * direction[0] + lens->rotation[1][a] * direction[1] +
		       lens->rotation[2][a] * direction[2];
}

/* And back. */
static void to_probe(const struct lp_lens *lens, const double d[3], double direction[3])
{
	for (int a = 0; a < 3; a++)
		direction[a] = lens->rotation[a][0] * d[0] + lens->rotation[a][1] * d[1] +
			       lens->rotation[a][2] * d[2];
}

double lp_camera_pointing_sigma_deg(const struct lp_camera *camera, const float direction[3])
{
	const double given[3] = {direction[0], direction[1], direction[2]};
	double d[3];

	if (camera->projection != LP_BALL)
		return 0.0;
	to_lens(&camera->lens[0], given, d);
	return lp_ball_sigma_deg(&camera->ball, d);
}

double lp_camera_row_sine(const struct lp_camera *camera, int height_px, double y)
{
	return camera->projection == LP_EQUIRECT ? sin(lp_camera_row_rad(camera, height_px, y))
						 : 1.0;
}

static double polynomial(const struct lp_lens *lens, double theta)
{
	const double t2 = theta * theta;

	return theta *
	       (1.0 + t2 * (lens->k[0] + t2 * (lens->k[1] + t2 * (lens->k[2] + t2 * lens->k[3]))));
}

static double slope(const struct lp_lens *lens, double theta)
{
	const double t2 = theta * theta;

	return 1.0 +
	       t2 * (3.0 * lens->k[0] +
		     t2 * (5.0 * lens->k[1] + t2 * (7.0 * lens->k[2] + t2 * 9.0 * lens->k[3])));
}

/* Angle from the axis at normalised radius r, by Newton's method; negative when beyond the rim. */
static double theta_of(const struct lp_lens *lens, double r)
{
	double theta = r;

	if (r > polynomial(lens, lens->max_theta_rad))
		return -1.0;
	for (int i = 0; i < 20; i++) {
		const double step = (polynomial(lens, theta) - r) / slope(lens, theta);

		theta -= step;
		if (fabs(step) < 1e-12)
			break;
	}
	return theta >= 0.0 && theta <= lens->max_theta_rad ? theta : -1.0;
}

static double illumination_at(const struct lp_lens *lens, double theta)
{
	const double t2 = theta * theta;

	return 1.0 + t2 * (lens->rolloff[0] + t2 * (lens->rolloff[1] + t2 * lens->rolloff[2]));
}

/* Up to the picture's edges, which belong to it. */
static bool masked(const struct lp_camera *camera, const struct lp_lens *lens, double x, double y)
{
	if (!lens->mask)
		return false;
	const int column = (int)fmax(0.0, fmin(x, camera->width_px - 1));
	const int row = (int)fmax(0.0, fmin(y, camera->height_px - 1));

	return !lens->mask[(size_t)row * camera->width_px + column];
}

/* False: not in the part that the picture shows. */
static bool project_equirect(const struct lp_crop *crop, int width_px, int height_px,
			     const double d[3], double pixel[2])
{
	const double column = atan2(d[0], -d[2]) / (2.0 * M_PI) + 0.5 - (double)crop->left;
	const double row = acos(fmax(-1.0, fmin(1.0, d[1]))) / M_PI - (double)crop->top;
	const bool whole = lp_crop_is_whole(crop);

	pixel[0] = (whole ? column : column - floor(column)) / (double)crop->width * width_px;
	pixel[1] = row / (double)crop->height * height_px;
	return whole || (pixel[0] < width_px && pixel[1] >= 0.0 && pixel[1] < height_px);
}

static bool project_ball(const struct lp_camera *camera, int width_px, int height_px,
			 const double direction[3], double pixel[2], double *reflectance)
{
	const struct lp_lens *lens = &camera->lens[0];
	double d[3];

	to_lens(lens, direction, d);
	if (!lp_ball_project(&camera->ball, &camera->pinhole, d, pixel, reflectance) ||
	    pixel[0] < 0.0 || pixel[1] < 0.0 || pixel[0] >= camera->width_px ||
	    pixel[1] >= camera->height_px || masked(camera, lens, pixel[0], pixel[1]))
		return false;
	pixel[0] *= (double)width_px / camera->width_px;
	pixel[1] *= (double)height_px / camera->height_px;
	return true;
}

static bool project_pinhole(const struct lp_camera *camera, int width_px, int height_px,
			    const double direction[3], double pixel[2], double *illumination)
{
	const struct lp_lens *lens = &camera->lens[0];
	double d[3];

	to_lens(lens, direction, d);
	const double theta = atan2(hypot(d[0], d[1]), -d[2]);

	if (theta > (double)lens->max_theta_rad + ROUNDING_RAD ||
	    !lp_pinhole_project(&camera->pinhole, d, pixel) || pixel[0] < 0.0 || pixel[1] < 0.0 ||
	    pixel[0] >= camera->width_px || pixel[1] >= camera->height_px ||
	    masked(camera, lens, pixel[0], pixel[1]))
		return false;
	pixel[0] *= (double)width_px / camera->width_px;
	pixel[1] *= (double)height_px / camera->height_px;
	*illumination = illumination_at(lens, theta);
	return *illumination > 0.0;
}

bool lp_camera_project(const struct lp_camera *camera, int lens, int width_px, int height_px,
		       const double direction[3], double pixel[2], double *share,
		       double *illumination)
{
	const struct lp_lens *l = &camera->lens[lens];
	double d[3], theta, radius, x, y;

	*share = *illumination = 1.0;
	if (camera->projection == LP_EQUIRECT)
		return project_equirect(&camera->crop, width_px, height_px, direction, pixel) &&
		       !masked(camera, l, pixel[0] * camera->width_px / width_px,
			       pixel[1] * camera->height_px / height_px);
	if (camera->projection == LP_BALL)
		return project_ball(camera, width_px, height_px, direction, pixel, illumination);
	if (camera->projection == LP_PINHOLE)
		return project_pinhole(camera, width_px, height_px, direction, pixel, illumination);
	to_lens(l, direction, d);
	const double across = hypot(d[0], d[1]);

	theta = atan2(across, -d[2]);
	if (theta > l->max_theta_rad)
		return false;
	radius = across > 0.0 ? polynomial(l, theta) / across : 0.0;
	x = l->cx_px + l->fx_px * radius * d[0];
	y = l->cy_px - l->fy_px * radius * d[1];
	if (x < 0.0 || y < 0.0 || x >= camera->width_px || y >= camera->height_px ||
	    masked(camera, l, x, y))
		return false;
	pixel[0] = x * width_px / camera->width_px;
	pixel[1] = y * height_px / camera->height_px;
	/* where lenses overlap, each fades to nothing towards its rim */
	*share = l->max_theta_rad - theta + 1e-6;
	*illumination = illumination_at(l, theta);
	return *illumination > 0.0;
}

static void ray_equirect(const struct lp_camera *camera, int width_px, int height_px, double x,
			 double y, double d[3])
{
	const double theta = lp_camera_row_rad(camera, height_px, y);
	const double lambda = lp_camera_column_rad(camera, width_px, x) - M_PI;

	d[0] = sin(theta) * sin(lambda);
	d[1] = cos(theta);
	d[2] = -sin(theta) * cos(lambda);
}

static bool ray_ball(const struct lp_camera *camera, double x, double y, double direction[3])
{
	const struct lp_lens *lens = &camera->lens[0];
	double d[3];

	if (!lp_ball_ray(&camera->ball, &camera->pinhole, x, y, d) || masked(camera, lens, x, y))
		return false;
	to_probe(lens, d, direction);
	return true;
}

static bool ray_pinhole(const struct lp_camera *camera, double x, double y, double direction[3])
{
	const struct lp_lens *lens = &camera->lens[0];
	double d[3];

	lp_pinhole_ray(&camera->pinhole, x, y, d);
	if (d[2] > -cos((double)lens->max_theta_rad + ROUNDING_RAD) || masked(camera, lens, x, y))
		return false;
	to_probe(lens, d, direction);
	return true;
}

bool lp_camera_ray(const struct lp_camera *camera, int width_px, int height_px, double x, double y,
		   double direction[3], int *lens)
{
	double best = INFINITY;

	*lens = 0;
	if (camera->projection == LP_EQUIRECT) {
		ray_equirect(camera, width_px, height_px, x, y, direction);
		return !masked(camera, &camera->lens[0], x * camera->width_px / width_px,
			       y * camera->height_px / height_px);
	}
	x *= (double)camera->width_px / width_px;
	y *= (double)camera->height_px / height_px;
	if (camera->projection == LP_BALL)
		return ray_ball(camera, x, y, direction);
	if (camera->projection == LP_PINHOLE)
		return ray_pinhole(camera, x, y, direction);
	for (int k = 0; k < camera->lens_count; k++) { /* circles of lenses do not overlap */
		const struct lp_lens *l = &camera->lens[k];
		const double r = hypot((x - l->cx_px) / l->fx_px, (y - l->cy_px) / l->fy_px);

		if (r < best) {
			best = r;
			*lens = k;
		}
	}
	const struct lp_lens *l = &camera->lens[*lens];
	const double theta = theta_of(l, best);

	if (theta < 0.0 || masked(camera, l, x, y))
		return false;
	const double scale = best > 0.0 ? sin(theta) / best : 0.0;
	const double d[3] = {(x - l->cx_px) / l->fx_px * scale, -(y - l->cy_px) / l->fy_px * scale,
			     -cos(theta)};
	to_probe(l, d, direction);
	return true;
}

double lp_camera_pixel_solid_angle_sr(const struct lp_camera *camera, int width_px, int height_px,
				      double x, double y)
{
	if (camera->projection == LP_EQUIRECT)
		return 2.0 * M_PI * (double)camera->crop.width / width_px *
		       (cos(lp_camera_row_rad(camera, height_px, y - 0.5)) -
			cos(lp_camera_row_rad(camera, height_px, y + 0.5)));

	double d[3];
	int lens;

	if (!lp_camera_ray(camera, width_px, height_px, x, y, d, &lens))
		return 0.0;
	if (camera->projection == LP_BALL)
		return lp_ball_pixel_sr(&camera->ball, &camera->pinhole,
					x * camera->width_px / width_px,
					y * camera->height_px / height_px) *
		       camera->width_px / width_px * camera->height_px / height_px;
	if (camera->projection == LP_PINHOLE)
		return lp_pinhole_pixel_sr(&camera->pinhole, x * camera->width_px / width_px,
					   y * camera->height_px / height_px) *
		       camera->width_px / width_px * camera->height_px / height_px;
	/* area element: sin(theta) dtheta dphi = sin(theta) / (r r') dx dy / (fx fy), r, r' of
	 * theta */
	const struct lp_lens *l = &camera->lens[lens];
	const double sx = (double)camera->width_px / width_px;
	const double sy = (double)camera->height_px / height_px;
	const double r = hypot((x * sx - l->cx_px) / l->fx_px, (y * sy - l->cy_px) / l->fy_px);
	const double theta = theta_of(l, r);
	const double spread = theta > 1e-6 ? sin(theta) / (r * slope(l, theta)) : 1.0;

	return spread * sx * sy / ((double)l->fx_px * l->fy_px);
}
