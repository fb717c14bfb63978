/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What could explain the readings of a ring: light that hides in clipped parts, together with a
 * ring as it should be, another scale than the one given, sensors that are wrong, or a ring that
 * is turned about its axis by places of its sensors. Part of light/clipped/ring_fusion.h. Pure.
 */
#ifndef LP_LIGHT_CLIPPED_RING_EXPLAIN_H
#define LP_LIGHT_CLIPPED_RING_EXPLAIN_H

#include <stdbool.h>
#include <stdint.h>

#include "light/clipped/ring_residuals.h"

/* The ring as it is and with another scale: all sensors, and one, two or three left out, or two or
 * three neighbours; turned. */
#define LP_RING_EXPLANATIONS (2 * (1 + 9 + 8 + 7 + 2 * 8) + 7)

struct lp_ring_explanation {
	uint32_t used; /* bit k: sensor k counts */
	int places;    /* by which the ring is turned to the right; 0: it is not */
	bool other_scale;
	/* In squared sigmas: what it leaves unexplained, and how unlikely it is beforehand; and how
	 * unlikely the light is that it needs. */
	double cost, price;
	double chi2, misfit_now, freedom; /* of its fit */
};

/* Fits them all; `all`: bit k: sensor k can be used. Returns how many; the first one is the ring as
 * it should be. */
int lp_ring_explain(const struct lp_ring_problem *problem, uint32_t all,
		    struct lp_ring_explanation list[LP_RING_EXPLANATIONS]);

/* Readings and view as an explanation has them: of a ring that is turned, and without what parts
 * bring that no sensor sees which counts. */
struct lp_ring_case {
	struct lp_ring_sample sample;
	struct lp_ring_view view;
	struct lp_ring_past past;
	struct lp_ring_problem problem; /* borrows the three above */
};

void lp_ring_case_init(struct lp_ring_case *self, const struct lp_ring_problem *problem,
		       const struct lp_ring_explanation *explanation);

/* Whether one of these sensors sees, or saw, part j well enough to tell its light. */
bool lp_ring_sees(const struct lp_ring_view *view, const struct lp_ring_past *past, int j,
		  uint32_t used);

#endif
