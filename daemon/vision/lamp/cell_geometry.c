/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/lamp/cell_geometry.h"

#include <math.h>

#include "vision/camera/camera.h"
#include "vision/camera/remap.h"
#include "vision/imager_internal.h"

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

struct lp_cell_geometry lp_cell_geometry(const struct lp_imager *imager, int column, int row)
{
	const struct lp_camera *camera = imager->eye->camera;
	const int side = imager->eye->remap->cell_px;
	const int width = imager->eye->remap->width_px, height = imager->eye->remap->height_px;
	struct lp_cell_geometry g = {.seen = true};
	double middle[3];
	int lens;

	for (int k = 0; k < 4; k++)
		g.seen &= lp_camera_ray(camera, width, height, (column + k % 2) * side,
					(row + k / 2) * side, g.corner[k], &lens);
	g.seen &= lp_camera_ray(camera, width, height, (column + 0.5) * side, (row + 0.5) * side,
				middle, &lens);
	if (g.seen)
		g.share = lens_share(imager, lens, middle);
	return g;
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
