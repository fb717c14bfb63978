/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_alone.h"

#include <math.h>
#include <string.h>

#include "light/linear/vector.h"

#include "light/clipped/ring_fusion.h"
#include "light/linear/nnls.h"

/* Rows of the grid of directions that is searched: every 5 degrees. */
#define ROWS 36
#define STEPS 20 /* of Gauss and Newton: more than it needs */
/* A step that leads over the edge of what sensors see is halved so often at most. */
#define MOST_HALVED 10
#define LEAST_USED 5
#define LEAST_LUX 1e-3F
#define PARAMETERS 4 /* pi ambient, and the lamp as a vector */
/* No room has just one lamp: what a lamp and an even surround leave of a reading, relative. Chosen
 * by hand on the scenes of docs/users/accuracy.md. */
#define MODEL_SIGMA 0.05
/* The same of a sensor that is much darker than the brightest: a lamp that grazes it, or hardly
 * misses it; of the brightest reading. */
#define GRAZING_SIGMA 0.01
/* A lamp is no stronger than so many times the brightest reading, 1 sigma, along each axis, as in
 * ring_residuals.c: no sensor looks down, so that any lamp could stand below. */
#define MOST_LAMP 2.0
/* Sensors whose normals rise by less than this stand around the equator. */
#define LEVEL_SINE 0.5

struct sensors {
	int count;
	double brightest_lux;
	double normal[LP_RING_SENSORS][3], lux[LP_RING_SENSORS], sigma[LP_RING_SENSORS];
};

static void take(const struct lp_ring_sample *sample, struct sensors *s)
{
	s->count = 0;
	s->brightest_lux = 0.0;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const double lux = sample->illuminance_lux[k];
		const double sigma =
			hypot((double)sample->sigma_relative[k], (double)sample->noise_relative[k]);
		float normal[3];

		if (!lp_ring_tells(sample, k))
			continue;
		lp_ring_looks_along(sample, k, normal);
		for (int a = 0; a < 3; a++)
			s->normal[s->count][a] = normal[a];
		s->lux[s->count] = lux;
		s->sigma[s->count++] = fmax(hypot(sigma, MODEL_SIGMA) * lux, LEAST_LUX / 10.0);
		s->brightest_lux = fmax(s->brightest_lux, lux);
	}
	for (int k = 0; k < s->count; k++)
		s->sigma[k] = fmax(s->sigma[k], GRAZING_SIGMA * s->brightest_lux);
}

/* p: pi ambient, and the lamp's direction times its irradiance. */
static double misfit(const struct sensors *s, const double p[PARAMETERS])
{
	double sum = 0.0;

	for (int k = 0; k < s->count; k++) {
		const double lux = p[0] + fmax(lp_dot(s->normal[k], p + 1), 0.0);
		const double off = (s->lux[k] - lux) / s->sigma[k];

		sum += off * off;
	}
	return sum;
}

/* Inverse variance of each component of the lamp, beforehand. */
static double prior(const struct sensors *s)
{
	const double most = MOST_LAMP * s->brightest_lux;

	return 1.0 / (most * most);
}

static double cost(const struct sensors *s, const double p[PARAMETERS])
{
	return misfit(s, p) + prior(s) * lp_dot(p + 1, p + 1);
}

/* Ambient and lamp >= 0 for one direction: the minimum of a quadratic form in two unknowns. Where
 * one of them would be negative, it is 0. Hundreds of directions are tried for every reading. */
static void fit_along(const struct sensors *s, const double direction[3], double p[PARAMETERS])
{
	double one = 0.0, facing = 0.0, facing2 = prior(s), lux = 0.0, facing_lux = 0.0;

	for (int k = 0; k < s->count; k++) {
		const double weight = 1.0 / (s->sigma[k] * s->sigma[k]);
		const double cosine = fmax(lp_dot(s->normal[k], direction), 0.0);

		one += weight;
		facing += weight * cosine;
		facing2 += weight * cosine * cosine;
		lux += weight * s->lux[k];
		facing_lux += weight * cosine * s->lux[k];
	}
	const double ambient = facing2 * lux - facing * facing_lux;
	const double lamp = one * facing_lux - facing * lux;
	const double determinant = one * facing2 - facing * facing;
	double x = 0.0;

	if (!(lamp > 0.0)) {
		p[0] = lux / one;
	} else if (!(ambient > 0.0 && determinant > 0.0)) {
		p[0] = 0.0;
		x = facing_lux / facing2;
	} else {
		p[0] = ambient / determinant;
		x = lamp / determinant;
	}
	for (int a = 0; a < 3; a++)
		p[1 + a] = x * direction[a];
}

static void search(const struct sensors *s, double best[PARAMETERS])
{
	double sine[2 * ROWS], cosine[2 * ROWS], least = INFINITY;

	for (int c = 0; c < 2 * ROWS; c++) {
		sine[c] = sin(M_PI * (c + 0.5) / ROWS);
		cosine[c] = cos(M_PI * (c + 0.5) / ROWS);
	}
	for (int r = 0; r < ROWS; r++) {
		const double up = cos(M_PI * (r + 0.5) / ROWS),
			     level = sin(M_PI * (r + 0.5) / ROWS);

		for (int c = 0; c < 2 * ROWS; c++) {
			const double d[3] = {level * sine[c], up, -level * cosine[c]};
			double p[PARAMETERS];

			fit_along(s, d, p);
			const double value = cost(s, p);

			if (value < least) {
				least = value;
				memcpy(best, p, sizeof(p));
			}
		}
	}
}

/* Whether a little more of the lamp, or of it elsewhere, would show in this sensor. Around the
 * equator another one faces the other way, so that grazing light is bounded from both sides. */
static bool tells(const struct sensors *s, int k, const double p[PARAMETERS])
{
	const double grazing = GRAZING_SIGMA * s->brightest_lux;
	const bool is_level = fabs(s->normal[k][1]) < LEVEL_SINE;

	return lp_dot(p + 1, p + 1) <= grazing * grazing ||
	       lp_dot(s->normal[k], p + 1) > (is_level ? -grazing : grazing);
}

/* Normal equations around p. */
static struct lp_nnls linearise(const struct sensors *s, const double p[PARAMETERS])
{
	struct lp_nnls normal = {.count = PARAMETERS};

	for (int k = 0; k < s->count; k++) {
		const double facing = lp_dot(s->normal[k], p + 1);
		const double weight = 1.0 / (s->sigma[k] * s->sigma[k]);
		const bool has_slope = tells(s, k, p);
		double row[PARAMETERS] = {1.0};

		for (int a = 0; a < 3 && has_slope; a++)
			row[1 + a] = s->normal[k][a];
		for (int i = 0; i < PARAMETERS; i++) {
			normal.right[i] += weight * row[i] * (s->lux[k] - p[0] - fmax(facing, 0.0));
			for (int j = 0; j < PARAMETERS; j++)
				normal.normal[i][j] += weight * row[i] * row[j];
		}
	}
	for (int i = 1; i < PARAMETERS; i++) {
		normal.normal[i][i] += prior(s);
		normal.right[i] -= prior(s) * p[i];
	}
	return normal;
}

/* Go from p by `step`, or by less of it, as it does good. False: nothing of it does. */
static bool go(const struct sensors *s, const double step[PARAMETERS], double p[PARAMETERS])
{
	const double before = cost(s, p);

	double share = 1.0;

	for (int halved = 0; halved <= MOST_HALVED; halved++) {
		double next[PARAMETERS];

		for (int i = 0; i < PARAMETERS; i++)
			next[i] = p[i] + share * step[i];
		next[0] = fmax(next[0], 0.0);
		if (cost(s, next) < before) {
			memcpy(p, next, sizeof(next));
			return true;
		}
		share /= 2.0;
	}
	return false;
}

/* False: the readings tell nothing. */
static bool refine(const struct sensors *s, double p[PARAMETERS],
		   double covariance[LP_NNLS_MAX][LP_NNLS_MAX])
{
	const double all[LP_NNLS_MAX] = {1.0, 1.0, 1.0, 1.0};

	for (int steps = 0; steps < STEPS; steps++) {
		const struct lp_nnls normal = linearise(s, p);
		double step[PARAMETERS] = {0.0};

		if (!lp_nnls_covariance(&normal, all, covariance))
			return false;
		for (int i = 0; i < PARAMETERS; i++)
			for (int j = 0; j < PARAMETERS; j++)
				step[i] += covariance[i][j] * normal.right[j];
		if (!go(s, step, p))
			break;
	}
	return true;
}

bool lp_ring_alone(const struct lp_ring_sample *sample, struct lp_ring_alone *light)
{
	double p[PARAMETERS] = {0.0}, covariance[LP_NNLS_MAX][LP_NNLS_MAX];
	double along = 0.0, across = 0.0, trace = 0.0;
	struct sensors s;

	take(sample, &s);
	if (s.count < LEAST_USED || s.brightest_lux < (double)LEAST_LUX)
		return false;
	search(&s, p);
	if (!refine(&s, p, covariance))
		return false;
	const double lamp = sqrt(lp_dot(p + 1, p + 1));

	*light = (struct lp_ring_alone){.ambient = (float)(p[0] / M_PI), .lamp = (float)lamp};
	light->direction[1] = 1.0F; /* where no lamp is found */
	for (int a = 0; a < 3 && lamp > 0.0; a++)
		light->direction[a] = (float)(p[1 + a] / lamp);
	for (int a = 0; a < 3; a++) {
		trace += covariance[1 + a][1 + a];
		for (int b = 0; b < 3; b++)
			along += covariance[1 + a][1 + b] * light->direction[a] *
				 light->direction[b];
	}
	across = fmax(trace - along, 0.0);
	light->ambient_sigma = (float)(sqrt(covariance[0][0]) / M_PI);
	light->lamp_sigma = (float)sqrt(fmax(along, 0.0));
	light->direction_sigma_deg =
		lamp > 0.0 ? (float)fmin(sqrt(across) / lamp * 180.0 / M_PI, 104.0) : 104.0F;
	light->misfit = (float)(misfit(&s, p) / fmax(s.count - PARAMETERS, 1.0));
	return true;
}
