/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/lamp/cell_geometry.h"

#include <math.h>

#include "vision/camera/camera.h"
#include "vision/camera/remap.h"
#include "vision/imager_internal.h"

static struct lp_cell_geometry equirect_geometry(const struct lp_imager *imager, int column,
						 int row)
{
	const struct lp_camera *camera = imager->eye->camera;
	const struct lp_remap *remap = imager->eye->remap;
	struct lp_cell_geometry g = {.seen = true};
	double row_sin[2], row_cos[2], column_sin[2], column_cos[2];

	for (int k = 0; k < 2; k++) {
		const double theta = lp_camera_row_rad(camera, remap->height_px,
						       (double)(row + k) * remap->cell_px);
		const double lambda = lp_camera_column_rad(camera, remap->width_px,
							   (double)(column + k) * remap->cell_px) -
				      M_PI;

		row_sin[k] = sin(theta);
		row_cos[k] = cos(theta);
		column_sin[k] = sin(lambda);
		column_cos[k] = cos(lambda);
	}
	for (int k = 0; k < 4; k++) {
		g.corner[k][0] = row_sin[k / 2] * column_sin[k % 2];
		g.corner[k][1] = row_cos[k / 2];
		g.corner[k][2] = -row_sin[k / 2] * column_cos[k % 2];
	}
	if (camera->lens[0].mask) {
		double middle[3];
		int lens;

		g.seen = lp_camera_ray(camera, remap->width_px, remap->height_px,
				       (column + 0.5) * remap->cell_px,
				       (row + 0.5) * remap->cell_px, middle, &lens);
	}
	return g;
}

/* This lens's share of the light along `d`, over its illumination there. */
static double lens_share(const struct lp_imager *imager, int own, const double d[3])
{
	double pixel[2], share = 0.0, total = 0.0, illumination = 1.0;

	for (int lens = 0; lens < imager->eye->camera->lens_count; lens++) {
		double at, relative;

		if (!lp_camera_project(imager->eye->camera, lens, imager->eye->remap->width_px,
				       imager->eye->remap->height_px, d, pixel, &at, &relative))
			continue;
		total += at;
		if (lens == own) {
			share = at;
			illumination = relative;
		}
	}
	return total > 0.0 ? share / total / illumination : 0.0;
}

static struct lp_cell_geometry lens_geometry(const struct lp_imager *imager, int column, int row)
{
	const int side = imager->eye->remap->cell_px;
	const int width = imager->eye->remap->width_px, height = imager->eye->remap->height_px;
	const double x = (column + 0.5) * side, y = (row + 0.5) * side;
	struct lp_cell_geometry g = {.seen = true};
	double d[3];
	int lens;

	for (int k = 0; k < 4; k++)
		g.seen &= lp_camera_ray(imager->eye->camera, width, height, (column + k % 2) * side,
					(row + k / 2) * side, g.corner[k], &lens);
	g.seen &= lp_camera_ray(imager->eye->camera, width, height, x, y, d, &lens);
	if (g.seen)
		g.pixel_solid_angle_sr =
			lp_camera_pixel_solid_angle_sr(imager->eye->camera, width, height, x, y) *
			lens_share(imager, lens, d);
	return g;
}

struct lp_cell_geometry lp_cell_geometry(const struct lp_imager *imager, int column, int row)
{
	return imager->eye->camera->projection == LP_EQUIRECT
		       ? equirect_geometry(imager, column, row)
		       : lens_geometry(imager, column, row);
}

struct lp_row_geometry lp_row_geometry(const struct lp_cell_geometry *g, double v)
{
	struct lp_row_geometry row;

	for (int a = 0; a < 3; a++) {
		row.first[a] = (1.0 - v) * g->corner[0][a] + v * g->corner[2][a];
		row.along[a] = (1.0 - v) * g->corner[1][a] + v * g->corner[3][a] - row.first[a];
	}
	return row;
}
