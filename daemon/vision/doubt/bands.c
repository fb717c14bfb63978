/* SPDX-License-Identifier: Apache-2.0 */
/* Bands of flicker across the newest frame (vision/doubt/banding.h). */
#include <math.h>

#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/camera/remap.h"
#include "vision/imager_internal.h"

/* Cells whose light has changed by more, as a logarithm, tell nothing. */
#define MOST_RATIO 1.0F

static void add(struct lp_imager *imager, const struct lp_residual *residual, int cell, float row_s)
{
	struct lp_banding_samples *samples = &imager->band_samples;
	const struct lp_radiance_map *map = residual->map;
	const float known = map->radiance[cell][LP_LUMINANCE];
	const int seen = lp_residual_seen(residual, cell);
	const struct lp_log_light light = lp_log_light(&residual->seen, seen, LP_LUMINANCE);
	const float ratio = light.log - logf(known);

	if (map->flags[cell] || !(known > 0.0F) || !(fabsf(ratio) <= MOST_RATIO)) /* also of NAN */
		return;
	samples->t_s[samples->count] = (float)(seen / imager->grid->width) * row_s;
	samples->log_ratio[samples->count] = ratio;
	samples->weight[samples->count++] =
		1.0F / (light.variance + map->variance[cell] / (known * known));
}

void lp_imager_look_for_bands(struct lp_imager *imager)
{
	const struct lp_grid *grid = imager->grid;

	/* of other projections a cell does not tell its row */
	if (!(imager->eye->row_time_us > 0.0F) || !lp_camera_is_whole(imager->eye->camera) ||
	    !imager->t_map_ns || !(imager->eye->incoming.exposure_us < LP_BANDING_MOST_US))
		return;
	const struct lp_residual residual = lp_imager_residual(imager);
	const float row_s = 1e-6F * imager->eye->row_time_us *
			    (float)imager->eye->remap->height_px / (float)grid->height;

	imager->band_samples.count = 0;
	for (int k = 0; k < imager->watched_count; k++)
		add(imager, &residual, imager->watched[k], row_s);
	lp_banding_look(&imager->eye->banding, &imager->band_samples);
}
