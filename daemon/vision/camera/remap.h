/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From the camera's cells to the panorama: a sparse matrix, built once per camera and picture size.
 * Each panorama cell is the solid-angle weighted mean of what it sees: a uniform scene stays
 * uniform, and the light of every camera cell is kept.
 */
#ifndef LP_VISION_CAMERA_REMAP_H
#define LP_VISION_CAMERA_REMAP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lp_camera;
struct lp_cells;
struct lp_panorama;

/* Rows with up to so many entries have loops of their own. */
#define LP_REMAP_SHORT 4

/*
 * Compressed rows, the shortest first: row i is panorama cell order[i], its entries first[i] ..
 * first[i + 1] - 1. Immutable.
 */
struct lp_remap {
	int width, height;		  /* of the panorama */
	int width_px, height_px, cell_px; /* of the picture it was built for */
	bool identity;			  /* the camera's cells are the panorama's */
	int *order, *first;
	int rows_end[LP_REMAP_SHORT + 1]; /* rows with up to n entries end before rows_end[n] */
	int *row;			  /* of a panorama cell */
	int *source;			  /* camera cell */
	float *weight;	  /* includes division by the lens's relative illumination */
	float *given_sr;  /* per camera cell: weight times solid angle that the panorama takes from
			     it */
	uint8_t *seen;	  /* which camera cells the panorama takes from (vision/picture/cells.h) */
	uint8_t *unseen;  /* flags of a picture without clipped cells */
	float *row_share; /* where in the picture a panorama cell is seen: -1/2 its upper edge, 1/2
			     the lower; 0 where it is not */
	int sources;	  /* camera cells */
	int *target_first, *target; /* panorama cells that take from camera cell k: from
				       target_first[k] to before target_first[k + 1] */
	float seen_fraction;	    /* of the sphere's solid angle */
};

/* Entries of a panorama cell: from *k to before *end. */
static inline void lp_remap_entries(const struct lp_remap *remap, int cell, int *k, int *end)
{
	*k = remap->first[remap->row[cell]];
	*end = remap->first[remap->row[cell] + 1];
}

int lp_remap_create(const struct lp_camera *camera, int width_px, int height_px, int cell_px,
		    int panorama_width, struct lp_remap **remap);
void lp_remap_destroy(struct lp_remap *remap); /* accepts NULL */

/* Fill cells, flags and fractions of `panorama` (of the remap's size). Cells that nothing sees are
 * 0 and flagged. Of an identity the cells and flags must be the camera's own already, and stay
 * untouched. */
void lp_remap_apply(const struct lp_remap *remap, const struct lp_cells *cells,
		    struct lp_panorama *panorama);

#ifdef __cplusplus
}
#endif

#endif
