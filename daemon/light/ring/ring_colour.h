/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The colour of what clips, by a ring that sees colours: the readings of red, green and blue are
 * fused (light/clipped/ring_fusion.h) each by itself. What a colour of the ring is worth against
 * that of the camera is learned from light that does not clip. Pure functions on plain data.
 */
#ifndef LP_LIGHT_RING_RING_COLOUR_H
#define LP_LIGHT_RING_RING_COLOUR_H

#include "light/clipped/ring_fusion.h"

/* What was learned follows by this share. */
#define LP_RING_LEARNED_SHARE 0.05F

struct lp_ring_colour {
	/* Scale of each colour over that of the luminance; sigma relative. */
	struct lp_ring_scale white[3];
	/* Red, green and blue of part j's hidden light for luminance 1. */
	float tint[LP_MAX_CLIPPED_PARTS][3];
	float tint_sigma[LP_MAX_CLIPPED_PARTS]; /* of these, root mean square over the three */
};

void lp_ring_colour_init(struct lp_ring_colour *colour);

/* Without colours: what is hidden, by `luminance`, has the part's tint. */
void lp_ring_colour_as_seen(struct lp_ring_colour *colour, const struct lp_clipped_parts *parts,
			    const struct lp_ring_fusion *luminance);

/*
 * views: of red, green and blue. `luminance`: what the same reading said of that; it AGREES.
 * learns: so little clips that the balance of the ring's colours can be learned.
 */
void lp_ring_colour_update(struct lp_ring_colour *colour, const struct lp_ring_view views[3],
			   const struct lp_ring_sample *sample,
			   const struct lp_ring_fusion *luminance,
			   const struct lp_clipped_parts *parts, bool learns);

#endif
