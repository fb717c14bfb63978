/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Segmentation of the small panorama: which cells belong together as one source of light. Regions
 * wrap at the seam and close over the poles. Two ways, one result:
 *  - peaks: every local maximum that stands out of its surroundings (topological persistence);
 *  - threshold: connected cells above one level.
 */
#ifndef LP_LIGHT_FIND_REGIONS_H
#define LP_LIGHT_FIND_REGIONS_H

#include <stdbool.h>
#include <stdint.h>

struct lp_grid;
struct lp_panorama;

#define LP_MAX_REGIONS 32

struct lp_region {
	int first, count; /* into lp_regions.cells */
	float peak;	  /* highest luminance in it */
	double flux; /* sum of luminance * solid angle: what it casts, before the surround is taken
			off */
	double solid_angle_sr;
	bool too_large; /* to be a lamp: a sky, say; its cells are no lamp's surround either */
};

struct lp_basin; /* regions.c */

/* A cell that is bright enough. */
struct lp_candidate {
	float luminance;
	int32_t cell;
};

/* All storage is allocated once; one segmentation overwrites the last. One thread at a time. */
struct lp_regions {
	const struct lp_grid *grid; /* borrowed */
	int count;
	struct lp_region list[LP_MAX_REGIONS]; /* by flux, strongest first */
	int32_t *cells;			       /* cell indices, region after region */

	/* workspace */
	const uint8_t *flags; /* of the panorama's cells, borrowed for one segmentation */
	int candidate_count, basin_count;
	struct lp_candidate *candidates, *scratch; /* brightest first */
	int32_t *start;				   /* of each brightness in them */
	struct lp_basin *basins;		   /* by their peaks, brightest first */
	int32_t *basin_at;			   /* per cell; -1: not flooded */
	int32_t *basin_of;			   /* per candidate */
};

struct lp_peak_options {
	float floor_ratio; /* candidates are brighter than this many times the mean radiance */
	/* and among the brightest so many steradians, to an eighth of a stop; a region of more is
	 * too large to be a lamp */
	float area_sr;
	float persistence_ratio;  /* a peak is its own when it is this many times its highest saddle
				   */
	float core_ratio;	  /* a region keeps the cells above this share of its peak */
	float clipped_core_ratio; /* the same, where the peak is clipped */
};

int lp_regions_create(const struct lp_grid *grid, struct lp_regions **regions);
void lp_regions_destroy(struct lp_regions *regions); /* accepts NULL; the grid stays */

/* mean: mean luminance over the sphere. Cost: the candidates, not the grid, beyond one scan. */
void lp_regions_from_peaks(struct lp_regions *regions, const struct lp_panorama *panorama,
			   float mean, const struct lp_peak_options *options);

#endif
