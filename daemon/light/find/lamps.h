/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From regions of the panorama to lamps: direction, irradiance above the surround, solid angle, and
 * the ellipse that has the same moments. A wide region (a window, a soft box) stays one.
 */
#ifndef LP_LIGHT_FIND_LAMPS_H
#define LP_LIGHT_FIND_LAMPS_H

#include <stdbool.h>
#include <stdint.h>

#include "light/find/lamp_rim.h"

struct lp_grid;
struct lp_panorama;
struct lp_regions;

#define LP_MAX_LAMPS 32 /* found; an estimate lists the strongest LP_MAX_LIGHTS */

/* One lamp on the grid. Directions are unit vectors towards the light, probe frame. */
struct lp_lamp {
	float centroid[3];   /* unit vector of all the flux above the background */
	float direction[3];  /* of the flux-weighted centroid */
	float irradiance[4]; /* R, G, B, luminance at normal incidence: sum (L - background) * Omega
			      */
	float background[4]; /* median radiance of the ring around it: R, G, B, luminance */
	float background_noise; /* 1 sigma of the ring's luminance, from its median deviation */
	float solid_angle_sr;	/* (sum L Omega)^2 / sum L^2 Omega: exact for a uniform disc */
	float cut; /* 1 sigma of the share that is not seen, where it has left its place in the map
		    */
	float direction_sigma_deg;
	float axis[3]; /* unit vector across centroid, along the longer axis of its ellipse */
	float half_angle_deg[2]; /* of the uniform ellipse with the same moments: longer, shorter */
	float peak;		 /* highest luminance in it */
	float share;		 /* of the light on a surface facing it */
	struct lp_lamp_rim rim;	 /* only if it clips, and its pixels have been seen */
	float contrast;		 /* mean luminance of its core over the surround's */
	float contrast_to_noise; /* what its core is brighter than the surround, in background_noise
				  */
	uint32_t flags;		 /* enum lp_light_flag: CLIPPED */
	int first, count;	 /* its cells: lp_lamp_finder.cells */
	int core_count;		 /* the first of them; the others are its rim */
	uint32_t known_id;	 /* of the remembered lamp whose cells these are; 0: none
				    (light/lamps/holding.h) */
};

struct lp_lamp_options {
	float min_strength; /* share of the light on a surface facing it, below which it is no lamp
			     */
	float min_contrast; /* mean luminance of its core over the surround's, likewise */
	float min_contrast_to_noise; /* what its core is brighter than the surround, in
					background_noise */
};

struct lp_lamp_finder {
	const struct lp_grid *grid; /* borrowed */
	int count;
	struct lp_lamp lamps[LP_MAX_LAMPS]; /* by luminance of irradiance, strongest first */
	int32_t *cells;			    /* cell indices, lamp after lamp: core and rim */
	int32_t *cells_before;		    /* those of the run before */

	/* workspace */
	int *reach; /* per row: columns that span about one row's height */
	int cell_count;
	uint8_t *mark;	/* per cell: what it has been taken for in this run */
	uint8_t *owner; /* per cell, for light/lamps/holding.c */
	int32_t *ring;
	float *values;
};

int lp_lamp_finder_create(const struct lp_grid *grid, struct lp_lamp_finder **finder);
void lp_lamp_finder_destroy(struct lp_lamp_finder *finder); /* accepts NULL; the grid stays */

/* Measure every region; mean: mean luminance over the sphere. Result in finder->lamps. */
void lp_find_lamps(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
		   const struct lp_regions *regions, float mean,
		   const struct lp_lamp_options *options);

/* Measure a lamp of the run before (first, count: of cells_before) over the cells that it had then.
 * False: it no longer stands out, or there is no room; else `lamp` is as it is now, not inserted.
 */
bool lp_lamp_finder_hold(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			 float mean, const struct lp_lamp_options *options, struct lp_lamp *lamp);

/* Insert by strength; the weakest falls off the end. */
void lp_lamp_insert(struct lp_lamp_finder *finder, const struct lp_lamp *lamp);

#endif
