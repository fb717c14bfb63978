/* SPDX-License-Identifier: Apache-2.0 */
/* What the imager does not see: behind a hand before the lens (vision/doubt/cover.h), and where
 * only a camera looks that is away. */
#include <math.h>

#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"

/* What the map held before a hand came is true still. */
static void restore_covered(struct lp_imager *imager)
{
	const struct lp_residual residual = lp_imager_residual(imager);
	const int width = imager->grid->width;

	for (int i = 0; i < width * imager->grid->height; i++) {
		const int seen = lp_residual_seen(&residual, i);

		if (imager->eye->cover.near[lp_cover_block(width, seen)])
			lp_radiance_map_restore(imager->map, i, LP_COVER_COMES_S);
	}
}

void lp_imager_look_for_cover(struct lp_imager *imager)
{
	const double elapsed_s = lp_imager_eye_elapsed_s(imager);
	const struct lp_cover before = imager->eye->cover;

	if (isnan(imager->eye->incoming.cells.mean_code) || !imager->t_map_ns)
		return;
	const struct lp_residual residual = lp_imager_residual(imager);

	imager->eye->cover = lp_cover_look(&before, &residual, residual.seen.scale);
	imager->eye->covered_s = before.found && imager->eye->cover.found
					 ? imager->eye->covered_s + (float)elapsed_s
					 : 0.0F;
	if (before.found || imager->eye->cover.found)
		lp_cover_mark(&imager->eye->cover, imager->grid, imager->eye->seen.flags);
	if (imager->eye->cover.found && !before.found)
		restore_covered(imager);
}

/* Share of the light that is known where the lens is covered. */
static float covered_light(const struct lp_imager *imager)
{
	const struct lp_residual residual = lp_imager_residual(imager);
	const struct lp_grid *grid = imager->grid;
	double covered = 0.0, all = 0.0;

	for (int i = 0; i < grid->width * grid->height; i++) {
		const double light = (double)imager->map->radiance[i][LP_LUMINANCE] *
				     lp_grid_solid_angle_sr(grid, i);

		all += light;
		if (imager->eye->cover
			    .near[lp_cover_block(grid->width, lp_residual_seen(&residual, i))])
			covered += light;
	}
	return all > 0.0 ? (float)(covered / all) : 0.0F;
}

/* What only cameras see that are away: its share of the light that is known. */
static void weigh_lost(struct lp_imager *imager)
{
	const struct lp_residual residual = lp_imager_residual(imager);
	const struct lp_grid *grid = imager->grid;
	const struct lp_eye *live[LP_MAX_CAMERAS];
	double hidden = 0.0, all = 0.0;
	int count = 0;

	imager->lost.share = 0.0F;
	imager->lost.view = false;
	for (int k = 0; k < imager->eye_count; k++)
		if (!imager->eyes[k].lost)
			live[count++] = &imager->eyes[k];
	if (count == imager->eye_count)
		imager->lost.since_ns = 0;
	else if (!imager->lost.since_ns) /* also of one that was away before this imager was made */
		imager->lost.since_ns = imager->t_capture_ns;
	for (int i = 0; i < grid->width * grid->height && count < imager->eye_count; i++) {
		const double light = (double)imager->map->radiance[i][LP_LUMINANCE] *
				     lp_grid_solid_angle_sr(grid, i);
		const int seen = lp_residual_seen(&residual, i);
		bool is_seen = false;

		if (imager->map->flags[i] & LP_CELL_UNSEEN)
			continue;
		for (int k = 0; k < count; k++)
			is_seen |= lp_eye_sees(live[k], seen);
		all += light;
		hidden += is_seen ? 0.0 : light;
		imager->lost.view |= !is_seen;
	}
	imager->lost.share = all > 0.0 ? (float)(hidden / all) : 0.0F;
}

void lp_imager_weigh_hidden(struct lp_imager *imager)
{
	imager->eye->covered_share = imager->eye->cover.found ? covered_light(imager) : 0.0F;
	weigh_lost(imager);
}
