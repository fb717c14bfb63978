/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What is clipped in the panorama, as a few parts: connected groups of clipped cells, those that
 * are wide split along their longest axis. Of each part only a lower bound of its light is known.
 * Storage is allocated at create(). One thread.
 */
#ifndef LP_LIGHT_CLIPPED_CLIPPED_PARTS_H
#define LP_LIGHT_CLIPPED_CLIPPED_PARTS_H

#include <stdint.h>

struct lp_grid;
struct lp_lamp_memory;
struct lp_panorama;

#define LP_MAX_CLIPPED_PARTS 16

struct lp_clipped_part {
	int first, count;   /* its cells: lp_clipped_parts.cells */
	float direction[3]; /* unit vector, of its middle */
	float solid_angle_sr;
	float spread_rad; /* root mean square angle along its longest axis */
	float bound[4];	  /* least irradiance at normal incidence: R, G, B, luminance */
	float tint[3];	  /* R, G, B of what it hides for luminance 1: as was seen of it */
	int owner;	  /* who claimed it (lp_clipped_parts_claim()); -1: nobody */
};

struct lp_clipped_parts {
	const struct lp_grid *grid; /* borrowed */
	int count;
	struct lp_clipped_part list[LP_MAX_CLIPPED_PARTS];
	int32_t *cells; /* part after part */
	uint8_t *taken; /* workspace, per cell */
	int cell_count;
};

int lp_clipped_parts_create(const struct lp_grid *grid, struct lp_clipped_parts **parts);
void lp_clipped_parts_destroy(struct lp_clipped_parts *parts); /* accepts NULL; the grid stays */

/* Begin with none. */
void lp_clipped_parts_clear(struct lp_clipped_parts *parts);

/* The clipped ones of these cells, as far as nobody has them, become one part of `owner` (>= 0),
 * such as a lamp. */
void lp_clipped_parts_claim(struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
			    const int32_t *cells, int count, int owner);

/* Begin with the lamps that are seen and clip: each becomes a part of its own, whatever it hangs
 * together with; its owner is its place in the memory. `cells`: of the lamp finder. Area
 * lights come last: a sky that a sun was once part of is held over the sun's cells, too. */
void lp_clipped_parts_of_lamps(struct lp_clipped_parts *parts, const struct lp_panorama *panorama,
			       const int32_t *cells, const struct lp_lamp_memory *memory);

/* All other clipped cells. Of more groups than there is room for the brightest are taken. */
void lp_clipped_parts_find(struct lp_clipped_parts *parts, const struct lp_panorama *panorama);

/* After the parts have been found: compact ones beside a lamp's, which are no lamps themselves,
 * become the lamp's: the ring cannot tell them apart, and a glow hides less than what glows. */
void lp_clipped_parts_give_glow(struct lp_clipped_parts *parts,
				const struct lp_lamp_memory *memory);

#endif
