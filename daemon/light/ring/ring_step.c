/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_step.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "light/linear/nnls.h"

/* Chosen by hand (docs/maintainers/constants.md). */

/* Light that a room throws back on every sensor, of the lamp's irradiance, 1 sigma: as much in the
 * mean over all directions as the lamp brings itself, a quarter. */
#define INDIRECT 0.25
/* How well the pattern of a lamp over the sensors is known: seats, cosine error; of its change. */
#define PATTERN_SIGMA 0.05
/* An explanation must reduce the squared sigmas by WORTH; a change of less than LEAST_CHANGE of the
 * mean light is not explained at all. */
#define WORTH 16.0
#define LEAST_CHANGE 0.02
/* What an explanation costs beforehand, in squared sigmas: a sensor that is shadowed; a second
 * lamp; light from no lamp that is known; a lamp that is dimmed instead of switched, at most. */
#define COST_SHADOW 5.0
#define COST_SECOND 8.0
#define COST_NOWHERE 8.0
#define COST_DIMMED 4.0
/* A lamp that is switched has its usual light within this, relative. */
#define USUAL_SIGMA 0.1
/* An explanation that leaves more squared sigmas than this per sensor is dropped. */
#define MOST_MISFIT 3.0
/* Where a lamp grazes a sensor, or hardly misses it, its pattern is the less certain. */
#define GRAZING 0.2
/* Weights depend on the solution. */
#define ROUNDS 3

#define COLUMNS 9
#define TURN 3

struct column {
	double value[LP_RING_SENSORS];
	double prior_sigma; /* 0: anything */
};

/* One explanation and how well it does. */
struct fit {
	int source[2]; /* -1: none */
	int own;       /* columns before those of the turn */
	bool is_all, is_nowhere;
	double x[COLUMNS], variance[COLUMNS];
	double cost, misfit;
};

static bool is_known(const struct lp_step_question *q, int k)
{
	return isfinite(q->change[k]) && q->sigma[k] > 0.0F;
}

static double square(double x)
{
	return x * x;
}

/* x minimises the squared residuals, the priors' included; returns them. INFINITY: there is none;
 * x is 0. */
static double solve(const struct lp_step_question *q, uint32_t used, const double *variance,
		    const struct column *columns, int count, struct fit *fit)
{
	const double all[LP_NNLS_MAX] = {1, 1, 1, 1, 1, 1, 1, 1, 1};
	double covariance[LP_NNLS_MAX][LP_NNLS_MAX], chi2 = 0.0;
	struct lp_nnls normal = {.count = count};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		if (!(used >> k & 1))
			continue;
		for (int i = 0; i < count; i++) {
			normal.right[i] += columns[i].value[k] * q->change[k] / variance[k];
			for (int j = 0; j < count; j++)
				normal.normal[i][j] +=
					columns[i].value[k] * columns[j].value[k] / variance[k];
		}
	}
	for (int i = 0; i < count; i++) { /* the last: columns that look alike */
		if (columns[i].prior_sigma > 0.0)
			normal.normal[i][i] += 1.0 / square(columns[i].prior_sigma);
		normal.normal[i][i] += 1e-9 * normal.normal[i][i] + 1e-30;
	}
	const bool is_proper = lp_nnls_covariance(&normal, all, covariance);

	for (int i = 0; i < count; i++) {
		fit->x[i] = 0.0;
		for (int j = 0; j < count; j++)
			fit->x[i] += covariance[i][j] * normal.right[j];
		fit->variance[i] = covariance[i][i];
		if (columns[i].prior_sigma > 0.0)
			chi2 += square(fit->x[i] / columns[i].prior_sigma);
	}
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		double left = q->change[k];

		for (int i = 0; i < count; i++)
			left -= fit->x[i] * columns[i].value[k];
		if (used >> k & 1)
			chi2 += square(left) / variance[k];
	}
	return is_proper ? chi2 : INFINITY;
}

static void add_turn(const struct lp_step_question *q, struct column *columns)
{
	for (int a = 0; a < TURN; a++) {
		for (int k = 0; k < LP_RING_SENSORS; k++)
			columns[a].value[k] = q->turn[a][k];
		columns[a].prior_sigma = fmax(q->turn_sigma_rad, 1e-6);
	}
}

/* Nothing but noise and a turn, for the sensors in `used`. */
static double cost_of_nothing(const struct lp_step_question *q, uint32_t used)
{
	struct column columns[COLUMNS];
	double variance[LP_RING_SENSORS];
	struct fit fit;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		variance[k] = square(q->sigma[k]);
	add_turn(q, columns);
	return solve(q, used, variance, columns, TURN, &fit);
}

/* Where a source cannot lose what the fit takes from it. */
static bool exceeds(const struct lp_step_question *q, const struct fit *fit)
{
	for (int s = 0; s < 2; s++)
		if (fit->source[s] >= 0) {
			const struct lp_step_source *source = &q->sources[fit->source[s]];
			const double sigma = sqrt(fit->variance[s]) + USUAL_SIGMA * source->now;

			if (fit->x[s] < -source->now - 3.0 * sigma)
				return true;
		}
	return fit->is_all && fit->x[0] < -1.0 - 3.0 * sqrt(fit->variance[0]);
}

/* What it costs that a lamp is neither as bright as usual now nor off. */
static double cost_of_dimming(const struct lp_step_source *source, double change, double variance)
{
	const double full = fmax(source->now, source->usual);
	const double sigma2 = variance + square(USUAL_SIGMA * full);
	const double to_off = square(source->now + change) / sigma2;
	const double to_full = square(source->now + change - full) / sigma2;
	const double least =
		source->now > 0.0F && source->usual <= source->now ? to_off : fmin(to_off, to_full);

	return full > 0.0 ? fmin(least, COST_DIMMED) : COST_DIMMED;
}

static int sources_of(const struct fit *fit)
{
	return (fit->source[0] >= 0) + (fit->source[1] >= 0);
}

/* How much of the change on sensor k the explanation claims: PATTERN_SIGMA of that is uncertain. */
static double claimed(const struct lp_step_question *q, const struct fit *fit,
		      const struct column *columns, int k, bool has_solution)
{
	double sum = 0.0;

	if (!has_solution || fit->is_nowhere)
		return q->change[k];
	if (fit->is_all)
		return fit->x[0] * q->expected[k];
	for (int s = 0; s < sources_of(fit); s++)
		sum += fabs(fit->x[s]) * fmax(columns[s].value[k], GRAZING);
	return sum;
}

/* The explanation's own columns; the prior of the light that the room throws back is left open. */
static void set_columns(const struct lp_step_question *q, const float (*normals)[3],
			struct fit *fit, struct column *columns)
{
	for (int s = 0; s < sources_of(fit); s++)
		for (int k = 0; k < LP_RING_SENSORS; k++)
			columns[s].value[k] = q->sources[fit->source[s]].weight[k];
	fit->own = sources_of(fit);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		columns[fit->own].value[k] = fit->is_all ? q->expected[k] : 1.0;
	fit->own++;
	for (int a = 0; fit->is_nowhere && a < 3; a++, fit->own++)
		for (int k = 0; k < LP_RING_SENSORS; k++)
			columns[fit->own].value[k] = normals[k][a];
	add_turn(q, columns + fit->own);
}

static void try(const struct lp_step_question *q, uint32_t used, const float (*normals)[3],
		struct fit *fit)
{
	struct column columns[COLUMNS];
	double variance[LP_RING_SENSORS], size = 0.0;
	const int sources = sources_of(fit);

	memset(columns, 0, sizeof(columns));
	set_columns(q, normals, fit, columns);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		size = fmax(size, used >> k & 1 ? fabs(q->change[k]) : 0.0);
	for (int round = 0; round < ROUNDS; round++) {
		if (sources)
			columns[sources].prior_sigma = fmax(INDIRECT * size, 1e-12);
		for (int k = 0; k < LP_RING_SENSORS; k++)
			variance[k] =
				square(q->sigma[k]) +
				square(PATTERN_SIGMA * claimed(q, fit, columns, k, round > 0));
		fit->misfit = solve(q, used, variance, columns, fit->own + TURN, fit);
		size = fabs(fit->x[0]) + (sources == 2 ? fabs(fit->x[1]) : 0.0);
	}
	fit->cost = fit->misfit + (sources == 2) * COST_SECOND + fit->is_nowhere * COST_NOWHERE;
	for (int s = 0; s < sources; s++)
		fit->cost +=
			cost_of_dimming(&q->sources[fit->source[s]], fit->x[s], fit->variance[s]);
	if (exceeds(q, fit) || fit->misfit > MOST_MISFIT * __builtin_popcount(used))
		fit->cost = INFINITY;
}

/* The change but for one or two neighbours is no more than noise. */
static double cost_of_shadow(const struct lp_step_question *q, uint32_t used)
{
	double least = INFINITY;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		for (int two = 0; two < 2; two++) {
			const uint32_t hidden = 1U << k | (two && k < 8 ? 1U << ((k + 1) % 8) : 0U);

			least = fmin(least, cost_of_nothing(q, used & ~hidden) +
						    COST_SHADOW * __builtin_popcount(hidden));
		}
	return least;
}

#define MOST_FITS (2 * LP_MAX_STEP_SOURCES + 2)

/* All explanations; returns how many. */
static int explain(const struct lp_step_question *q, uint32_t used, const float (*normals)[3],
		   struct fit fits[MOST_FITS])
{
	int count = 0, best = -1;

	for (int i = 0; i < q->count; i++) {
		fits[count] = (struct fit){.source = {i, -1}};
		try(q, used, normals, &fits[count]);
		if (best < 0 || fits[count].misfit < fits[best].misfit)
			best = count;
		count++;
	}
	fits[count] = (struct fit){.source = {-1, -1}, .is_all = true};
	try(q, used, normals, &fits[count++]);
	fits[count] = (struct fit){.source = {-1, -1}, .is_nowhere = true};
	try(q, used, normals, &fits[count++]);
	for (int i = 0; best >= 0 && i < q->count; i++) {
		if (i == best)
			continue;
		fits[count] = (struct fit){.source = {best, i}};
		try(q, used, normals, &fits[count++]);
	}
	return count;
}

/* A sum of x and of x^2 + variance, by weight. */
static void mix(double weight, double x, double variance, double *mean, double *square_mean)
{
	*mean += weight * x;
	*square_mean += weight * (x * x + variance);
}

static void share(const struct lp_step_question *q, const struct fit *fits, int count, double best,
		  struct lp_step *step)
{
	double mean[LP_MAX_STEP_SOURCES] = {0.0}, squares[LP_MAX_STEP_SOURCES] = {0.0};
	double ambient[4] = {0.0}, ambient2 = 0.0, all = 0.0, all2 = 0.0, total = 0.0;

	for (int i = 0; i < count; i++)
		total += exp((best - fits[i].cost) / 2.0);
	for (int i = 0; i < count; i++) {
		const struct fit *f = &fits[i];
		const double weight = exp((best - f->cost) / 2.0) / total;
		int at = 0;

		for (; at < 2 && f->source[at] >= 0; at++)
			mix(weight, fmax(f->x[at], -q->sources[f->source[at]].now), f->variance[at],
			    &mean[f->source[at]], &squares[f->source[at]]);
		if (f->is_all)
			mix(weight, fmax(f->x[0], -1.0), f->variance[0], &all, &all2);
		else
			mix(weight, f->x[at], f->variance[at], &ambient[0], &ambient2);
		for (int a = 0; f->is_nowhere && a < 3; a++)
			ambient[1 + a] += weight * f->x[1 + a];
	}
	step->verdict = LP_STEP_FOUND;
	for (int i = 0; i < q->count; i++) {
		step->change[i] = (float)mean[i];
		step->variance[i] = (float)fmax(squares[i] - square(mean[i]), 0.0);
	}
	for (int a = 0; a < 4; a++)
		step->ambient[a] = (float)ambient[a];
	step->ambient_variance = (float)fmax(ambient2 - square(ambient[0]), 0.0);
	step->all = (float)all;
	step->all_variance = (float)fmax(all2 - square(all), 0.0);
}

void lp_ring_step(const struct lp_step_question *q, const float (*normals)[3], struct lp_step *step)
{
	struct fit fits[MOST_FITS];
	double mean = 0.0, change = 0.0, best = INFINITY;
	uint32_t used = 0;

	*step = (struct lp_step){.verdict = LP_STEP_NONE};
	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (is_known(q, k)) {
			used |= 1U << k;
			mean += q->expected[k];
			change += fabs(q->change[k]);
		}
	if (__builtin_popcount(used) < 5 || change < LEAST_CHANGE * mean)
		return;
	const double nothing = cost_of_nothing(q, used);

	if (nothing < WORTH)
		return;
	const int count = explain(q, used, normals, fits);

	for (int i = 0; i < count; i++)
		best = fmin(best, fits[i].cost);
	const double shadow = cost_of_shadow(q, used);

	if (shadow < best && shadow < MOST_MISFIT * LP_RING_SENSORS)
		step->verdict = LP_STEP_SHADOW;
	else if (!(best < INFINITY))
		step->verdict = LP_STEP_UNCLEAR;
	else if (best + WORTH < nothing)
		share(q, fits, count, best, step);
}
