/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Every camera ends as one small panorama: an equirectangular grid of linear radiance in the probe
 * frame. Everything after it knows this one geometry.
 *
 * Cell (column c, row r) looks along d = (sin t sin l, cos t, -sin t cos l), t = pi (r + 1/2) / H,
 * l = 2 pi ((c + 1/2) / W - 1/2): the centre of the grid is -Z, columns grow to the right, row 0 is
 * up.
 */
#ifndef LP_PANORAMA_H
#define LP_PANORAMA_H

#include <stdint.h>

#define LP_PANORAMA_WIDTH 240
#define LP_PANORAMA_MAX_WIDTH 960

enum lp_cell_flag {
	LP_CELL_CLIPPED = 1 << 0, /* saturated in every exposure: radiance is a lower bound */
	LP_CELL_UNSEEN = 1 << 1,  /* no camera pixel looks here: 0 in the map; for the estimate the
				   * mean of the rest (estimate/pipeline.c) */
	LP_CELL_BESIDE = 1 << 2,  /* of a turned picture: next to a marked cell, whose light may lie
				   * anywhere within it */
	LP_CELL_COVERED = 1 << 3, /* of a picture: something before the lens hides it */
	LP_CELL_BESIDE_DARK = 1 << 4, /* BESIDE one that is not seen, or covered: may be brighter */
	LP_CELL_FILLED = 1 << 5, /* of a picture: its pixels shine by themselves, and it shows what
				  * its neighbours do */
};

/*
 * width * height cells, row-major, each R, G, B (linear radiance, Rec. 709 primaries) and
 * luminance; owned by whoever created the panorama (vision). Radiance in units of
 * docs/users/conventions.md (full scale at one second, or the file's own).
 */
struct lp_panorama {
	int width, height; /* width = 2 * height, width a multiple of 4 */
	float (*cells)[4];
	uint8_t *flags;		/* enum lp_cell_flag per cell */
	int64_t t_capture_ns;	/* CLOCK_MONOTONIC, mid-exposure of the newest frame in it */
	float clipped_fraction; /* of the sphere's solid angle */
	float seen_fraction;	/* of the sphere's solid angle */
};

#endif
