/* SPDX-License-Identifier: Apache-2.0 */
/* Which exposure a frame had, by what it shows: lp_imager_match(). */
#include <math.h>

#include "include/luminance.h"
#include "light/grid.h"
#include "vision/imager_internal.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* Every so many cells is compared: enough for a mean. */
#define STEP 5
/* Linear values below this, of full scale, are within a camera's noise: they are all alike, and
 * tell nothing when longer exposures are predicted from them. */
#define LEAST_LINEAR 0.002F

/* From this difference on it is looked whether the lens is covered. */
#define DOUBTFUL_CODES 4.0F

/* Of a square-root response, 0..1, between noise and full scale. */
static float code_of(float linear)
{
	return sqrtf(fminf(fmaxf(linear, LEAST_LINEAR), 1.0F));
}

/* cover: what is left out; NULL: nothing. */
static struct lp_exposure_match compare(const struct lp_imager *imager, float exposure_us,
					const struct lp_cover_view *view,
					const struct lp_cover *cover)
{
	const struct lp_cells *cells = &imager->eye->incoming.cells;
	const struct lp_radiance_map *map = imager->map;
	const int count = imager->grid->width * imager->grid->height;
	struct lp_exposure_match match = {.difference_codes = NAN};
	float least_known = INFINITY;
	double sum = 0.0;
	int compared = 0, looked_at = 0;

	/* what the longest exposure so far could just make out */
	for (int k = 0; k < LP_MAX_BRACKET; k++)
		if (imager->eye->recent[k].serial)
			least_known =
				fminf(least_known,
				      LEAST_LINEAR * 1e6F / imager->eye->recent[k].exposure_us);
	for (int i = 0; i < count; i += STEP, looked_at++) {
		const int seen = lp_cover_seen_cell(view, i);
		const float observed = imager->eye->seen.cells[seen][LP_LUMINANCE] / cells->scale;
		const float known = map->radiance[i][LP_LUMINANCE];
		const float predicted = known * exposure_us * 1e-6F;

		if (((map->flags[i] | imager->eye->seen.flags[seen]) & LP_CELL_UNSEEN) ||
		    (cover && cover->near[lp_cover_block(imager->grid->width, seen)]))
			continue;
		/* a clipped cell is known to be bright, not how bright */
		if (((map->flags[i] & LP_CELL_CLIPPED) && predicted < 1.0F) ||
		    (known < least_known && predicted > LEAST_LINEAR))
			continue;
		sum += fabsf(code_of(predicted) - code_of(observed));
		compared++;
	}
	if (compared)
		match.difference_codes = (float)(255.0 * sum / compared);
	match.compared = (float)compared / (float)looked_at;
	return match;
}

struct lp_exposure_match lp_imager_match(const struct lp_imager *imager, float exposure_us)
{
	if (!imager->loaded || !imager->t_map_ns || isnan(imager->eye->incoming.cells.mean_code))
		return (struct lp_exposure_match){.difference_codes = NAN};
	const struct lp_cover_view view = lp_imager_cover_view(imager, exposure_us);
	const struct lp_exposure_match match = compare(imager, exposure_us, &view, NULL);

	if (!imager->eye->cover.found && !(match.difference_codes > DOUBTFUL_CODES))
		return match;
	/* a hand before the lens says nothing of the exposure */
	const struct lp_cover cover = lp_cover_look(&imager->eye->cover, &view);

	return cover.found ? compare(imager, exposure_us, &view, &cover) : match;
}
