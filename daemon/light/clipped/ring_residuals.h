/* SPDX-License-Identifier: Apache-2.0 */
/* One fit of light/clipped/ring_fusion.h to some of the sensors. */
#ifndef LP_LIGHT_CLIPPED_RING_RESIDUALS_H
#define LP_LIGHT_CLIPPED_RING_RESIDUALS_H

#include <stdint.h>

#include "light/clipped/ring_fusion.h"
#include "light/linear/nnls.h"

struct lp_ring_problem {
	const struct lp_ring_view *view;
	const struct lp_ring_sample *sample;
	const struct lp_ring_past *past; /* NULL: none */
	struct lp_ring_scale scale;	 /* as known before */
};

/* Unknown 0 is the scale s, in lux per unit; unknown 1 + j is s x_j, in lux. */
struct lp_ring_fit {
	uint32_t used; /* bit k: sensor k counts */
	double x[LP_NNLS_MAX];
	double scale_variance; /* of x[0] */
	double chi2;	       /* squared residuals in sigmas, the scale's included */
	double misfit_now;     /* the same of the newest reading alone, without the scale's */
	double price;	       /* what hidden light costs beforehand, in squared sigmas */
	double freedom;	       /* number of residuals less unknowns, at least 1 */
};

void lp_ring_fit(const struct lp_ring_problem *problem, uint32_t used, struct lp_ring_fit *fit);

/* The normal equations that the fit has solved, without its prices; what a part was seen of, in
 * lux, is bound[1 + j]. */
void lp_ring_normal(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit,
		    struct lp_nnls *normal, double bound[LP_NNLS_MAX]);

#endif
