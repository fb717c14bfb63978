/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/ball/ball.h"

#include <complex.h>
#include <math.h>
#include <string.h>

#include "light/linear/vector.h"

/* Steps of Newton's method, which converges in about five. */
#define MOST_STEPS 30
#define CLOSE_ENOUGH 1e-13

/* `along` x a + `across` x the unit vector of b's part that is square to a. */
static void combine(const double a[3], double along, const double b[3], double across,
		    double out[3])
{
	const double on = lp_dot(a, b);
	double rest[3], length;

	for (int k = 0; k < 3; k++)
		rest[k] = b[k] - on * a[k];
	length = sqrt(lp_dot(rest, rest));
	for (int k = 0; k < 3; k++)
		out[k] = along * a[k] + (length > 1e-15 ? across * rest[k] / length : 0.0);
}

bool lp_ball_init(struct lp_ball *ball, const struct lp_pinhole *pinhole, const double centre[3],
		  double radius, double rim_px)
{
	const double distance = sqrt(lp_dot(centre, centre));
	const double focal_px = sqrt(pinhole->fx_px * pinhole->fy_px);
	double outline, rim;

	memset(ball, 0, sizeof(*ball));
	if (!(radius > 0.0) || !(distance > radius) || !(centre[2] < 0.0))
		return false;
	for (int a = 0; a < 3; a++)
		ball->axis[a] = centre[a] / distance;
	ball->ratio = radius / distance;
	/* A pixel off the optical axis is smaller, by the cosine, along the outline's short axis.
	 */
	outline = asin(ball->ratio);
	ball->radius_px = focal_px * outline / -ball->axis[2];
	rim = outline - rim_px * -ball->axis[2] / focal_px;
	if (!(rim > 0.0))
		return false;
	ball->rim_sine = sin(rim) / ball->ratio;
	return true;
}

/* Incidence of the light that comes at the angle theta from the reverse of the axis: the root of
 * 2 i - asin(ratio sin i) = theta by Newton's method; the left side grows by 1 or more. */
static double incidence_of(double ratio, double theta)
{
	double i = 0.5 * theta;

	for (int n = 0; n < MOST_STEPS; n++) {
		const double s = ratio * sin(i);
		const double slope = 2.0 - ratio * cos(i) / sqrt(1.0 - s * s);
		const double step = (2.0 * i - asin(s) - theta) / slope;

		i -= step;
		if (fabs(step) < CLOSE_ENOUGH)
			break;
	}
	return i;
}

double lp_ball_reflectance(double index, double extinction, double cosine)
{
	/* Fresnel's equations with a complex index (Born & Wolf, Principles of Optics, 14.2) */
	const double complex n = index - extinction * I;
	const double complex inside = csqrt(n * n - (1.0 - cosine * cosine));
	const double s = cabs((cosine - inside) / (cosine + inside));
	const double p = cabs((n * n * cosine - inside) / (n * n * cosine + inside));

	return 0.5 * (s * s + p * p);
}

bool lp_ball_project(const struct lp_ball *ball, const struct lp_pinhole *pinhole,
		     const double direction[3], double pixel[2], double *reflectance)
{
	const double theta = acos(fmax(-1.0, fmin(1.0, -lp_dot(direction, ball->axis))));
	const double i = incidence_of(ball->ratio, theta);
	double ray[3];

	/* A root beyond a right angle is behind the rim. */
	if (!(i <= 0.5 * M_PI) || sin(i) > ball->rim_sine)
		return false;
	const double alpha_sine = ball->ratio * sin(i);

	combine(ball->axis, sqrt(1.0 - alpha_sine * alpha_sine), direction, alpha_sine, ray);
	*reflectance = lp_ball_reflectance(ball->index, ball->extinction, cos(i));
	return lp_pinhole_project(pinhole, ray, pixel);
}

/* The ray (unit, camera frame) of a pixel, its angle alpha from the axis and the sine of the
 * incidence; false: it misses the ball, or meets its rim. */
static bool meets(const struct lp_ball *ball, const struct lp_pinhole *pinhole, double x, double y,
		  double ray[3], double *alpha, double *sine)
{
	lp_pinhole_ray(pinhole, x, y, ray);
	const double cosine = lp_dot(ray, ball->axis);

	*alpha = acos(fmax(-1.0, fmin(1.0, cosine)));
	*sine = sin(*alpha) / ball->ratio;
	return cosine > 0.0 && !(*sine > ball->rim_sine);
}

bool lp_ball_ray(const struct lp_ball *ball, const struct lp_pinhole *pinhole, double x, double y,
		 double direction[3])
{
	double ray[3], alpha, sine;

	if (!meets(ball, pinhole, x, y, ray, &alpha, &sine))
		return false;
	const double theta = 2.0 * asin(sine) - alpha;

	combine(ball->axis, -cos(theta), ray, sin(theta), direction);
	return true;
}

double lp_ball_pixel_sr(const struct lp_ball *ball, const struct lp_pinhole *pinhole, double x,
			double y)
{
	double ray[3], alpha, sine;

	if (!meets(ball, pinhole, x, y, ray, &alpha, &sine))
		return 0.0;
	const double i = asin(sine),
		     slope = 2.0 * lp_dot(ray, ball->axis) / (ball->ratio * cos(i)) - 1.0;
	const double around = alpha > 1e-6 ? sin(2.0 * i - alpha) / sin(alpha) : slope;
	const double pixel_sr = pow(-ray[2], 3.0) / (pinhole->fx_px * pinhole->fy_px);

	return pixel_sr * slope * around;
}

double lp_ball_sigma_deg(const struct lp_ball *ball, const double direction[3])
{
	const double theta = acos(fmax(-1.0, fmin(1.0, -lp_dot(direction, ball->axis))));
	const double i = incidence_of(ball->ratio, theta);
	const double sine = fmin(sin(i), ball->rim_sine), cosine = sqrt(1.0 - sine * sine);
	const double shift = 2.0 * ball->outline_px / ball->radius_px;
	/* outwards by the centre and by the radius; around by the centre alone */
	const double outwards = shift * sqrt(1.0 + sine * sine) / cosine;
	const double around = shift * cosine;

	return hypot(hypot(outwards, around) * 180.0 / M_PI, ball->rotation_deg);
}
