/* SPDX-License-Identifier: Apache-2.0 */
/* Bands of flicker across the newest frame (vision/doubt/banding.h). */
#include <math.h>

#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/camera/remap.h"
#include "vision/imager_internal.h"

/* Noisier cells tell nothing (relative); nor do those whose light has changed. */
#define MOST_NOISE 0.15F
#define MOST_RATIO 1.0F

static void add(struct lp_imager *imager, const struct lp_observation *frame, int cell, int seen,
		float row_s)
{
	struct lp_banding_samples *samples = &imager->band_samples;
	const float light = frame->radiance[seen][LP_LUMINANCE];
	const float known = imager->map->radiance[cell][LP_LUMINANCE];
	const float linear = light / frame->scale;

	if (imager->map->flags[cell] || frame->flags[seen] || !(light > 0.0F) || !(known > 0.0F) ||
	    linear > LP_BRIGHTEST_COMPARED)
		return;
	const float ratio = logf(light / known);
	const float noise2 = frame->code_variance / lp_response_weight(frame->response, linear) /
				     (linear * linear) +
			     imager->map->variance[cell] / (known * known);

	if (noise2 > MOST_NOISE * MOST_NOISE || fabsf(ratio) > MOST_RATIO)
		return;
	samples->t_s[samples->count] = (float)(seen / imager->grid->width) * row_s;
	samples->log_ratio[samples->count] = ratio;
	samples->weight[samples->count++] = 1.0F / (noise2 + LP_CELL_SIGMA * LP_CELL_SIGMA);
}

void lp_imager_look_for_bands(struct lp_imager *imager)
{
	const struct lp_observation frame = lp_imager_observation(imager);
	const struct lp_grid *grid = imager->grid;

	/* of other projections a cell does not tell its row */
	if (!(imager->eye->row_time_us > 0.0F) || !lp_camera_is_whole(imager->eye->camera) ||
	    !imager->t_map_ns || !(imager->eye->incoming.exposure_us < LP_BANDING_MOST_US))
		return;
	const struct lp_cover_view view = lp_imager_cover_view(imager, NAN);
	const float row_s = 1e-6F * imager->eye->row_time_us *
			    (float)imager->eye->remap->height_px / (float)grid->height;

	imager->band_samples.count = 0;
	for (int k = 0; k < imager->watched_count; k++)
		add(imager, &frame, imager->watched[k],
		    lp_cover_seen_cell(&view, imager->watched[k]), row_s);
	lp_banding_look(&imager->eye->banding, &imager->band_samples);
}
