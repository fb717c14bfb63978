/* SPDX-License-Identifier: Apache-2.0 */
#include "light/film/polarization.h"

#include <math.h>

#define DEG (180.0F / (float)M_PI)
/* Chosen by hand. */
/* 1 sigma of S1/S0 and S2/S0 before anything is known. */
#define PRIOR_SIGMA 0.5F
/* Sigma of a reading in shares of S0, besides its own: the sheet's angle, extinction and evenness.
 */
#define FILM_SIGMA 0.015F
/* Readings lose half of their weight in this time. */
#define HALF_LIFE_S 8.0F
/* And in so many rests of the film between sweeps. */
#define RESTS 2.0F
/* Sigmas beyond which a reading contradicts what is known. */
#define GATE 5.0F
/* Share of the newest reading in the mean of how far readings are off; none counts for more than
 * one that contradicts. */
#define MISFIT_GAIN 0.1F
/* Of readings beyond these variances no sum fits into a float. */
#define LEAST_VARIANCE 1e-34F
#define MOST_VARIANCE 1e34F
/* What more readings do not lessen, in S1/S0: the response of the camera. */
#define LEAST_SIGMA 0.008F
/* The smallest share that a film passes by which the light before it is told. */
#define LEAST_FACTOR 0.1F
/* Polarization with a larger sigma than this is not known. */
#define MOST_SIGMA 0.12F

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

struct solution {
	double s[3], covariance[6];
};

/* Least squares with the prior that S1 and S2 are 0 with a sigma of PRIOR_SIGMA * scale. The
 * matrix is positive definite, because normal[0] > 0. */
static struct solution solve(const struct lp_stokes *stokes, float scale)
{
	const double prior = 1.0 / ((double)PRIOR_SIGMA * PRIOR_SIGMA * scale * scale);
	const double a = stokes->normal[0], b = stokes->normal[1], c = stokes->normal[2],
		     d = stokes->normal[3] + prior, e = stokes->normal[4],
		     f = stokes->normal[5] + prior;
	const double minor[6] = {d * f - e * e, c * e - b * f, b * e - c * d,
				 a * f - c * c, b * c - a * e, a * d - b * b};
	const double determinant = a * minor[0] + b * minor[1] + c * minor[2];
	const float *r = stokes->right;
	struct solution result;

	for (int i = 0; i < 6; i++)
		result.covariance[i] = minor[i] / determinant;
	const double *p = result.covariance;

	result.s[0] = p[0] * r[0] + p[1] * r[1] + p[2] * r[2];
	result.s[1] = p[1] * r[0] + p[3] * r[1] + p[4] * r[2];
	result.s[2] = p[2] * r[0] + p[4] * r[1] + p[5] * r[2];
	return result;
}

/* Variance of h's, h = (1, axis). */
static double variance_along(const double p[6], const float axis[2])
{
	const double x = axis[0], y = axis[1];

	return p[0] + x * x * p[3] + y * y * p[5] + 2.0 * (x * p[1] + y * p[2] + x * y * p[4]);
}

/* Squared, in variances: how far a reading is from what is known. */
static float deviation(const struct lp_stokes *stokes, const struct lp_stokes_reading *reading,
		       float scale, double variance)
{
	if (!(stokes->normal[0] > 0.0F))
		return 0.0F;
	const struct solution known = solve(stokes, scale);
	const double expected =
		known.s[0] + reading->axis[0] * known.s[1] + reading->axis[1] * known.s[2];
	const double off = reading->intensity - expected;

	return (float)(off * off / (variance + variance_along(known.covariance, reading->axis)));
}

bool lp_stokes_correct(struct lp_stokes *stokes, const struct lp_stokes_reading *reading,
		       float elapsed_s)
{
	if (!isfinite(reading->intensity) || !isfinite(reading->sigma) ||
	    !(reading->intensity > 0.0F))
		return false;
	const float scale = fmaxf(stokes->scale, reading->intensity);
	const float film = FILM_SIGMA * scale;
	const float variance = reading->sigma * reading->sigma + film * film;

	if (!(variance > LEAST_VARIANCE && variance < MOST_VARIANCE))
		return false;
	const float off = deviation(stokes, reading, scale, variance);
	const bool contradicts = off > GATE * GATE, changed = contradicts && stokes->doubted;
	const float half_life_s = HALF_LIFE_S + RESTS * reading->rest_s;
	const float kept = changed ? 0.0F : exp2f(-fmaxf(elapsed_s, 0.0F) / half_life_s);

	if (changed || !(stokes->normal[0] > 0.0F))
		stokes->misfit = reading->misfit;
	else
		stokes->misfit += MISFIT_GAIN * (fminf(off, GATE * GATE) - stokes->misfit);
	stokes->doubted = contradicts && !changed;
	if (stokes->doubted)
		return false;
	const float h[3] = {1.0F, reading->axis[0], reading->axis[1]};

	stokes->scale = changed ? reading->intensity : scale;
	for (int i = 0, at = 0; i < 3; i++) {
		for (int j = i; j < 3; j++, at++)
			stokes->normal[at] = kept * stokes->normal[at] + h[i] * h[j] / variance;
		stokes->right[i] = kept * stokes->right[i] + h[i] * reading->intensity / variance;
	}
	return changed;
}

/* q, u and their covariance, from S0, S1, S2 (first order). */
static void normalise(const struct solution *x, struct lp_polarization *result)
{
	const double s0 = x->s[0], q = x->s[1] / s0, u = x->s[2] / s0;
	const double *p = x->covariance;
	const double over = 1.0 / (s0 * s0);
	/* No light is more than wholly polarized: what seems so was read of different light. */
	const double beyond = fmax(hypot(q, u) - 1.0, 0.0);
	const double least = (double)LEAST_SIGMA * LEAST_SIGMA + beyond * beyond;

	result->q = (float)q;
	result->u = (float)u;
	result->qq = (float)((p[3] - 2.0 * q * p[1] + q * q * p[0]) * over + least);
	result->uu = (float)((p[5] - 2.0 * u * p[2] + u * u * p[0]) * over + least);
	result->qu = (float)((p[4] - q * p[2] - u * p[1] + q * u * p[0]) * over);
}

/* Debiased after Wardle and Kronberg 1974. */
void lp_polarization_complete(struct lp_polarization *r)
{
	const float biased = hypotf(r->q, r->u);
	const float x = biased > 0.0F ? r->q / biased : 1.0F,
		    y = biased > 0.0F ? r->u / biased : 0.0F;
	const float along2 = x * x * r->qq + 2.0F * x * y * r->qu + y * y * r->uu;
	const float across2 = y * y * r->qq - 2.0F * x * y * r->qu + x * x * r->uu;
	const float angle_deg = atan2f(r->u, r->q) * DEG / 2.0F;

	r->dolp_sigma = sqrtf(along2);
	r->dolp = fminf(sqrtf(fmaxf(biased * biased - along2, 0.0F)), 1.0F);
	r->aolp_deg = angle_deg < 0.0F ? angle_deg + 180.0F : angle_deg;
	r->aolp_sigma_deg =
		biased > 0.0F ? fminf(sqrtf(across2) / (2.0F * biased) * DEG, 90.0F) : 90.0F;
	r->known = fmaxf(r->qq, r->uu) < MOST_SIGMA * MOST_SIGMA;
}

struct lp_polarization lp_stokes_polarization(const struct lp_stokes *stokes)
{
	struct lp_polarization result = {.s0 = NAN,
					 .qq = PRIOR_SIGMA * PRIOR_SIGMA,
					 .uu = PRIOR_SIGMA * PRIOR_SIGMA,
					 .dolp_sigma = PRIOR_SIGMA,
					 .aolp_sigma_deg = 90.0F};

	if (!(stokes->normal[0] > 0.0F) || !(stokes->right[0] > 0.0F))
		return result;
	struct solution x = solve(stokes, stokes->scale);

	for (int i = 0; i < 6; i++) /* readings that do not fit each other say less */
		x.covariance[i] *= fmax(stokes->misfit, 1.0);

	if (!(x.s[0] > 0.0))
		return result;
	result.s0 = (float)x.s[0];
	normalise(&x, &result);
	lp_polarization_complete(&result);
	return result;
}

void lp_film_factor(const struct lp_polarization *polarization, const float axis[2], float *factor,
		    float *sigma)
{
	const struct lp_polarization *p = polarization;
	const float x = axis[0], y = axis[1];

	*factor = fmaxf(1.0F + x * p->q + y * p->u, LEAST_FACTOR);
	*sigma = sqrtf(fmaxf(x * x * p->qq + 2.0F * x * y * p->qu + y * y * p->uu, 0.0F));
}

float lp_stokes_frame_turn(const struct lp_rotation *turn, const float direction[3])
{
	float to[3] = {direction[0], direction[1], direction[2]};
	float right[3], up[3], new_right[3], new_up[3];

	lp_stokes_frame(direction, right, up);
	lp_rotate_direction(turn, to);
	lp_stokes_frame(to, new_right, new_up);
	lp_rotate_direction(turn, right);
	return -atan2f(dot(right, new_up), dot(right, new_right));
}

void lp_polarization_turn(struct lp_polarization *polarization, float turn_rad)
{
	const struct lp_polarization p = *polarization;
	const float c = cosf(2.0F * turn_rad), s = sinf(2.0F * turn_rad);
	const float turn_deg = turn_rad * 180.0F / (float)M_PI;

	polarization->q = c * p.q + s * p.u;
	polarization->u = c * p.u - s * p.q;
	polarization->qq = c * c * p.qq + 2.0F * c * s * p.qu + s * s * p.uu;
	polarization->qu = (c * c - s * s) * p.qu + c * s * (p.uu - p.qq);
	polarization->uu = s * s * p.qq - 2.0F * c * s * p.qu + c * c * p.uu;
	polarization->aolp_deg = fmodf(p.aolp_deg - turn_deg + 360.0F, 180.0F);
}

void lp_stokes_turn(struct lp_stokes *stokes, float turn_rad)
{
	const float c = cosf(2.0F * turn_rad), s = sinf(2.0F * turn_rad);
	float *n = stokes->normal, *r = stokes->right;
	const float xy = n[1], xz = n[2], yy = n[3], yz = n[4], zz = n[5], ry = r[1], rz = r[2];

	n[1] = c * xy + s * xz;
	n[2] = c * xz - s * xy;
	n[3] = c * c * yy + 2.0F * c * s * yz + s * s * zz;
	n[4] = (c * c - s * s) * yz + c * s * (zz - yy);
	n[5] = s * s * yy - 2.0F * c * s * yz + c * c * zz;
	r[1] = c * ry + s * rz;
	r[2] = c * rz - s * ry;
}
