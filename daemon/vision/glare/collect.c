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

static void add(float sum[4], const float light[4], float share)
{
	for (int c = 0; c < 4; c++)
		sum[c] += share * light[c];
}

/* To the four nodes around a cell. */
static void collect(struct lp_glare *g, int seen, const float light[4], float sr)
{
	const int row = seen / g->width, column = seen - row * g->width;
	const int left = g->column_node[column];
	const int right = left + 1 < LP_VEIL_WIDTH ? left + 1 : 0;
	const float below = sr * g->row_share[row], above = sr - below;
	const float x = g->column_share[column];
	float(*nodes)[4] = g->flux + (size_t)g->row_node[row] * LP_VEIL_WIDTH;

	add(nodes[left], light, above * (1.0F - x));
	add(nodes[right], light, above * x);
	nodes += LP_VEIL_WIDTH;
	add(nodes[left], light, below * (1.0F - x));
	add(nodes[right], light, below * x);
}

void lp_glare_look(struct lp_glare *glare, const struct lp_residual *frame, const float *over_film)
{
	memset(glare->flux, 0, sizeof(glare->flux));
	for (int r = 0, i = 0; r < glare->height; r++)
		for (int c = 0; c < glare->width; c++, i++) {
			const int seen = lp_residual_seen(frame, i);
			const float over = over_film ? over_film[seen] : 1.0F;

			if (!(frame->seen.flags[seen] & LP_CELL_UNSEEN))
				collect(glare, seen, light_of(frame, i, seen),
					glare->row_sr[r] / over);
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
