/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How much light clipped parts hide, and how sure that is: mean and covariance of everything that
 * agrees with the readings, not the one solution that agrees best. Of parts that look alike to the
 * sensors, or that hardly any sensor sees, the best solution says nothing of the others. Pure.
 */
#ifndef LP_LIGHT_CLIPPED_RING_POSTERIOR_H
#define LP_LIGHT_CLIPPED_RING_POSTERIOR_H

#include "light/linear/nnls.h"

/* Unknowns as in struct lp_ring_fit: 0 is the scale, 1 + j the light of part j, in lux. */
struct lp_ring_posterior {
	double scale, scale_sigma;
	/* Of part j's light over the scale: in the camera's units. */
	double mean[LP_NNLS_MAX], covariance[LP_NNLS_MAX][LP_NNLS_MAX];
};

/*
 * `normal`: normal equations of readings and scale, proper. Beforehand part j's light is as likely
 * to lie in any of its powers of ten above bound[1 + j] > 0, in lux: p(x) ~ 1 / (x + bound), x >=
 * 0. The scale has such a prior too where bound[0] > 0, and none besides that of `normal` where it
 * is 0. By expectation propagation (Minka 2001): each prior is replaced by the Gaussian with which
 * the unknown has the same mean and variance as with the prior itself.
 */
void lp_ring_posterior(const struct lp_nnls *normal, const double *bound,
		       struct lp_ring_posterior *posterior);

#endif
