/* SPDX-License-Identifier: Apache-2.0 */
/* What shines by itself in the imager's pictures. */
#include <math.h>
#include <stdio.h>

#include "base/clock.h"
#include "base/log.h"
#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"
#include "vision/map/lookup.h"

/* Places that a line of the log names. */
#define NAMED 16
/* None has come for so long. */
#define SETTLED_NS LP_NS_PER_S

static bool is_covered(const void *context, const float direction[3])
{
	const struct lp_imager *imager = context;
	const int cell = lp_grid_cell(imager->grid, direction);

	return imager->eye->cover.covered[lp_cover_block(imager->grid->width, cell)];
}

/* Of the cells about one, as a camera's cells lie across the panorama's. */
static float known(const void *context, const float direction[3])
{
	const struct lp_imager *imager = context;
	const int width = imager->grid->width, height = imager->grid->height;
	const int cell = lp_grid_cell(imager->grid, direction);
	float most = 0.0F;

	for (int down = -1; down <= 1; down++)
		for (int across = -1; across <= 1; across++) {
			const int row = cell / width + down;
			const int column = (cell % width + across + width) % width;

			if (row >= 0 && row < height)
				most = fmaxf(
					most,
					imager->map->radiance[row * width + column][LP_LUMINANCE]);
		}
	return most;
}

/* When no more have come for a while: at first, and once they are twice as many. */
static void tell(struct lp_stuck *stuck, int64_t now_ns, int camera)
{
	char places[NAMED * 14] = "";
	size_t used = 0;

	if (!stuck->count || stuck->count < 2 * stuck->told ||
	    now_ns - stuck->t_changed_ns < SETTLED_NS)
		return;
	for (int k = 0; k < stuck->count && k < NAMED; k++)
		used += (size_t)snprintf(
			places + used, sizeof(places) - used, "%s%d,%d", k ? " " : "",
			stuck->list[k] % stuck->columns * stuck->cell_px + stuck->cell_px / 2,
			stuck->list[k] / stuck->columns * stuck->cell_px + stuck->cell_px / 2);
	stuck->told = stuck->count;
	lp_info("camera", "pixels",
		"camera %d: %d places of the picture shine wherever it looks, and are left out: "
		"around the pixels %s%s; stuck pixels, or a light of the box itself before the "
		"lens (stuck_pixels in the camera file names them from the start)",
		camera, stuck->count, places, stuck->count > NAMED ? " ..." : "");
}

/* Cells that are new among those that are left out have taught the map something wrong. What lies
 * where any of them looks now is forgotten: in a row of them, one cell's place was another's. */
static void leave_out(struct lp_imager *imager)
{
	struct lp_eye *eye = imager->eye;
	const struct lp_residual residual = lp_imager_residual(imager);
	const uint8_t *flags = eye->seen.flags;

	lp_stuck_fill(&eye->stuck, &eye->incoming.cells);
	lp_imager_map(imager);
	if (residual.lookup) {
		lp_lookup_marks(imager->lookup, eye->seen.flags, imager->turned_flags);
		flags = imager->turned_flags;
	}
	for (int i = 0; i < imager->grid->width * imager->grid->height; i++)
		if (flags[i] & LP_CELL_FILLED)
			lp_radiance_map_forget_cell(imager->map, i);
}

void lp_imager_learn_stuck(struct lp_imager *imager)
{
	struct lp_eye *eye = imager->eye;
	const struct lp_stuck_look look = {
		.cells = &eye->incoming.cells,
		.to_anchor = &imager->turn.motion.rotation,
		.turns =
			imager->turn.motion.turning && imager->turn.agreement >= LP_LEAST_AGREEMENT,
		.covered = eye->cover.found ? is_covered : NULL,
		.known = imager->t_map_ns ? known : NULL,
		.context = imager,
	};

	if (imager->late_s > 0.0F || isnan(eye->incoming.cells.mean_code))
		return;
	const int before = eye->stuck.count;

	lp_stuck_learn(&eye->stuck, &look);
	if (eye->stuck.count != before)
		eye->stuck.t_changed_ns = imager->t_capture_ns;
	if (eye->stuck.count > before)
		leave_out(imager);
	tell(&eye->stuck, imager->t_capture_ns, (int)(eye - imager->eyes) + 1);
}
