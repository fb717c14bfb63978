/* SPDX-License-Identifier: Apache-2.0 */
/* The light that a camera sees, on the nodes of its veil; and the veil where the map's cells are.
 */
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "vision/glare/glare.h"
#include "vision/map/residual.h"

/* Of full scale: a cell that is brighter is shown well enough to count by itself. Chosen by hand
 * (docs/maintainers/constants.md). */
#define SHOWN 0.005F

/* The light of one cell: by the frame, where it shows it, else by the map. */
static const float *light_of(const struct lp_residual *frame, int cell, int seen)
{
	const struct lp_observation *o = &frame->seen;
	const uint8_t marks = o->flags[seen];
	const float *shown = o->radiance[seen], *known = frame->map->radiance[cell];

	if (frame->map->flags[cell] & LP_CELL_UNSEEN || marks & LP_CELL_COVERED)
		return shown;
	if (marks & LP_CELL_CLIPPED)
		return shown[LP_LUMINANCE] > known[LP_LUMINANCE] ? shown : known;
	return !o->coded || shown[LP_LUMINANCE] > SHOWN * o->scale ? shown : known;
}

void lp_glare_look(struct lp_glare *glare, const struct lp_residual *frame, const float *over_film)
{
	struct lp_glare_cell cells[LP_PANORAMA_MAX_WIDTH];

	memset(glare->flux, 0, sizeof(glare->flux));
	for (int r = 0, i = 0; r < glare->height; r++) {
		int count = 0;

		for (int c = 0; c < glare->width; c++, i++) {
			const int seen = lp_residual_seen(frame, i);

			if (frame->seen.flags[seen] & LP_CELL_UNSEEN)
				continue;
			cells[count++] =
				(struct lp_glare_cell){.light = light_of(frame, i, seen),
						       .cell = seen,
						       .sr = over_film ? glare->row_sr[r] /
										 over_film[seen]
								       : glare->row_sr[r]};
		}
		lp_glare_add(glare, cells, count);
	}
	lp_glare_spread(glare);
}

void lp_glare_turn(struct lp_glare *glare, const struct lp_residual *frame, const float *over_film)
{
	for (int i = 0; i < glare->width * glare->height; i++) {
		const int seen = lp_residual_seen(frame, i);
		const float over = over_film ? over_film[seen] : 1.0F;

		glare->turned[i] = over * glare->cells[seen];
		glare->turned_variance[i] = over * over * glare->variance[glare->nearest[seen]];
	}
}
