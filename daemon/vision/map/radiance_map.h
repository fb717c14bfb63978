/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What is known of the light on the sphere: per cell a radiance and its variance, in a frame that
 * does not turn with the camera (the anchor frame). Every exposure is an observation that corrects
 * it, weighed by variance (a Kalman filter per cell; Kalman 1960):
 *
 *  - variance grows with time, as a random walk of the radiance would;
 *  - an observation that contradicts what is known beyond GATE sigma is a change of light: it is
 *    taken as it is, not averaged;
 *  - but not by an observation that is older than the newest one: that tells nothing of the cell;
 *  - a clipped cell is a lower bound: it never makes a known cell darker. Where nothing but bounds
 *    is known, or what is known has become vague, that of the shortest exposure counts;
 *  - a few clipped pixels do not show in the mean of a cell of middle brightness, so a longer
 *    exposure makes no cell darker that a shorter one has just seen clipped.
 *
 * One thread. All storage is allocated at create().
 */
#ifndef LP_VISION_MAP_RADIANCE_MAP_H
#define LP_VISION_MAP_RADIANCE_MAP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_grid;
struct lp_lookup;
struct lp_response;
struct lp_rotation;

#define LP_VARIANCE_UNKNOWN 1e36F

/* Exposures within this ratio are one setting. */
#define LP_SAME_EXPOSURE 1.2F

/* When more than this share of the light is another, all of it may be: a lamp that is switched
 * lights all of the room, little of it beyond doubt. Whether it does, the other cells tell. */
#define LP_MUCH_CHANGED 0.02F

/* A cell before a change of light, as it was when the change began. */
struct lp_cell_before {
	float radiance[4];
	float variance, bound_scale;
	double t_s; /* when it changed, by the map's time; below 0: not since it was forgotten */
	uint8_t flags;
};

struct lp_radiance_map {
	const struct lp_grid *grid; /* borrowed */
	float (*radiance)[4];	    /* R, G, B, luminance */
	float *variance;	    /* of the luminance; LP_VARIANCE_UNKNOWN: not known */
	uint8_t *flags;		    /* enum lp_cell_flag: UNSEEN never, CLIPPED only ever clipped */
	float *bound_scale; /* of the shortest exposure that clipped it lately; 0: none did */
	double t_s;	    /* sum of all elapsed_s */
	struct lp_cell_before *before; /* what each cell held before it last changed */
	double remembered_s;	       /* the latest time of those; below 0: there is none */
	float (*turned)[4];	       /* workspace of lp_radiance_map_turn() */
	float *turned_variance;
	uint8_t *turned_flags;
	float *turned_scale;
};

/* One exposure, on the map's grid and in its frame. All borrowed. */
struct lp_observation {
	const float (*radiance)[4];
	const uint8_t *flags; /* enum lp_cell_flag */
	const struct lp_response *response;
	float scale;	     /* full scale to radiance */
	bool coded;	     /* 8-bit codes; float frames are taken as exact */
	float code_variance; /* of a cell's mean, in codes^2 */
	float elapsed_s;     /* since the observation before */
	float flicker_sigma; /* relative 1 sigma of all light, from lamps that flicker */
	bool longer;	     /* than another exposure that has come lately */
	float late_s; /* so much older than the newest observation, which is right where they differ
		       */
	/* Squared change of luminance from cell to cell, and the variance of luminance that comes
	 * of where a cell looks; NULL: nothing turned, and each cell is one of the camera's. */
	const float *step2, *place_variance;
	/* Luminance per cell that the lens' glare had added and that has been taken off, and its
	 * variance; NULL: none has, or nobody asks for its variance. */
	const float *veil, *veil_variance;
};

/* Of one observation. */
struct lp_map_update {
	float changed;		/* luminous flux that changed at once, as a share of all */
	bool unsettled;		/* that was so much that no cell counted as certain any more */
	float clipped_fraction; /* of the sphere: cells that are only a lower bound */
	float unseen_fraction;	/* of the sphere: never seen */
	float filled_fraction;	/* of the sphere: nothing is known but what neighbours show */
	/* 1 sigma of the irradiance on a surface, root mean square over all normals, from the
	 * cells' variances; relative to the mean irradiance. Clipped and unseen cells are not in
	 * it. */
	float irradiance_sigma;
	float clipped_share; /* of the flux known: what clipped cells hold at least */
};

int lp_radiance_map_create(const struct lp_grid *grid, struct lp_radiance_map **map);
void lp_radiance_map_destroy(struct lp_radiance_map *map); /* accepts NULL */

/* Nothing is known. */
void lp_radiance_map_forget(struct lp_radiance_map *map);

/* Nothing is known of one cell. */
void lp_radiance_map_forget_cell(struct lp_radiance_map *map, int cell);

struct lp_map_update lp_radiance_map_observe(struct lp_radiance_map *map,
					     const struct lp_observation *observation);

/* Share of the cells (by solid angle, of a sample of rows) of which the observation says something
 * else than what is known. The map stays as it is. */
float lp_radiance_map_contradicting(const struct lp_radiance_map *map,
				    const struct lp_observation *observation);

/* Radiance (R, G, B, luminance) that the cell held before it changed, if that was no more than
 * `most_s` ago; else what it holds. */
const float *lp_radiance_map_before(const struct lp_radiance_map *map, int cell, double most_s);

/* The cell gets back what it held before it changed, if that was no more than `most_s` ago. */
void lp_radiance_map_restore(struct lp_radiance_map *map, int cell, double most_s);

/* Turn the map's own frame: afterwards a cell holds what lay along `rotation` times its direction.
 * lookup: workspace, its coordinates are overwritten. */
void lp_radiance_map_turn(struct lp_radiance_map *map, struct lp_lookup *lookup,
			  const struct lp_rotation *rotation);

#ifdef __cplusplus
}
#endif

#endif
