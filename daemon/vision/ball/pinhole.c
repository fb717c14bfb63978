/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/ball/pinhole.h"

#include <math.h>

#include "light/linear/vector.h"

/* Steps of the inverse of the distortion, which converges in about five. */
#define MOST_STEPS 30
#define CLOSE_ENOUGH 1e-13
/* A pixel whose ray is seen so far beside it has none. */
#define FOLDS_PX 0.1
/* Points looked at along each side of a picture, and rows and columns of them within it. */
#define LOOKS 32

/* Where a point at (x, y) of the plane one unit ahead is seen by a lens that distorts. */
static void distort(const double d[LP_PINHOLE_DISTORTION], double x, double y, double out[2])
{
	const double r2 = x * x + y * y;
	const double radial = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));

	out[0] = x * radial + 2.0 * d[2] * x * y + d[3] * (r2 + 2.0 * x * x);
	out[1] = y * radial + d[2] * (r2 + 2.0 * y * y) + 2.0 * d[3] * x * y;
}

bool lp_pinhole_project(const struct lp_pinhole *p, const double ray[3], double pixel[2])
{
	double at[2];

	if (!(ray[2] < -1e-6))
		return false;
	distort(p->distortion, -ray[0] / ray[2], ray[1] / ray[2], at); /* y down */
	pixel[0] = p->cx_px + p->fx_px * at[0];
	pixel[1] = p->cy_px + p->fy_px * at[1];
	return true;
}

void lp_pinhole_ray(const struct lp_pinhole *p, double x_px, double y_px, double ray[3])
{
	const double seen[2] = {(x_px - p->cx_px) / p->fx_px, (y_px - p->cy_px) / p->fy_px};
	double x = seen[0], y = seen[1], length;

	for (int i = 0; i < MOST_STEPS; i++) {
		double at[2];

		distort(p->distortion, x, y, at);
		x += seen[0] - at[0];
		y += seen[1] - at[1];
		if (fabs(seen[0] - at[0]) + fabs(seen[1] - at[1]) < CLOSE_ENOUGH)
			break;
	}
	length = sqrt(x * x + y * y + 1.0);
	ray[0] = x / length;
	ray[1] = -y / length;
	ray[2] = -1.0 / length;
}

double lp_pinhole_pixel_sr(const struct lp_pinhole *p, double x_px, double y_px)
{
	double left[3], right[3], top[3], bottom[3], normal[3];

	lp_pinhole_ray(p, x_px - 0.5, y_px, left);
	lp_pinhole_ray(p, x_px + 0.5, y_px, right);
	lp_pinhole_ray(p, x_px, y_px - 0.5, top);
	lp_pinhole_ray(p, x_px, y_px + 0.5, bottom);
	for (int a = 0; a < 3; a++) {
		right[a] -= left[a];
		bottom[a] -= top[a];
	}
	lp_cross(right, bottom, normal);
	return sqrt(lp_dot(normal, normal));
}

double lp_pinhole_most_rad(const struct lp_pinhole *p, int width_px, int height_px)
{
	double most = 0.0;

	for (int i = 0; i < (LOOKS + 1) * (LOOKS + 1); i++) {
		const double x = (double)width_px * (i % (LOOKS + 1)) / LOOKS;
		const double y = height_px * floor(i / (LOOKS + 1.0)) / LOOKS;
		double ray[3], seen[2];

		lp_pinhole_ray(p, x, y, ray);
		if (!lp_pinhole_project(p, ray, seen) ||
		    !(hypot(seen[0] - x, seen[1] - y) < FOLDS_PX))
			return 0.0;
		most = fmax(most, acos(-ray[2]));
	}
	return most;
}
