/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/regions.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/math/grid.h"

/* Fewer candidates cost nothing worth saving. */
#define MANY_CANDIDATES 1024
#define KEYS (1 << 16)
#define STEP_BITS 5 /* of a key's: an eighth of a stop */

/* What flows down to one peak. */
struct lp_basin {
	int32_t parent; /* that it was absorbed by; itself: a root */
	int32_t next;	/* root: how many cells its core has; then where the next one goes */
	float peak;
	bool clipped;		     /* where it peaks */
	double flux, solid_angle_sr; /* root: of its core */
};

int lp_regions_create(const struct lp_grid *grid, struct lp_regions **regions)
{
	const size_t n = (size_t)grid->width * grid->height;
	struct lp_regions *r = calloc(1, sizeof(*r));

	if (!r)
		return -ENOMEM;
	r->grid = grid;
	r->cells = calloc(n, sizeof(*r->cells));
	r->candidates = calloc(n, sizeof(*r->candidates));
	r->scratch = calloc(n, sizeof(*r->scratch));
	r->start = calloc(KEYS, sizeof(*r->start));
	r->basins = calloc(n / 4, sizeof(*r->basins)); /* no two peaks touch */
	r->basin_at = calloc(n, sizeof(*r->basin_at));
	r->basin_of = calloc(n, sizeof(*r->basin_of));
	if (!r->cells || !r->candidates || !r->scratch || !r->start || !r->basins || !r->basin_at ||
	    !r->basin_of) {
		lp_regions_destroy(r);
		return -ENOMEM;
	}
	*regions = r;
	return 0;
}

void lp_regions_destroy(struct lp_regions *regions)
{
	if (!regions)
		return;
	free(regions->basin_of);
	free(regions->basin_at);
	free(regions->basins);
	free(regions->start);
	free(regions->scratch);
	free(regions->candidates);
	free(regions->cells);
	free(regions);
}

static void collect(struct lp_regions *regions, const struct lp_panorama *panorama, float level)
{
	const int n = panorama->width * panorama->height;
	int count = 0;

	regions->flags = panorama->flags;
	memset(regions->basin_at, 0xff, n * sizeof(*regions->basin_at));
	for (int i = 0; i < n; i++) {
		const float luminance = panorama->cells[i][LP_LUMINANCE];

		if (luminance > level)
			regions->candidates[count++] = (struct lp_candidate){luminance, i};
	}
	regions->candidate_count = count;
}

/* Order of luminance in 16 bits: the pattern of a positive float grows with its value. */
static int key_of(const struct lp_candidate *candidate)
{
	uint32_t bits;

	memcpy(&bits, &candidate->luminance, sizeof(bits));
	return (int)(bits >> 15);
}

/* Stable counting sort, brightest first: equal cells stay in grid order, so results repeat. */
static void sort_candidates(struct lp_regions *regions)
{
	struct lp_candidate *sorted = regions->scratch;
	int32_t *start = regions->start; /* by how much a key is below the highest */
	int lowest = KEYS - 1, highest = 0, next = 0;

	for (int k = 0; k < regions->candidate_count; k++) {
		const int key = key_of(&regions->candidates[k]);

		lowest = key < lowest ? key : lowest;
		highest = key > highest ? key : highest;
	}
	for (int b = 0; b <= highest - lowest; b++)
		start[b] = 0;
	for (int k = 0; k < regions->candidate_count; k++)
		start[highest - key_of(&regions->candidates[k])]++;
	for (int b = 0; b <= highest - lowest; b++) {
		const int size = start[b];

		start[b] = next;
		next += size;
	}
	for (int k = 0; k < regions->candidate_count; k++)
		sorted[start[highest - key_of(&regions->candidates[k])]++] = regions->candidates[k];
	regions->scratch = regions->candidates;
	regions->candidates = sorted;
}

/*
 * A bright sky is no lamp, and no lamp is as large: of many candidates only the brightest area_sr
 * stay, and what is as bright as the last of them: counted in steps of an eighth of a stop. Of a
 * sky that is as bright all over that is still all, in one region too large (gather()).
 */
static void limit_area(struct lp_regions *regions, float area_sr)
{
	const struct lp_candidate *candidates = regions->candidates;
	float area = 0.0F;
	int count = 0;

	if (regions->candidate_count < MANY_CANDIDATES)
		return;
	while (count < regions->candidate_count && area <= area_sr)
		area += lp_grid_solid_angle_sr(regions->grid, candidates[count++].cell);
	while (count < regions->candidate_count &&
	       key_of(&candidates[count]) >> STEP_BITS ==
		       key_of(&candidates[count - 1]) >> STEP_BITS)
		count++;
	regions->candidate_count = count;
}

static int32_t find_root(struct lp_basin *basins, int32_t basin)
{
	while (basins[basin].parent != basin) {
		basins[basin].parent = basins[basins[basin].parent].parent;
		basin = basins[basin].parent;
	}
	return basin;
}

static int32_t new_basin(struct lp_regions *regions, const struct lp_candidate *candidate)
{
	const int32_t basin = regions->basin_count++;

	regions->basins[basin] = (struct lp_basin){
		.parent = basin,
		.peak = candidate->luminance,
		.clipped = regions->flags[candidate->cell] & LP_CELL_CLIPPED,
	};
	return basin;
}

/* Basins may meet at a cell: it joins the one with the highest peak, which is returned and absorbs
 * those that do not stand `persistence` times above the cell. */
static int32_t join(struct lp_regions *regions, const struct lp_candidate *candidate,
		    float persistence)
{
	struct lp_basin *basins = regions->basins;
	int neighbours[LP_NEIGHBOURS];
	int32_t roots[LP_NEIGHBOURS], home = -1;
	float highest = -1.0F;
	int count = 0;

	lp_grid_neighbours(regions->grid, candidate->cell, neighbours);
	for (int j = 0; j < LP_NEIGHBOURS; j++) {
		int32_t *at = &regions->basin_at[neighbours[j]];

		if (*at < 0 || (count && *at == roots[count - 1]))
			continue;
		*at = find_root(basins, *at); /* short ways for the next cell */
		if (count && *at == roots[count - 1])
			continue;
		roots[count++] = *at;
		if (basins[*at].peak > highest) {
			highest = basins[*at].peak;
			home = *at;
		}
	}
	for (int j = 0; j < count; j++)
		if (roots[j] != home && basins[roots[j]].peak < persistence * candidate->luminance)
			basins[roots[j]].parent = home;
	return home < 0 ? new_basin(regions, candidate) : home;
}

/*
 * Flood from the brightest cell down. A cell joins the neighbouring basin with the highest peak;
 * where basins meet, the lower peak is absorbed unless it stands `persistence` times above the
 * meeting level (Edelsbrunner, Letscher & Zomorodian 2002, "Topological persistence and
 * simplification").
 */
static void flood(struct lp_regions *regions, float persistence)
{
	regions->basin_count = 0;
	for (int k = 0; k < regions->candidate_count; k++) {
		const struct lp_candidate *candidate = &regions->candidates[k];
		const int32_t basin = join(regions, candidate, persistence);

		regions->basin_at[candidate->cell] = regions->basin_of[k] = basin;
	}
}

/* Insert by flux; of more than LP_MAX_REGIONS the weakest falls off the end. */
static void admit(struct lp_regions *regions, const struct lp_region *region)
{
	int at = regions->count;

	while (at > 0 && regions->list[at - 1].flux < region->flux)
		at--;
	if (at == LP_MAX_REGIONS)
		return;
	if (regions->count < LP_MAX_REGIONS)
		regions->count++;
	memmove(regions->list + at + 1, regions->list + at,
		(regions->count - 1 - at) * sizeof(*region));
	regions->list[at] = *region;
}

/* The cores of the basins: the cells above core_ratio * peak. Of the others basin_of becomes -1. A
 * clipped peak is higher than it seems: with the same ratio the glow around a sun would be its
 * core. */
static void find_cores(struct lp_regions *regions, float core_ratio, float clipped_core_ratio)
{
	struct lp_basin *basins = regions->basins;

	for (int b = 0; b < regions->basin_count; b++)
		basins[b].parent = find_root(basins, b);
	for (int k = 0; k < regions->candidate_count; k++) {
		const int32_t root = basins[regions->basin_of[k]].parent;
		const float ratio = basins[root].clipped ? clipped_core_ratio : core_ratio;
		const bool core = regions->candidates[k].luminance > ratio * basins[root].peak;

		regions->basin_of[k] = core ? root : -1;
		basins[root].next += core;
	}
}

/* Lay the cores' cells out, basin by basin. */
static void lay_out(struct lp_regions *regions)
{
	int next = 0;

	for (int b = 0; b < regions->basin_count; b++) {
		const int size = regions->basins[b].next;

		regions->basins[b].next = next;
		next += size;
	}
	for (int k = 0; k < regions->candidate_count; k++) {
		const struct lp_candidate *candidate = &regions->candidates[k];
		const double omega = lp_grid_solid_angle_sr(regions->grid, candidate->cell);

		if (regions->basin_of[k] < 0)
			continue;
		struct lp_basin *basin = &regions->basins[regions->basin_of[k]];

		regions->cells[basin->next++] = candidate->cell;
		basin->flux += candidate->luminance * omega;
		basin->solid_angle_sr += omega;
	}
}

/* Keep the strongest of the basins' cores; those of more than area_sr are too large. */
static void gather(struct lp_regions *regions, float area_sr)
{
	int first = 0;

	lay_out(regions);
	regions->count = 0;
	for (int b = 0; b < regions->basin_count; b++) {
		const struct lp_basin *basin = &regions->basins[b];
		const struct lp_region region = {.first = first,
						 .count = basin->next - first,
						 .peak = basin->peak,
						 .flux = basin->flux,
						 .solid_angle_sr = basin->solid_angle_sr,
						 .too_large = basin->solid_angle_sr > area_sr};

		if (basin->parent != b)
			continue;
		admit(regions, &region);
		first = basin->next;
	}
}

void lp_regions_from_peaks(struct lp_regions *regions, const struct lp_panorama *panorama,
			   float mean, const struct lp_peak_options *options)
{
	collect(regions, panorama, fmaxf(options->floor_ratio * mean, 0.0F));
	sort_candidates(regions);
	limit_area(regions, options->area_sr);
	flood(regions, options->persistence_ratio);
	find_cores(regions, options->core_ratio, options->clipped_core_ratio);
	gather(regions, options->area_sr);
}
