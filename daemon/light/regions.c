/* SPDX-License-Identifier: Apache-2.0 */
#include "light/regions.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "include/panorama.h"
#include "light/grid.h"

#define LUMINANCE 3 /* fourth channel of a panorama cell */
/* Fewer candidates cost nothing worth saving. */
#define MANY_CANDIDATES 1024
#define STEP_BITS 5 /* of a key's 16: an eighth of a stop */

int lp_regions_create(const struct lp_grid *grid, struct lp_regions **regions)
{
	const size_t n = (size_t)grid->width * grid->height;
	struct lp_regions *r = calloc(1, sizeof(*r));
	int32_t *storage = calloc(5 * n, sizeof(*storage));

	if (!r || !storage) {
		free(storage);
		free(r);
		return -ENOMEM;
	}
	r->grid = grid;
	r->cells = storage; /* one block; freed through this pointer */
	r->candidates = storage + n;
	r->scratch = r->candidates + n;
	r->parent = r->scratch + n;
	r->slot = r->parent + n;
	*regions = r;
	return 0;
}

void lp_regions_destroy(struct lp_regions *regions)
{
	if (!regions)
		return;
	free(regions->cells);
	free(regions);
}

static void collect(struct lp_regions *regions, const struct lp_panorama *panorama, float level)
{
	const int n = panorama->width * panorama->height;
	int count = 0;

	memset(regions->parent, 0xff, n * sizeof(*regions->parent));
	for (int i = 0; i < n; i++) { /* without a branch: brightness is anything but predictable */
		regions->candidates[count] = i;
		count += panorama->cells[i][LUMINANCE] > level;
	}
	regions->candidate_count = count;
}

/* Order of luminance in 16 bits: the pattern of a positive float grows with its value. */
static uint32_t key_of(const struct lp_panorama *panorama, int32_t cell)
{
	uint32_t bits;

	memcpy(&bits, &panorama->cells[cell][LUMINANCE], sizeof(bits));
	return bits >> 15;
}

/*
 * A bright sky is no lamp, and no lamp is as large: of many candidates only the brightest area_sr
 * stay, and what is as bright as the last of them: counted in steps of an eighth of a stop.
 */
static void limit_area(struct lp_regions *regions, const struct lp_panorama *panorama,
		       float area_sr)
{
	float area[1 << 16 >> STEP_BITS] = {0}, total = 0.0F;
	int32_t *candidates = regions->candidates;
	int step = (1 << 16 >> STEP_BITS) - 1, count = 0;

	if (regions->candidate_count < MANY_CANDIDATES)
		return;
	for (int k = 0; k < regions->candidate_count; k++)
		area[key_of(panorama, candidates[k]) >> STEP_BITS] +=
			lp_grid_solid_angle_sr(regions->grid, candidates[k]);
	while (step > 0 && total + area[step] <= area_sr)
		total += area[step--];
	for (int k = 0; k < regions->candidate_count; k++) {
		const int32_t cell = candidates[k];

		candidates[count] = cell;
		count += (int)(key_of(panorama, cell) >> STEP_BITS) >= step;
	}
	regions->candidate_count = count;
}

/* Stable radix sort, brightest first: equal cells stay in grid order, so results repeat. */
static void sort_candidates(struct lp_regions *regions, const struct lp_panorama *panorama)
{
	int32_t *from = regions->candidates, *to = regions->scratch;

	for (int shift = 0; shift < 16; shift += 8) {
		int start[257] = {0};

		for (int k = 0; k < regions->candidate_count; k++)
			start[256 - (key_of(panorama, from[k]) >> shift & 255)]++;
		for (int b = 0; b < 256; b++)
			start[b + 1] += start[b];
		for (int k = 0; k < regions->candidate_count; k++)
			to[start[255 - (key_of(panorama, from[k]) >> shift & 255)]++] = from[k];
		int32_t *swap = from;
		from = to;
		to = swap;
	}
}

static int32_t find_root(int32_t *parent, int32_t cell)
{
	while (parent[cell] != cell) {
		parent[cell] = parent[parent[cell]];
		cell = parent[cell];
	}
	return cell;
}

/* The one root that all flooded neighbours point at; -1: none is flooded; -2: there may be several.
 * Without a branch per neighbour: which of them are flooded is anything but predictable. */
static int32_t only_root(const int32_t *parent, const int neighbours[LP_NEIGHBOURS])
{
	int32_t highest = -1;
	uint32_t lowest = UINT32_MAX; /* as unsigned numbers, -1 is the highest of all */

	for (int j = 0; j < LP_NEIGHBOURS; j++) {
		const int32_t found = parent[neighbours[j]];

		highest = found > highest ? found : highest;
		lowest = (uint32_t)found < lowest ? (uint32_t)found : lowest;
	}
	if (highest < 0)
		return -1;
	return (uint32_t)highest == lowest && parent[highest] == highest ? highest : -2;
}

/* Basins meet at the cell: it joins the one with the highest peak, which absorbs those that do not
 * stand `persistence` times above the cell. */
static void join(struct lp_regions *regions, const struct lp_panorama *panorama, int32_t cell,
		 const int neighbours[LP_NEIGHBOURS], float persistence)
{
	int32_t *parent = regions->parent, roots[LP_NEIGHBOURS], home = cell;
	float highest = -1.0F;
	int count = 0;

	for (int j = 0; j < LP_NEIGHBOURS; j++) {
		if (parent[neighbours[j]] < 0)
			continue;
		const int32_t root = find_root(parent, neighbours[j]);

		parent[neighbours[j]] = root; /* short ways for the next cell */
		if (count && root == roots[count - 1])
			continue;
		roots[count++] = root;
		if (panorama->cells[root][LUMINANCE] > highest) {
			highest = panorama->cells[root][LUMINANCE];
			home = root;
		}
	}
	parent[cell] = home;
	for (int j = 0; j < count; j++)
		if (roots[j] != home && panorama->cells[roots[j]][LUMINANCE] <
						persistence * panorama->cells[cell][LUMINANCE])
			parent[roots[j]] = home;
}

/*
 * Flood from the brightest cell down. A cell joins the neighbouring basin with the highest peak;
 * where basins meet, the lower peak is absorbed unless it stands `persistence` times above the
 * meeting level (Edelsbrunner, Letscher & Zomorodian 2002, "Topological persistence and
 * simplification"). A root is the peak of its basin.
 */
static void flood(struct lp_regions *regions, const struct lp_panorama *panorama, float persistence)
{
	for (int k = 0; k < regions->candidate_count; k++) {
		const int32_t cell = regions->candidates[k];
		int neighbours[LP_NEIGHBOURS];

		lp_grid_neighbours(regions->grid, cell, neighbours);
		const int32_t root = only_root(regions->parent, neighbours);

		if (root >= -1)
			regions->parent[cell] = root < 0 ? cell : root;
		else
			join(regions, panorama, cell, neighbours, persistence);
	}
}

static int stronger_first(const void *a, const void *b)
{
	const struct lp_region *p = a, *q = b;

	if (p->flux != q->flux)
		return p->flux < q->flux ? 1 : -1;
	return p->first - q->first;
}

/* The list keeps the strongest LP_MAX_REGIONS; the weakest makes room for a stronger newcomer. */
static struct lp_region *admit(struct lp_regions *regions, double flux)
{
	struct lp_region *weakest = NULL;

	if (regions->count < LP_MAX_REGIONS)
		return &regions->list[regions->count++];
	for (int i = 0; i < LP_MAX_REGIONS; i++)
		if (!weakest || regions->list[i].flux < weakest->flux)
			weakest = &regions->list[i];
	return weakest->flux < flux ? weakest : NULL;
}

static double flux_of(const struct lp_regions *regions, const struct lp_panorama *panorama,
		      int cell)
{
	return (double)panorama->cells[cell][LUMINANCE] *
	       lp_grid_solid_angle_sr(regions->grid, cell);
}

/* The root of every candidate whose cell is of its basin's core, the cells above core_ratio * peak;
 * -1 for the others. Returned in regions->scratch; and how many each root has, in regions->slot. */
static void find_cores(struct lp_regions *regions, const struct lp_panorama *panorama,
		       float core_ratio)
{
	for (int k = 0; k < regions->candidate_count; k++)
		regions->slot[regions->candidates[k]] = 0;
	for (int k = 0; k < regions->candidate_count; k++) {
		const int32_t cell = regions->candidates[k];
		const int32_t root = find_root(regions->parent, cell);
		const bool core = panorama->cells[cell][LUMINANCE] >
				  core_ratio * panorama->cells[root][LUMINANCE];

		regions->scratch[k] = core ? root : -1;
		regions->slot[root] += core;
	}
}

/*
 * Gather the cores of the basins: lay their cells out basin by basin (counting sort on the root),
 * then keep the strongest.
 */
static void gather(struct lp_regions *regions, const struct lp_panorama *panorama, float core_ratio)
{
	int32_t *next_at = regions->slot; /* per root: how many, then where the next goes */
	int next = 0;

	regions->count = 0;
	find_cores(regions, panorama, core_ratio);
	for (int k = 0; k < regions->candidate_count; k++) {
		const int32_t root = regions->candidates[k];

		if (regions->parent[root] == root) {
			const int size = next_at[root];

			next_at[root] = next;
			next += size;
		}
	}
	for (int k = 0; k < regions->candidate_count; k++)
		if (regions->scratch[k] >= 0)
			regions->cells[next_at[regions->scratch[k]]++] = regions->candidates[k];
	for (int k = 0, first = 0; k < regions->candidate_count; k++) {
		const int32_t root = regions->candidates[k];
		double flux = 0.0;

		if (regions->parent[root] != root)
			continue;
		for (int i = first; i < next_at[root]; i++)
			flux += flux_of(regions, panorama, regions->cells[i]);

		struct lp_region *region = admit(regions, flux);
		if (region)
			*region = (struct lp_region){.first = first,
						     .count = next_at[root] - first,
						     .peak = panorama->cells[root][LUMINANCE],
						     .flux = flux};
		first = next_at[root];
	}
	qsort(regions->list, regions->count, sizeof(regions->list[0]), stronger_first);
}

void lp_regions_from_peaks(struct lp_regions *regions, const struct lp_panorama *panorama,
			   float mean, const struct lp_peak_options *options)
{
	collect(regions, panorama, fmaxf(options->floor_ratio * mean, 0.0F));
	limit_area(regions, panorama, options->area_sr);
	sort_candidates(regions, panorama);
	flood(regions, panorama, options->persistence_ratio);
	gather(regions, panorama, options->core_ratio);
}

void lp_regions_from_threshold(struct lp_regions *regions, const struct lp_panorama *panorama,
			       float level)
{
	collect(regions, panorama, fmaxf(level, 0.0F));
	sort_candidates(regions, panorama);
	flood(regions, panorama, INFINITY);
	gather(regions, panorama, 0.0F);
}
