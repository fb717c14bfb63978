/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring_posterior.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Rounds over all unknowns: the mean is then known to a tenth of its sigma, or a fifth where parts
 * look alike. The first of them are left out. */
#define ROUNDS 600
#define FIRST 50
/* Standard deviations above the mean from where the tail is taken for that of a Rayleigh variable.
 */
#define FAR_TAIL 5.0

/* Of a scale of which nothing is known, no smaller ones than this factor count. */
#define WIDEST 3.0

/* In (0, 1), the same sequence each time: a linear congruence (Knuth's MMIX), its upper bits. */
static double next(uint64_t *state)
{
	*state = *state * 6364136223846793005ULL + 1442695040888963407ULL;
	return ((double)(*state >> 33) + 0.5) / 2147483648.0;
}

/* z with P(Z > z) = p of a standard normal variable, 0 < p <= 0.5: Abramowitz & Stegun 26.2.23, and
 * one step of Newton. */
static double upper_quantile_of_half(double p)
{
	const double t = sqrt(-2.0 * log(p));
	const double z = t - (2.515517 + t * (0.802853 + t * 0.010328)) /
				     (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
	const double above = 0.5 * erfc(z / M_SQRT2);

	return z + (above - p) * sqrt(2.0 * M_PI) * exp(z * z / 2.0);
}

static double upper_quantile(double p)
{
	return p <= 0.5 ? upper_quantile_of_half(p) : -upper_quantile_of_half(1.0 - p);
}

/* A normal variable, given that it is positive. u in (0, 1). */
static double positive_normal(double mean, double sigma, double u)
{
	const double least = -mean / sigma;

	if (least > FAR_TAIL)
		return sigma * (sqrt(least * least - 2.0 * log(u)) - least);
	return fmax(mean + sigma * upper_quantile(u * 0.5 * erfc(least / M_SQRT2)), 0.0);
}

/* One round: each unknown given all others. 1 / (x + b) is the integral of exp(-t (x + b)) over t,
 * so that given t, which is drawn first, the unknown is a normal variable that is positive. */
static void draw(const struct lp_nnls *normal, const double *bound, double *x, uint64_t *state)
{
	for (int i = 0; i < normal->count; i++) {
		const double price = i ? -log(next(state)) / (x[i] + bound[i]) : 0.0;
		double slope = normal->right[i] - price;

		for (int j = 0; j < normal->count; j++)
			slope -= j == i ? 0.0 : normal->normal[i][j] * x[j];
		x[i] = positive_normal(slope / normal->normal[i][i],
				       1.0 / sqrt(normal->normal[i][i]), next(state));
	}
}

void lp_ring_posterior(const struct lp_nnls *normal, const double *bound, const double *start,
		       struct lp_ring_posterior *posterior)
{
	const double count = ROUNDS - FIRST;
	double x[LP_NNLS_MAX], scale2 = 0.0;
	uint64_t state = 1;

	memset(posterior, 0, sizeof(*posterior));
	memcpy(x, start, sizeof(x));
	for (int round = 0; round < ROUNDS; round++) {
		draw(normal, bound, x, &state);
		if (round < FIRST)
			continue;
		const double scale = fmax(x[0], start[0] / WIDEST);

		posterior->scale += scale / count;
		scale2 += scale * scale / count;
		for (int i = 1; i < normal->count; i++) {
			posterior->mean[i] += x[i] / scale / count;
			for (int j = 1; j <= i; j++)
				posterior->covariance[i][j] +=
					x[i] / scale * (x[j] / scale) / count;
		}
	}
	posterior->scale_sigma = sqrt(fmax(scale2 - posterior->scale * posterior->scale, 0.0));
	for (int i = 1; i < normal->count; i++)
		for (int j = 1; j <= i; j++) {
			posterior->covariance[i][j] -= posterior->mean[i] * posterior->mean[j];
			posterior->covariance[j][i] = posterior->covariance[i][j];
		}
}
