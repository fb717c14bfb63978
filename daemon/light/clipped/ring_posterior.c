/* SPDX-License-Identifier: Apache-2.0 */
#include "light/clipped/ring_posterior.h"

#include <math.h>
#include <string.h>

#include "light/clipped/ring_fusion.h"

/* Most often six sweeps are enough; where the posterior has several peaks, it may take more. */
#define SWEEPS 20
/* It ends when no mean has moved by more than this, in its sigmas. */
#define SETTLED 0.05
/* Steps that are too long swing. */
#define FIRST_STEP 0.8
#define LATER_STEP 0.4
#define FIRST_SWEEPS 8
/* Points of the sums over one unknown; they are so many sigmas wide on each side. */
#define POINTS 28
#define REACH 7.0
/* At first an unknown is expected to be about so many bounds. */
#define TYPICAL 30.0
/* A prior may make an unknown less certain than the readings do alone (there may be no light at
 * all), but takes no more than this share of their precision. */
#define MOST_DOUBT 0.3

/* In the place of the prior of unknown i: exp(-precision x^2 / 2 + shift x). */
struct state {
	const struct lp_nnls *normal;
	const double *bound;
	double precision[LP_NNLS_MAX], shift[LP_NNLS_MAX];
	double mean[LP_NNLS_MAX], covariance[LP_NNLS_MAX][LP_NNLS_MAX];
};

struct moments {
	double mean, variance;
};

/* Of N(x; mean, variance) / (x + bound), x > 0. In log(x + bound), in which the prior is flat, few
 * points are enough for any ratio of sigma and bound. */
static struct moments with_prior(struct moments gauss, double bound)
{
	const double reach2 = REACH * REACH * gauss.variance;
	const double below = fmin(gauss.mean, 0.0), inside = fmax(gauss.mean, 0.0);
	const double low = fmax(gauss.mean - sqrt(reach2), 0.0);
	/* where the density is as small against that at 0 as it is at REACH against that at the
	 * mean */
	const double high = gauss.mean + sqrt(below * below + reach2);
	const double step = (log1p(high / bound) - log1p(low / bound)) / POINTS;
	const double ratio = exp(step), scale = -0.5 / gauss.variance;
	double point = (low + bound) * exp(step / 2.0), sums[3] = {0.0};

	for (int i = 0; i < POINTS; i++) {
		const double off = point - bound - gauss.mean;
		const double p = exp(scale * (off * off - below * below));
		const double x = point - bound - inside;

		sums[0] += p;
		sums[1] += p * x;
		sums[2] += p * x * x;
		point *= ratio;
	}
	const double mean = sums[1] / sums[0];

	return (struct moments){inside + mean,
				fmax(sums[2] / sums[0] - mean * mean, 1e-12 * gauss.variance)};
}

/* Mean and covariance by the normal equations and what stands for the priors. */
static void solve(struct state *s)
{
	const int n = s->normal->count;
	struct lp_nnls sum = *s->normal;
	double all[LP_NNLS_MAX] = {0.0};

	for (int i = 0; i < n; i++) {
		sum.normal[i][i] += s->precision[i];
		all[i] = 1.0;
	}
	lp_nnls_covariance(&sum, all, s->covariance);
	for (int i = 0; i < n; i++) {
		s->mean[i] = 0.0;
		for (int j = 0; j < n; j++)
			s->mean[i] += s->covariance[i][j] * (sum.right[j] + s->shift[j]);
	}
}

/* What the unknown's own Gaussian becomes by so much more changes all others. (Sherman & Morrison
 * 1950.) */
static void change(struct state *s, int i, double precision, double shift)
{
	const int n = s->normal->count;
	const double less = precision / (1.0 + precision * s->covariance[i][i]);
	const double more = shift * (1.0 - less * s->covariance[i][i]) - less * s->mean[i];
	double column[LP_NNLS_MAX];

	for (int j = 0; j < n; j++)
		column[j] = s->covariance[i][j];
	for (int j = 0; j < n; j++) {
		s->mean[j] += more * column[j];
		for (int k = 0; k < n; k++)
			s->covariance[j][k] -= less * column[j] * column[k];
	}
	s->precision[i] += precision;
	s->shift[i] += shift;
}

/* Returns by how many sigmas the mean was off. */
static double match(struct state *s, int i, double step)
{
	const double variance = s->covariance[i][i];
	/* all but its own prior; the rest knows something, as `normal` is proper */
	const double rest = fmax(1.0 / variance - s->precision[i], 1e-9 / variance);
	const double mean = (s->mean[i] / variance - s->shift[i]) / rest;
	const struct moments found = with_prior((struct moments){mean, 1.0 / rest}, s->bound[i]);
	const double precision = fmax(1.0 / found.variance - rest, -MOST_DOUBT * rest);
	const double shift = found.mean * (precision + rest) - mean * rest;
	const double off = fabs(found.mean - s->mean[i]) / sqrt(found.variance);

	change(s, i, step * (precision - s->precision[i]), step * (shift - s->shift[i]));
	return off;
}

static void propagate(struct state *s)
{
	for (int sweep = 0; sweep < SWEEPS; sweep++) {
		double most = 0.0;

		for (int i = 0; i < s->normal->count; i++)
			if (s->bound[i] > 0.0)
				most = fmax(most,
					    match(s, i,
						  sweep < FIRST_SWEEPS ? FIRST_STEP : LATER_STEP));
		if (most < SETTLED)
			return;
	}
}

/* Light over scale, to first order. */
static void divide(const struct state *s, struct lp_ring_posterior *posterior)
{
	const int n = s->normal->count;
	const double scale = posterior->scale;

	for (int i = 1; i < n; i++)
		posterior->mean[i] = fmax(s->mean[i], 0.0) / scale;
	for (int i = 1; i < n; i++)
		for (int j = 1; j < n; j++) {
			const double a = posterior->mean[i], b = posterior->mean[j];

			posterior->covariance[i][j] =
				(s->covariance[i][j] - a * s->covariance[0][j] -
				 b * s->covariance[0][i] + a * b * s->covariance[0][0]) /
				(scale * scale);
		}
}

void lp_ring_posterior(const struct lp_nnls *normal, const double *bound,
		       struct lp_ring_posterior *posterior)
{
	struct state s = {.normal = normal, .bound = bound};

	memset(posterior, 0, sizeof(*posterior));
	for (int i = 0; i < normal->count; i++)
		if (bound[i] > 0.0)
			s.precision[i] = 1.0 / (TYPICAL * TYPICAL * bound[i] * bound[i]);
	solve(&s);
	propagate(&s);
	solve(&s); /* what the changes have rounded off */
	posterior->scale =
		fmax(s.mean[0], LP_RING_LEAST_SCALE * normal->right[0] / normal->normal[0][0]);
	posterior->scale_sigma = sqrt(s.covariance[0][0]);
	divide(&s, posterior);
}
