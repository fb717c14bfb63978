/* SPDX-License-Identifier: Apache-2.0 */
#include "light/clipped/clipped_parts.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"
#include "light/linear/symmetric3.h"

/* Chosen by hand (docs/maintainers/constants.md). */

/* What is no farther from a lamp than this, and no wider, is beside it. */
#define BESIDE_RAD (6.0F * (float)M_PI / 180.0F)
/* Wider parts are split as long as there is room. */
#define MOST_SPREAD_RAD (12.0F * (float)M_PI / 180.0F)

int lp_clipped_parts_create(const struct lp_grid *grid, struct lp_clipped_parts **parts)
{
	const size_t cells = (size_t)grid->width * grid->height;
	struct lp_clipped_parts *p = calloc(1, sizeof(*p));

	if (!p)
		return -ENOMEM;
	p->grid = grid;
	p->cells = calloc(cells, sizeof(*p->cells));
	p->taken = calloc(cells, sizeof(*p->taken));
	if (!p->cells || !p->taken) {
		lp_clipped_parts_destroy(p);
		return -ENOMEM;
	}
	*parts = p;
	return 0;
}

void lp_clipped_parts_destroy(struct lp_clipped_parts *parts)
{
	if (!parts)
		return;
	free(parts->taken);
	free(parts->cells);
	free(parts);
}

void lp_clipped_parts_clear(struct lp_clipped_parts *parts)
{
	parts->count = parts->cell_count = 0;
	memset(parts->taken, 0, (size_t)parts->grid->width * parts->grid->height);
}

/* Middle and longest axis of its cells; returns the spread along the axis, squared. */
static double longest_axis(const struct lp_clipped_parts *parts, const struct lp_clipped_part *part,
			   double middle[3], double axis[3])
{
	double covariance[6] = {0.0}, total = 0.0;

	memset(middle, 0, 3 * sizeof(*middle));
	for (int i = part->first; i < part->first + part->count; i++) {
		const double weight = lp_grid_solid_angle_sr(parts->grid, parts->cells[i]);
		float d[3];

		lp_grid_direction(parts->grid, parts->cells[i], d);
		total += weight;
		for (int a = 0, n = 0; a < 3; a++) {
			middle[a] += weight * d[a];
			for (int b = a; b < 3; b++)
				covariance[n++] += weight * d[a] * d[b];
		}
	}
	for (int a = 0; a < 3; a++)
		middle[a] /= total;
	for (int a = 0, n = 0; a < 3; a++)
		for (int b = a; b < 3; b++, n++)
			covariance[n] = covariance[n] / total - middle[a] * middle[b];
	return lp_symmetric3_largest(covariance, axis);
}

static void measure(const struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
		    struct lp_clipped_part *part)
{
	double middle[3], axis[3];

	part->spread_rad = (float)sqrt(fmax(longest_axis(parts, part, middle, axis), 0.0));
	part->solid_angle_sr = 0.0F;
	memset(part->bound, 0, sizeof(part->bound));
	for (int i = part->first; i < part->first + part->count; i++) {
		const int cell = parts->cells[i];
		const float weight = lp_grid_solid_angle_sr(parts->grid, cell);

		part->solid_angle_sr += weight;
		for (int c = 0; c < 4; c++)
			part->bound[c] += weight * panorama->cells[cell][c];
	}
	for (int c = 0; c < 3; c++)
		part->tint[c] = part->bound[LP_LUMINANCE] > 0.0F
					? part->bound[c] / part->bound[LP_LUMINANCE]
					: 1.0F;
	const double length =
		sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2]);

	/* of a part all around the sphere there is no middle: any direction is as wrong */
	for (int a = 0; a < 3; a++)
		part->direction[a] = length > 1e-6 ? (float)(middle[a] / length) : (float)(a == 1);
}

/* Where a new part goes: the end; else in the place of the faintest that nobody has claimed, if it
 * is fainter than this one. -1: nowhere. */
static int place_for(const struct lp_clipped_parts *parts, const struct lp_clipped_part *part)
{
	int faintest = -1;
	float least = part->bound[LP_LUMINANCE];

	if (parts->count < LP_MAX_CLIPPED_PARTS)
		return parts->count;
	for (int k = 0; k < parts->count; k++)
		if (parts->list[k].owner < 0 && parts->list[k].bound[LP_LUMINANCE] < least) {
			least = parts->list[k].bound[LP_LUMINANCE];
			faintest = k;
		}
	return faintest;
}

/* The cells from `first` on are a part. */
static void add(struct lp_clipped_parts *parts, const struct lp_panorama *panorama, int first,
		int owner)
{
	struct lp_clipped_part part = {.first = first,
				       .count = parts->cell_count - first,
				       .owner = owner};

	if (part.count == 0)
		return;
	measure(parts, panorama, &part);
	const int place = place_for(parts, &part);

	if (place < 0)
		return;
	parts->list[place] = part;
	parts->count += place == parts->count;
}

static bool take(struct lp_clipped_parts *parts, const struct lp_panorama *panorama, int32_t cell)
{
	if (parts->taken[cell] || !(panorama->flags[cell] & LP_CELL_CLIPPED))
		return false;
	parts->taken[cell] = 1;
	parts->cells[parts->cell_count++] = cell;
	return true;
}

void lp_clipped_parts_claim(struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
			    const int32_t *cells, int count, int owner)
{
	const int first = parts->cell_count;

	for (int i = 0; i < count; i++)
		(void)take(parts, panorama, cells[i]);
	add(parts, panorama, first, owner);
}

/* The lamps that clip, then the area lights; returns how many. */
static int clipped_lamps(const struct lp_lamp_memory *memory, int owners[LP_MAX_LAMPS])
{
	int count = 0;

	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &memory->list[k];
		int at = count;

		if (!m->id || !m->seen || !(m->lamp.flags & LP_LIGHT_CLIPPED))
			continue;
		for (; at > 0 && memory->list[owners[at - 1]].wide > m->wide; at--)
			owners[at] = owners[at - 1];
		owners[at] = k;
		count++;
	}
	return count;
}

void lp_clipped_parts_of_lamps(struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
			       const int32_t *cells, const struct lp_lamp_memory *memory)
{
	int owners[LP_MAX_LAMPS];
	const int count = clipped_lamps(memory, owners);

	lp_clipped_parts_clear(parts);
	for (int k = 0; k < count && parts->count < LP_MAX_CLIPPED_PARTS; k++) {
		const struct lp_lamp *lamp = &memory->list[owners[k]].lamp;

		lp_clipped_parts_claim(parts, panorama, cells + lamp->first, lamp->count,
				       owners[k]);
	}
}

/* All clipped cells that hang together with the one at parts->cells[first]. */
static void flood(struct lp_clipped_parts *parts, const struct lp_panorama *panorama, int first)
{
	for (int i = first; i < parts->cell_count; i++) {
		int neighbours[LP_NEIGHBOURS];

		lp_grid_neighbours(parts->grid, parts->cells[i], neighbours);
		for (int k = 0; k < LP_NEIGHBOURS; k++)
			(void)take(parts, panorama, neighbours[k]);
	}
}

/* The cells on one side of the middle first; returns how many those are. */
static int sort_by_side(const struct lp_clipped_parts *parts, const struct lp_clipped_part *part)
{
	double middle[3], axis[3];
	int low = part->first, high = part->first + part->count;

	(void)longest_axis(parts, part, middle, axis);
	while (low < high) {
		const int32_t cell = parts->cells[low];
		double along = 0.0;
		float d[3];

		lp_grid_direction(parts->grid, cell, d);
		for (int a = 0; a < 3; a++)
			along += (d[a] - middle[a]) * axis[a];
		if (along > 0.0) {
			low++;
		} else {
			parts->cells[low] = parts->cells[--high];
			parts->cells[high] = cell;
		}
	}
	return low - part->first;
}

/* The part that is too wide and may hide most; -1: none is. */
static int widest_part(const struct lp_clipped_parts *parts)
{
	int widest = -1;
	float most = 0.0F;

	for (int k = 0; k < parts->count; k++) {
		const struct lp_clipped_part *part = &parts->list[k];
		const float size = part->spread_rad * part->spread_rad * part->solid_angle_sr;

		if (part->spread_rad > MOST_SPREAD_RAD && size > most) {
			most = size;
			widest = k;
		}
	}
	return widest;
}

/* Make room by forgetting the faintest part that nobody has claimed, if it is fainter than `bound`.
 */
static bool make_room(struct lp_clipped_parts *parts, float bound)
{
	int faintest = -1;
	float least = bound;

	if (parts->count < LP_MAX_CLIPPED_PARTS)
		return true;
	for (int k = 0; k < parts->count; k++)
		if (parts->list[k].owner < 0 && parts->list[k].bound[LP_LUMINANCE] < least) {
			least = parts->list[k].bound[LP_LUMINANCE];
			faintest = k;
		}
	if (faintest < 0)
		return false;
	parts->list[faintest] = parts->list[--parts->count];
	return true;
}

/* Cut the widest part in two. False: none is too wide, or there is no room. */
static bool split_widest(struct lp_clipped_parts *parts, const struct lp_panorama *panorama)
{
	int widest = widest_part(parts);

	if (widest < 0 || !make_room(parts, parts->list[widest].bound[LP_LUMINANCE]))
		return false;
	widest = widest_part(parts); /* it may have been moved */
	struct lp_clipped_part *whole = &parts->list[widest];
	struct lp_clipped_part *half = &parts->list[parts->count];
	const int count = sort_by_side(parts, whole);

	if (count == 0 || count == whole->count)
		return false;
	*half = (struct lp_clipped_part){.first = whole->first + count,
					 .count = whole->count - count,
					 .owner = whole->owner};
	whole->count = count;
	parts->count++;
	measure(parts, panorama, whole);
	measure(parts, panorama, half);
	return true;
}

void lp_clipped_parts_find(struct lp_clipped_parts *parts, const struct lp_panorama *panorama)
{
	for (int32_t cell = 0; cell < panorama->width * panorama->height; cell++) {
		const int first = parts->cell_count;

		if (!take(parts, panorama, cell))
			continue;
		flood(parts, panorama, first);
		add(parts, panorama, first, -1);
	}
	while (split_widest(parts, panorama))
		;
}

static bool is_lamp(const struct lp_clipped_part *part, const struct lp_lamp_memory *memory)
{
	return part->owner >= 0 && !memory->list[part->owner].wide;
}

static float cosine(const struct lp_clipped_part *a, const struct lp_clipped_part *b)
{
	return a->direction[0] * b->direction[0] + a->direction[1] * b->direction[1] +
	       a->direction[2] * b->direction[2];
}

/* The nearest part of a lamp that this one is beside; -1: none. */
static int lamp_beside(const struct lp_clipped_parts *parts, const struct lp_lamp_memory *memory,
		       const struct lp_clipped_part *part)
{
	float most = cosf(BESIDE_RAD);
	int nearest = -1;

	for (int k = 0; k < parts->count; k++)
		if (is_lamp(&parts->list[k], memory) && cosine(&parts->list[k], part) > most) {
			most = cosine(&parts->list[k], part);
			nearest = k;
		}
	return nearest;
}

void lp_clipped_parts_give_glow(struct lp_clipped_parts *parts, const struct lp_lamp_memory *memory)
{
	int owners[LP_MAX_CLIPPED_PARTS];

	for (int j = 0; j < parts->count; j++) {
		const struct lp_clipped_part *part = &parts->list[j];
		int lamp = -1;

		if (!is_lamp(part, memory) && part->spread_rad < BESIDE_RAD)
			lamp = lamp_beside(parts, memory, part);
		owners[j] = lamp < 0 ? part->owner : parts->list[lamp].owner;
	}
	for (int j = 0; j < parts->count; j++)
		parts->list[j].owner = owners[j];
}
