/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring_fusion.h"

#include <math.h>
#include <string.h>

#include "light/nnls.h"
#include "light/ring_residuals.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* Squared sigmas that a fit must gain to be worth a sensor that is left out, or another scale. */
#define WORTH 16.0
/* Likewise to be worth any hidden light at all. */
#define WORTH_LIGHT 3.0
/* Sensors that may be left out. */
#define MOST_WRONG 3
#define LEAST_USED 4
/* Squared sigmas per degree of freedom, and altogether, beyond which the ring is not believed. */
#define MOST_MISFIT 4.0
#define ALWAYS_ALLOWED 9.0
/* A scale that contradicts the readings may be off by this factor, 1 sigma, relative. */
#define WIDE_SIGMA 1.0F

static int bits(uint32_t mask)
{
	return __builtin_popcount(mask);
}

static uint32_t usable(const struct lp_ring_sample *sample)
{
	uint32_t mask = 0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (isfinite(sample->illuminance_lux[k]) && sample->illuminance_lux[k] >= 0.0F &&
		    isfinite(sample->sigma_relative[k]) && sample->sigma_relative[k] > 0.0F)
			mask |= 1U << k;
	return mask;
}

/* What the fit costs, in squared sigmas; sensors that are left out are not free. */
static double cost(const struct lp_ring_fit *fit, uint32_t all)
{
	return fit->chi2 + WORTH * bits(all & ~fit->used);
}

/* Leave out the sensor that the others contradict most, again and again, as long as it is worth it.
 */
static void fit_robustly(const struct lp_ring_problem *problem, uint32_t all,
			 struct lp_ring_fit *fit)
{
	lp_ring_fit(problem, all, fit);
	while (bits(all & ~fit->used) < MOST_WRONG && bits(fit->used) > LEAST_USED &&
	       fit->chi2 > WORTH) {
		struct lp_ring_fit best = {.chi2 = INFINITY};

		for (int k = 0; k < LP_RING_SENSORS; k++) {
			struct lp_ring_fit without;

			if (!(fit->used >> k & 1))
				continue;
			lp_ring_fit(problem, fit->used & ~(1U << k), &without);
			if (without.chi2 < best.chi2)
				best = without;
		}
		if (!(best.chi2 + WORTH < fit->chi2))
			return;
		*fit = best;
	}
}

static bool believed(const struct lp_ring_fit *fit)
{
	return fit->chi2 <= ALWAYS_ALLOWED + MOST_MISFIT * fit->freedom;
}

/* The eight sensors around the equator, as they would read if the ring were turned to the right by
 * so many of their places. */
static void turn(const struct lp_ring_sample *sample, int places, struct lp_ring_sample *turned)
{
	const int around = LP_RING_SENSORS - 1;

	*turned = *sample;
	for (int k = 0; k < around; k++) {
		turned->illuminance_lux[(k + places) % around] = sample->illuminance_lux[k];
		turned->sigma_relative[(k + places) % around] = sample->sigma_relative[k];
	}
}

/* By how many places the ring seems to be turned; 0: by none. A turn must cost less than `least`.
 */
static int places_turned(const struct lp_ring_problem *problem, double least)
{
	int found = 0;

	for (int places = 1; places < LP_RING_SENSORS - 1; places++) {
		struct lp_ring_sample turned;
		struct lp_ring_problem other = *problem;
		struct lp_ring_fit fit;

		turn(problem->sample, places, &turned);
		other.sample = &turned;
		lp_ring_fit(&other, usable(&turned), &fit);
		if (believed(&fit) && fit.chi2 < least) {
			least = fit.chi2;
			found = places;
		}
	}
	return found;
}

/* From lux to the camera's units: x = z / s. */
static void take(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit,
		 struct lp_ring_fusion *fusion)
{
	const double s = fit->x[0], var_s = fit->covariance[0][0];

	if (!(s > 0.0))
		return;
	fusion->scale = (struct lp_ring_scale){(float)s, (float)(sqrt(var_s) / s)};
	for (int i = 0; i < problem->view->count; i++) {
		const double xi = fit->x[i + 1] / s;

		fusion->excess[i] = (float)xi;
		for (int j = 0; j < problem->view->count; j++) {
			const double xj = fit->x[j + 1] / s;
			const double shared = fit->covariance[i + 1][j + 1] -
					      xi * fit->covariance[0][j + 1] -
					      xj * fit->covariance[0][i + 1] + xi * xj * var_s;

			fusion->covariance[i][j] = (float)(shared / (s * s));
		}
		if (!(fit->x[i + 1] > 0.0)) /* it may still be something: one-sided */
			fusion->covariance[i][i] = (float)(fit->bound_sigma[i + 1] *
							   fit->bound_sigma[i + 1] / (s * s));
		fusion->sigma[i] = sqrtf(fmaxf(fusion->covariance[i][i], 0.0F));
	}
}

/* Whether the readings can be understood without any hidden light: then nothing is changed. */
static bool nothing_hides(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit)
{
	struct lp_ring_view view = *problem->view;
	struct lp_ring_problem plain = *problem;
	struct lp_ring_fit without;

	view.count = 0;
	plain.view = &view;
	lp_ring_fit(&plain, fit->used, &without);
	return without.chi2 < fit->chi2 + WORTH_LIGHT;
}

/* What was found is no more than noise could be: it is uncertainty. */
static void doubt(struct lp_ring_fusion *fusion)
{
	for (int i = 0; i < LP_MAX_CLIPPED_PARTS; i++) {
		fusion->covariance[i][i] += fusion->excess[i] * fusion->excess[i];
		fusion->sigma[i] = sqrtf(fusion->covariance[i][i]);
		fusion->excess[i] = 0.0F;
	}
}

/* The scale that was given may be wrong: try without. True: that is worth it. */
static bool try_another_scale(struct lp_ring_problem *problem, uint32_t all,
			      struct lp_ring_fit *fit)
{
	struct lp_ring_problem wide = *problem;
	struct lp_ring_fit other;

	if (isnan(problem->scale.lux_per_unit))
		return false;
	wide.scale.sigma = WIDE_SIGMA;
	fit_robustly(&wide, all, &other);
	if (cost(&other, all) + WORTH > cost(fit, all))
		return false;
	*problem = wide;
	*fit = other;
	return true;
}

void lp_ring_fuse(const struct lp_ring_view *view, const struct lp_ring_sample *sample,
		  const struct lp_ring_scale *known, struct lp_ring_fusion *fusion)
{
	struct lp_ring_problem problem = {.view = view, .sample = sample, .scale = *known};
	const uint32_t all = usable(sample);
	struct lp_ring_fit fit;
	int places = 0;

	*fusion = (struct lp_ring_fusion){.scale = *known};
	if (bits(all) < LEAST_USED)
		return;
	fit_robustly(&problem, all, &fit);
	if (fit.used != all || !believed(&fit)) {
		fusion->scale_is_wrong = try_another_scale(&problem, all, &fit);
		places = places_turned(&problem, cost(&fit, all) - WORTH);
	}
	fusion->misfit = (float)(fit.chi2 / fit.freedom);
	if (places) {
		fusion->verdict = LP_RING_TURNED;
		fusion->turned_deg = 45.0F * (float)(places <= 4 ? places : places - 8);
		fusion->scale_is_wrong = false;
		return;
	}
	fusion->wrong = all & ~fit.used;
	fusion->verdict = believed(&fit) ? LP_RING_AGREES : LP_RING_DISAGREES;
	if (fusion->verdict != LP_RING_AGREES)
		return;
	take(&problem, &fit, fusion);
	if (nothing_hides(&problem, &fit))
		doubt(fusion);
}

float lp_ring_variance(const struct lp_ring_fusion *fusion, const struct lp_clipped_parts *parts)
{
	double sum = 0.0;

	/* mean over n of max(0, n.a) max(0, n.b): the arc-cosine kernel (Cho & Saul 2009, n = 1) */
	for (int i = 0; i < parts->count; i++)
		for (int j = 0; j < parts->count; j++) {
			const float *a = parts->list[i].direction, *b = parts->list[j].direction;
			const double cosine = fmin(fmax((double)a[0] * b[0] + (double)a[1] * b[1] +
								(double)a[2] * b[2],
							-1.0),
						   1.0);
			const double angle = acos(cosine);

			sum += fusion->covariance[i][j] * (sin(angle) + (M_PI - angle) * cosine) /
			       (6.0 * M_PI);
		}
	return (float)fmax(sum, 0.0);
}
