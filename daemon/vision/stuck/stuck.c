/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/stuck/stuck.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/panorama.h"
#include "light/math/rotation.h"
#include "vision/camera/camera.h"
#include "vision/picture/cells.h"
#include "vision/stuck/stuck_state.h"

/* Neighbours up to so many cells away fill what is left out: a row of cells, and a spot of several,
 * have some as near as that. */
#define FILL_REACH 4
/* Two looks have nothing to do with each other when what a cell sees has moved by so many cells: a
 * lamp lights those beside its own, too. */
#define APART_CELLS 2.0
/* Of what a cell sees across the horizon. At the poles of a panorama cells are slivers of one and
 * the same place: a lamp there shines in each of them wherever the camera turns. */
#define SLIVER_SHARE 0.1

void lp_stuck_release(struct lp_stuck *stuck)
{
	free(stuck->given);
	free(stuck->own);
	free(stuck->list);
	free(stuck->stands);
	free(stuck->light);
	free(stuck->cell);
	free(stuck->log_odds);
	free(stuck->is_sliver);
	free(stuck->ray);
	*stuck = (struct lp_stuck){0};
}

static int allocate(struct lp_stuck *s)
{
	const size_t cells = (size_t)s->columns * s->rows;

	s->ray = calloc(cells, sizeof(*s->ray));
	s->is_sliver = calloc(cells, sizeof(*s->is_sliver));
	s->log_odds = calloc(cells, sizeof(*s->log_odds));
	s->cell = calloc(cells, sizeof(*s->cell));
	s->light = calloc(cells, sizeof(*s->light));
	s->stands = calloc(cells, sizeof(*s->stands));
	s->list = calloc(cells, sizeof(*s->list));
	s->own = calloc(cells, sizeof(*s->own));
	return s->ray && s->is_sliver && s->log_odds && s->cell && s->light && s->stands &&
			       s->list && s->own
		       ? 0
		       : -ENOMEM;
}

/* Where the cells look. */
static void aim(struct lp_stuck *s, const struct lp_camera *camera)
{
	const double cell_rad = 2.0 * M_PI * s->cell_px / lp_camera_circle_px(camera, s->width_px);

	for (int i = 0; i < s->columns * s->rows; i++) {
		const double x = (i % s->columns + 0.5) * s->cell_px;
		const double y = (i / s->columns + 0.5) * s->cell_px; /* cells may reach beyond */
		double direction[3];
		int lens;
		const bool seen =
			x < s->width_px && y < s->height_px &&
			lp_camera_ray(camera, s->width_px, s->height_px, x, y, direction, &lens);

		for (int a = 0; a < 3; a++)
			s->ray[i][a] = seen ? (float)direction[a] : NAN;
		s->is_sliver[i] = seen && lp_camera_pixel_solid_angle_sr(camera, s->width_px,
									 s->height_px, x, y) *
							  s->cell_px * s->cell_px <
						  SLIVER_SHARE * cell_rad * cell_rad;
	}
	s->wraps = lp_camera_is_whole(camera) && s->width_px % s->cell_px == 0 &&
		   s->height_px % s->cell_px == 0;
	s->least_cosine = (float)cos(fmin(APART_CELLS * cell_rad, M_PI / 2.0));
}

/* Every cell that has a part of it. */
static void take(struct lp_stuck *s, const struct lp_stuck_place *place)
{
	const float across = (float)s->width_px / (float)s->cell_px;
	const float down = (float)s->height_px / (float)s->cell_px;
	const float slack = 0.01F; /* of a cell: rounding */
	const int first = (int)fmaxf(place->x0 * across + slack, 0.0F);
	const int top = (int)fmaxf(place->y0 * down + slack, 0.0F);
	const float right = place->x1 * across - slack, bottom = place->y1 * down - slack;

	for (int r = top; r < s->rows && (float)r < bottom; r++)
		for (int c = first; c < s->columns && (float)c < right; c++) {
			const int i = r * s->columns + c;

			s->log_odds[i] = LP_STUCK_CERTAIN;
			/* until it shows: as a pixel that is stuck */
			s->cell[i].excess = 1.0F / (float)(s->cell_px * s->cell_px);
			s->cell[i].scale = INFINITY;
		}
}

static struct lp_stuck_place place_of(const struct lp_stuck *s, int cell)
{
	const float across = (float)s->cell_px / (float)s->width_px;
	const float down = (float)s->cell_px / (float)s->height_px;
	const float c = (float)(cell % s->columns), r = (float)(cell / s->columns);

	return (struct lp_stuck_place){c * across, r * down, (c + 1.0F) * across,
				       (r + 1.0F) * down};
}

/* A pixel that a camera file names, with its neighbours, into which colours are mixed. */
static struct lp_stuck_place place_of_pixel(const struct lp_camera *camera, const float px[2])
{
	const float width = (float)camera->width_px, height = (float)camera->height_px;

	return (struct lp_stuck_place){(px[0] - 1.0F) / width, (px[1] - 1.0F) / height,
				       (px[0] + 2.0F) / width, (px[1] + 2.0F) / height};
}

int lp_stuck_fit(struct lp_stuck *stuck, const struct lp_camera *camera, int width_px,
		 int height_px, int cell_px)
{
	struct lp_stuck next = {.width_px = width_px,
				.height_px = height_px,
				.cell_px = cell_px,
				.columns = (width_px + cell_px - 1) / cell_px,
				.rows = (height_px + cell_px - 1) / cell_px,
				.told = stuck->told};

	if (allocate(&next) < 0) {
		lp_stuck_release(&next);
		return -ENOMEM;
	}
	aim(&next, camera);
	for (int i = 0; i < next.columns * next.rows; i++)
		lp_stuck_forget_cell(&next, i);
	for (int k = 0; k < stuck->given_count; k++)
		take(&next, &stuck->given[k]);
	for (int k = 0; k < camera->stuck_count && !stuck->width_px && !stuck->given_count; k++) {
		const struct lp_stuck_place place = place_of_pixel(camera, camera->stuck_px[k]);

		take(&next, &place);
	}
	for (int k = 0; k < stuck->count; k++) {
		const struct lp_stuck_place place = place_of(stuck, stuck->list[k]);

		take(&next, &place);
	}
	lp_stuck_release(stuck);
	*stuck = next;
	lp_stuck_make_list(stuck);
	return 0;
}

int lp_stuck_inherit(struct lp_stuck *stuck, const struct lp_stuck *from)
{
	const int count = from->width_px ? from->count : from->given_count;
	struct lp_stuck_place *given = calloc((size_t)count + 1, sizeof(*given));

	if (!given)
		return -ENOMEM;
	for (int k = 0; k < count; k++)
		given[k] = from->width_px ? place_of(from, from->list[k]) : from->given[k];
	free(stuck->given);
	stuck->given = given;
	stuck->given_count = count;
	stuck->told = from->told;
	return 0;
}

void lp_stuck_forget_cell(struct lp_stuck *stuck, int cell)
{
	stuck->log_odds[cell] = LP_STUCK_UNKNOWN;
	stuck->cell[cell] = (struct lp_stuck_cell){.excess = INFINITY};
}

void lp_stuck_make_list(struct lp_stuck *stuck)
{
	stuck->count = 0;
	for (int i = 0; i < stuck->columns * stuck->rows; i++)
		if (stuck->log_odds[i] > 0.0F)
			stuck->list[stuck->count++] = i;
}

static void turn_direction(const struct lp_rotation *turn, int16_t packed[3])
{
	float d[3] = {packed[0], packed[1], packed[2]};

	lp_rotate_direction(turn, d);
	for (int a = 0; a < 3; a++)
		packed[a] = (int16_t)d[a];
}

void lp_stuck_turn(struct lp_stuck *stuck, const struct lp_rotation *turn)
{
	stuck->looked_from = lp_rotation_product(turn, &stuck->looked_from);
	for (int i = 0; i < stuck->columns * stuck->rows; i++) {
		struct lp_stuck_cell *cell = &stuck->cell[i];

		if (stuck->log_odds[i] == LP_STUCK_UNKNOWN)
			continue;
		turn_direction(turn, cell->looked);
		for (int k = 0; k < cell->shown_count; k++)
			turn_direction(turn, cell->shown[k]);
	}
}

/* ---------------------------------------------------------------- filling */

int lp_stuck_beside(const struct lp_stuck *stuck, int cell, int across, int down)
{
	int row = cell / stuck->columns + down;
	int column = cell % stuck->columns + across;

	if (stuck->wraps && (row < 0 || row >= stuck->rows)) { /* over a pole */
		row = row < 0 ? -1 - row : 2 * stuck->rows - 1 - row;
		column += stuck->columns / 2;
	}
	if (stuck->wraps)
		column = (column + stuck->columns) % stuck->columns;
	if (row < 0 || row >= stuck->rows || column < 0 || column >= stuck->columns)
		return -1;
	const int at = row * stuck->columns + column;

	return isnan(stuck->ray[at][0]) ? -1 : at;
}

/* Mean of the nearest neighbours that are not left out. False: there are none. */
static bool fill(const struct lp_stuck *stuck, struct lp_cells *cells, int cell)
{
	for (int reach = 1; reach <= FILL_REACH; reach++) {
		float sum[4] = {0.0F};
		int count = 0;

		for (int down = -reach; down <= reach; down++)
			for (int across = -reach; across <= reach; across++) {
				const int at = lp_stuck_beside(stuck, cell, across, down);

				if (at < 0 || lp_stuck_leaves_out(stuck, at))
					continue;
				for (int c = 0; c < 4; c++)
					sum[c] += cells->radiance[at][c];
				count++;
			}
		for (int c = 0; count && c < 4; c++)
			cells->radiance[cell][c] = sum[c] / (float)count;
		if (count)
			return true;
	}
	return false;
}

void lp_stuck_fill(struct lp_stuck *stuck, struct lp_cells *cells)
{
	for (int k = 0; k < stuck->count; k++)
		stuck->own[k] = lp_stuck_light(cells, stuck->list[k]);
	for (int k = 0; k < stuck->count; k++) {
		const int cell = stuck->list[k];

		if (isnan(stuck->ray[cell][0]) || !fill(stuck, cells, cell))
			continue;
		cells->clipped_count -= cells->clipped[cell] & LP_CELL_CLIPPED;
		cells->clipped[cell] &= (uint8_t)~LP_CELL_CLIPPED;
	}
}
