/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring_fusion.h"

#include <math.h>

#include "light/nnls.h"
#include "light/ring_posterior.h"
#include "light/ring_residuals.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* Squared sigmas that a fit must gain to be worth a sensor that is left out, or another scale. */
#define WORTH 16.0
/* Likewise to be worth any hidden light at all, and all that explains the readings. */
#define WORTH_LITTLE 1.0
#define WORTH_LIGHT 4.0
/* Likewise to say that the ring is turned. Where it is not, no other place does better by more than
 * 6 on those scenes. */
#define WORTH_TURNED 10.0
/* Sensors that may be left out. */
#define MOST_WRONG 3
#define LEAST_USED 4
/* Squared sigmas per degree of freedom, and altogether, beyond which the ring is not believed. */
#define MOST_MISFIT 4.0
#define ALWAYS_ALLOWED 9.0
/* Of a scale of which nothing is known, no smaller ones than this factor count. */
#define WIDEST 3.0
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
	return fit->chi2 + fit->price + WORTH * bits(all & ~fit->used);
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

/* By how many places the ring seems to be turned, and what it costs then. */
static int places_turned(const struct lp_ring_problem *problem, double *least)
{
	int found = 0;

	*least = INFINITY;
	for (int places = 1; places < LP_RING_SENSORS - 1; places++) {
		struct lp_ring_sample turned;
		struct lp_ring_problem other = *problem;
		struct lp_ring_fit fit;

		turn(problem->sample, places, &turned);
		other.sample = &turned;
		lp_ring_fit(&other, usable(&turned), &fit);
		if (believed(&fit) && fit.chi2 + fit.price < *least) {
			*least = fit.chi2 + fit.price;
			found = places;
		}
	}
	return found;
}

/* What agrees best with the readings, and how far all else that agrees with them lies from it. */
static void take(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit,
		 struct lp_ring_fusion *fusion)
{
	struct lp_ring_posterior posterior;
	double bound[LP_NNLS_MAX] = {0.0}, off[LP_NNLS_MAX];
	struct lp_nnls normal;
	const double s = fit->x[0];

	if (!(s > 0.0))
		return;
	lp_ring_normal(problem, fit, &normal, bound);
	if (isnan(problem->scale.lux_per_unit))
		bound[0] = s / WIDEST;
	lp_ring_posterior(&normal, bound, &posterior);
	fusion->scale = (struct lp_ring_scale){(float)s, (float)(sqrt(fit->covariance[0][0]) / s)};
	for (int i = 0; i < problem->view->count; i++) {
		fusion->excess[i] = (float)(fit->x[i + 1] / s);
		off[i] = posterior.mean[i + 1] - (double)fusion->excess[i];
	}
	for (int i = 0; i < problem->view->count; i++) {
		for (int j = 0; j < problem->view->count; j++)
			fusion->covariance[i][j] =
				(float)(posterior.covariance[i + 1][j + 1] + off[i] * off[j]);
		fusion->sigma[i] = sqrtf(fusion->covariance[i][i]);
	}
}

/* How many squared sigmas the readings are worse understood without any hidden light. */
static double evidence(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit)
{
	struct lp_ring_view view = *problem->view;
	struct lp_ring_problem plain = *problem;
	struct lp_ring_fit without;

	view.count = 0;
	plain.view = &view;
	lp_ring_fit(&plain, fit->used, &without);
	return without.chi2 - fit->chi2;
}

/* Several unknowns explain noise together, and hide light at the wrong place: they count as far as
 * the evidence for them goes (after James & Stein 1961: of p unknowns that explain chi2, the share
 * 1 - p / chi2). So does one alone, up to WORTH_LIGHT. What is held back is uncertainty. */
static void hold_back(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit,
		      struct lp_ring_fusion *fusion)
{
	const double gain = evidence(problem, fit);
	int unknowns = 0;

	for (int j = 0; j < problem->view->count; j++)
		unknowns += fit->x[j + 1] > 0.0;
	const double worth =
		fmin(fmax((gain - WORTH_LITTLE) / (WORTH_LIGHT - WORTH_LITTLE), 0.0), 1.0);
	const double share = worth * (unknowns > 1 ? fmax(1.0 - unknowns / gain, 0.0) : 1.0);

	for (int i = 0; i < problem->view->count; i++)
		for (int j = 0; j < problem->view->count; j++)
			fusion->covariance[i][j] += (float)((1.0 - share) * (1.0 - share)) *
						    fusion->excess[i] * fusion->excess[j];
	for (int i = 0; i < problem->view->count; i++) {
		fusion->excess[i] *= (float)share;
		fusion->sigma[i] = sqrtf(fusion->covariance[i][i]);
	}
}

/* The fit with another scale than the one that was given; false: none was given. */
static bool fit_with_another_scale(const struct lp_ring_problem *problem, uint32_t all,
				   struct lp_ring_problem *wide, struct lp_ring_fit *fit)
{
	if (isnan(problem->scale.lux_per_unit))
		return false;
	*wide = *problem;
	wide->scale.sigma = WIDE_SIGMA;
	fit_robustly(wide, all, fit);
	return true;
}

/* What explains the readings at the least cost: the ring as it should be, another scale, or a ring
 * that is turned. Where the last two do about as well, nothing is believed. */
static void choose(struct lp_ring_problem *problem, uint32_t all, struct lp_ring_fit *fit,
		   struct lp_ring_fusion *fusion)
{
	struct lp_ring_problem wide;
	struct lp_ring_fit other;
	double turned;
	const int places = places_turned(problem, &turned);
	double least = cost(fit, all);

	fusion->verdict = LP_RING_AGREES;
	if (fit_with_another_scale(problem, all, &wide, &other) &&
	    cost(&other, all) + WORTH < least) {
		least = cost(&other, all) + WORTH;
		fusion->scale_is_wrong = true;
		*problem = wide;
		*fit = other;
	}
	if (turned + WORTH_TURNED < least) {
		fusion->verdict = LP_RING_TURNED;
		fusion->turned_deg = 45.0F * (float)(places <= 4 ? places : places - 8);
		fusion->scale_is_wrong = false;
	} else if (!believed(fit) || (fusion->scale_is_wrong && turned < least)) {
		fusion->verdict = LP_RING_DISAGREES;
	}
}

void lp_ring_fuse(const struct lp_ring_view *view, const struct lp_ring_sample *sample,
		  const struct lp_ring_scale *known, struct lp_ring_fusion *fusion)
{
	struct lp_ring_problem problem = {.view = view, .sample = sample, .scale = *known};
	const uint32_t all = usable(sample);
	struct lp_ring_fit fit;

	*fusion = (struct lp_ring_fusion){.scale = *known};
	if (bits(all) < LEAST_USED)
		return;
	fit_robustly(&problem, all, &fit);
	choose(&problem, all, &fit, fusion);
	fusion->misfit = (float)(fit.chi2 / fit.freedom);
	if (fusion->verdict != LP_RING_TURNED)
		fusion->wrong = all & ~fit.used;
	if (fusion->verdict != LP_RING_AGREES)
		return;
	take(&problem, &fit, fusion);
	hold_back(&problem, &fit, fusion);
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
