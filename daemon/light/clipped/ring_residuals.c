/* SPDX-License-Identifier: Apache-2.0 */
#include "light/clipped/ring_residuals.h"

#include <math.h>
#include <string.h>

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* Weights depend on the solution: so often they are made again. */
#define ROUNDS 4
/* How dearly light pays that may be none, in halves of a squared sigma per factor e. */
#define SPARSITY 1.0
/* How many times the light that was seen of it a clipped part typically hides. */
#define HIDDEN_RATIO 30.0
/* A scale of which nothing is known, relative 1 sigma. */
#define UNKNOWN_SIGMA 10.0
/* A lamp hides no more light than so many times the brightest reading, 1 sigma: more would be a
 * lamp that no sensor faces. */
#define MOST_LIGHT 2.0
/* Of the mean reading: what the ring cannot tell. */
#define LEAST_SIGMA 1e-3
/* Light changes by this share in a second, 1 sigma. */
#define AGING 0.01

/* Before anything is known of the scale: as if nothing were hidden from the darkest sensor. */
static double first_scale(const struct lp_ring_problem *problem, uint32_t used)
{
	double least = INFINITY;

	if (!isnan(problem->scale.lux_per_unit))
		return problem->scale.lux_per_unit;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (used >> k & 1 && problem->view->seen[k] > 0.0F)
			least = fmin(least, (double)problem->sample->illuminance_lux[k] /
						    problem->view->seen[k]);
	return isfinite(least) ? least : 1.0;
}

static double predicted(const struct lp_ring_view *view, const double *x, int sensor)
{
	double lux = x[0] * view->seen[sensor];

	for (int j = 0; j < view->count; j++)
		lux += x[j + 1] * view->parts[j].weight[sensor];
	return lux;
}

static int looks(const struct lp_ring_problem *problem)
{
	return 1 + (problem->past ? problem->past->count : 0);
}

/* Look 0 is the newest reading. */
static const struct lp_ring_view *view_of(const struct lp_ring_problem *problem, int look)
{
	return look ? &problem->past->list[look - 1].view : problem->view;
}

static const struct lp_ring_sample *sample_of(const struct lp_ring_problem *problem, int look)
{
	return look ? &problem->past->list[look - 1].sample : problem->sample;
}

static bool counts(const struct lp_ring_sample *sample, int sensor, uint32_t used)
{
	return used >> sensor & 1 && lp_ring_tells(sample, sensor);
}

/* Variance of a reading around what x predicts: of what stays of the sensor's error, of its noise,
 * of what the camera saw, and of where in a part the light is. A reading that is too low does not
 * count the more for it. What stays of a sensor's error counts anew in each look: another sensor
 * faces the same light then. */
static double variance_of(const struct lp_ring_problem *problem, const double *x, int look,
			  int sensor, double floor_lux)
{
	const struct lp_ring_view *view = view_of(problem, look);
	const struct lp_ring_sample *sample = sample_of(problem, look);
	const double lux = fmax(sample->illuminance_lux[sensor], predicted(view, x, sensor));
	const double own = sample->sigma_relative[sensor] * lux;
	const double noise =
		(double)sample->noise_relative[sensor] * sample->illuminance_lux[sensor];
	const double camera = (double)view->seen_sigma * view->seen[sensor] * x[0];
	const double aged = look ? AGING * problem->past->list[look - 1].age_s * lux : 0.0;
	double variance =
		own * own + noise * noise + camera * camera + floor_lux * floor_lux + aged * aged;

	for (int j = 0; j < view->count; j++) {
		const double place = x[j + 1] * view->parts[j].spread[sensor];

		variance += place * place;
	}
	return variance;
}

static void add_row(struct lp_nnls *normal, const double *row, double value, double variance)
{
	for (int i = 0; i < normal->count; i++) {
		const double weighed = row[i] / variance;

		normal->right[i] += weighed * value;
		for (int j = 0; j < normal->count; j++)
			normal->normal[i][j] += weighed * row[j];
	}
}

static void row_of(const struct lp_ring_view *view, int sensor, double row[LP_NNLS_MAX])
{
	row[0] = view->seen[sensor];
	for (int j = 0; j < view->count; j++)
		row[j + 1] = view->parts[j].weight[sensor];
}

static double brightest(const struct lp_ring_problem *problem, uint32_t used)
{
	double most = 0.0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (used >> k & 1)
			most = fmax(most, problem->sample->illuminance_lux[k]);
	return most;
}

struct weights {
	double scale, scale_sigma; /* prior */
	double variance[1 + LP_RING_POSES][LP_RING_SENSORS];
};

static void add_look(const struct lp_ring_problem *problem, int look, uint32_t used,
		     const struct weights *weights, struct lp_nnls *normal)
{
	const struct lp_ring_sample *sample = sample_of(problem, look);
	double row[LP_NNLS_MAX];

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		if (!counts(sample, k, used))
			continue;
		row_of(view_of(problem, look), k, row);
		add_row(normal, row, sample->illuminance_lux[k], weights->variance[look][k]);
	}
}

static void make_normal(const struct lp_ring_problem *problem, uint32_t used,
			const struct weights *weights, struct lp_nnls *normal)
{
	const struct lp_ring_view *view = problem->view;
	double row[LP_NNLS_MAX], trace = 0.0;

	memset(normal, 0, sizeof(*normal));
	normal->count = 1 + view->count;
	for (int p = 0; p < looks(problem); p++)
		add_look(problem, p, used, weights, normal);
	for (int i = 1; i < normal->count; i++)
		trace += normal->normal[i][i];
	memset(row, 0, sizeof(row));
	row[0] = 1.0;
	add_row(normal, row, weights->scale, weights->scale_sigma * weights->scale_sigma);
	/* parts that look alike, or that no sensor sees */
	for (int i = 1; i < normal->count; i++)
		normal->normal[i][i] += 1e-9 * trace + 1e-30;
	const double most = MOST_LIGHT * brightest(problem, used);

	for (int i = 1; i < normal->count && most > 0.0; i++)
		normal->normal[i][i] += 1.0 / (most * most);
}

/* At first all parts are taken to hide as many times of what was seen of them, so that of parts
 * that look alike the larger one is preferred. */
static void expect_alike(const struct lp_ring_view *view, double scale, struct lp_nnls *normal)
{
	for (int j = 0; j < view->count; j++) {
		const double typical = HIDDEN_RATIO * fmax(view->parts[j].bound * scale, 1e-30);

		normal->normal[j + 1][j + 1] += 1.0 / (typical * typical);
	}
}

/* A part that cannot be told from nothing is nothing; a bright one pays little. */
static void add_prices(const struct lp_ring_view *view, const double *x, double *right)
{
	for (int j = 0; j < view->count; j++)
		right[j + 1] -= SPARSITY / (x[j + 1] + fmax(view->parts[j].bound * x[0], 1e-30));
}

static void weigh(const struct lp_ring_problem *problem, uint32_t used, const double *x,
		  double floor_lux, struct weights *weights)
{
	for (int p = 0; p < looks(problem); p++)
		for (int k = 0; k < LP_RING_SENSORS; k++)
			if (counts(sample_of(problem, p), k, used))
				weights->variance[p][k] = variance_of(problem, x, p, k, floor_lux);
}

/* Squared residuals, in sigmas; `count`: of the newest looks. */
static double residuals(const struct lp_ring_problem *problem, const struct weights *weights,
			const struct lp_ring_fit *fit, int count)
{
	double sum = 0.0;

	for (int p = 0; p < count; p++) {
		const struct lp_ring_sample *sample = sample_of(problem, p);

		for (int k = 0; k < LP_RING_SENSORS; k++) {
			if (!counts(sample, k, fit->used))
				continue;
			const double residual = sample->illuminance_lux[k] -
						predicted(view_of(problem, p), fit->x, k);

			sum += residual * residual / weights->variance[p][k];
		}
	}
	return sum;
}

static void judge(const struct lp_ring_problem *problem, const struct weights *weights,
		  struct lp_ring_fit *fit)
{
	const double off = (fit->x[0] - weights->scale) / weights->scale_sigma;

	fit->chi2 = off * off + residuals(problem, weights, fit, looks(problem));
	fit->misfit_now = residuals(problem, weights, fit, 1);
	fit->freedom = isnan(problem->scale.lux_per_unit) ? -1.0 : 0.0;
	fit->freedom += __builtin_popcount(fit->used);
	for (int j = 0; j < problem->view->count; j++) {
		const double bound = fmax(problem->view->parts[j].bound * fit->x[0], 1e-30);

		fit->freedom -= fit->x[j + 1] > 0.0;
		fit->price += 2.0 * SPARSITY * log1p(fit->x[j + 1] / bound);
	}
	fit->freedom = fmax(fit->freedom, 1.0);
}

/* What is known of the scale beforehand: its logarithm, within its relative sigma, as a Gaussian
 * around the scale as found. */
static struct weights prior_of(const struct lp_ring_problem *problem, uint32_t used, double found)
{
	const double first = first_scale(problem, used);
	struct weights weights = {.scale = first, .scale_sigma = UNKNOWN_SIGMA * first};

	if (!isnan(problem->scale.lux_per_unit)) {
		const double scale = fmax(found, LP_RING_LEAST_SCALE * first);

		weights.scale = scale * (1.0 - log(scale / first));
		weights.scale_sigma = scale * (double)problem->scale.sigma;
	}
	if (!(weights.scale_sigma > 0.0)) /* darkness */
		weights.scale_sigma = 1e-30;
	return weights;
}

static double floor_of(const struct lp_ring_problem *problem, uint32_t used)
{
	double mean_lux = 0.0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (used >> k & 1)
			mean_lux += (double)problem->sample->illuminance_lux[k] / LP_RING_SENSORS;
	return fmax(LEAST_SIGMA * mean_lux, 1e-12);
}

void lp_ring_normal(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit,
		    struct lp_nnls *normal, double bound[LP_NNLS_MAX])
{
	struct weights weights = prior_of(problem, fit->used, fit->x[0]);

	weigh(problem, fit->used, fit->x, floor_of(problem, fit->used), &weights);
	make_normal(problem, fit->used, &weights, normal);
	for (int j = 0; j < problem->view->count; j++)
		bound[j + 1] = fmax(problem->view->parts[j].bound * fit->x[0], 1e-30);
}

void lp_ring_fit(const struct lp_ring_problem *problem, uint32_t used, struct lp_ring_fit *fit)
{
	const double floor_lux = floor_of(problem, used);
	struct lp_nnls normal;
	struct weights weights;

	*fit = (struct lp_ring_fit){.used = used, .x = {first_scale(problem, used)}};
	for (int round = 0; round < ROUNDS; round++) {
		weights = prior_of(problem, used, fit->x[0]);
		weigh(problem, used, fit->x, floor_lux, &weights);
		make_normal(problem, used, &weights, &normal);
		if (round > 0)
			add_prices(problem->view, fit->x, normal.right);
		else
			expect_alike(problem->view, fit->x[0], &normal);
		lp_nnls_improve(&normal, fit->x);
	}
	fit->scale_variance = lp_nnls_variance(&normal, fit->x, 0);
	weights = prior_of(problem, used, fit->x[0]);
	weigh(problem, used, fit->x, floor_lux, &weights);
	judge(problem, &weights, fit);
}
