/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_colour.h"

#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "light/linear/nnls.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* How far the colour of a lamp is from that of what was seen of it, relative 1 sigma: lamps that
 * clip in all channels look white, and are anything from a candle to the sky. */
#define LOOK_SIGMA 0.4F
/* The same of a whole lamp without a ring that sees colours: root mean square over red, green and
 * blue, of the luminance. */
#define TINT_SIGMA 0.22F
/* Of light that is all in red, where white was expected. */
#define ONE_CHANNEL 2.3F
/* What a colour of the ring is worth before anything has been learned. */
#define WHITE_SIGMA 0.2F
/* Squared sigmas per reading beyond which the colours are not believed, as in ring_fusion.c. */
#define MOST_MISFIT 4.0

void lp_ring_colour_init(struct lp_ring_colour *colour)
{
	*colour = (struct lp_ring_colour){0};
	for (int c = 0; c < 3; c++)
		colour->white[c] = (struct lp_ring_scale){1.0F, WHITE_SIGMA};
}

/* A lamp that hardly clips hides little light, which may be in one channel alone. */
static float tint_sigma(float hidden, float whole)
{
	return hidden > 0.0F ? fminf(TINT_SIGMA * whole / hidden, ONE_CHANNEL) : ONE_CHANNEL;
}

void lp_ring_colour_as_seen(struct lp_ring_colour *colour, const struct lp_clipped_parts *parts,
			    const struct lp_ring_fusion *luminance)
{
	for (int j = 0; j < parts->count; j++) {
		const struct lp_clipped_part *part = &parts->list[j];
		const float hidden = hypotf(luminance->excess[j], luminance->sigma[j]);

		memcpy(colour->tint[j], part->tint, sizeof(colour->tint[j]));
		colour->tint_sigma[j] = tint_sigma(hidden, part->bound[LP_LUMINANCE] + hidden);
	}
}

static void learn(struct lp_ring_scale *held, float white, float sigma)
{
	if (sigma < held->sigma / 2.0F) {
		*held = (struct lp_ring_scale){white, sigma};
		return;
	}
	held->lux_per_unit += LP_RING_LEARNED_SHARE * (white - held->lux_per_unit);
	held->sigma += LP_RING_LEARNED_SHARE * (sigma - held->sigma);
}

/* Returns the square of the value, in sigmas. */
static double add_equation(struct lp_nnls *normal, const double *row, double value, double sigma)
{
	const double weight = 1.0 / (sigma * sigma);

	for (int i = 0; i < normal->count; i++) {
		normal->right[i] += weight * row[i] * value;
		for (int j = 0; j < normal->count; j++)
			normal->normal[i][j] += weight * row[i] * row[j];
	}
	return weight * value * value;
}

/* One equation says what one unknown is expected to be. */
static double expect(struct lp_nnls *normal, int unknown, double value, double sigma)
{
	double row[LP_NNLS_MAX] = {0.0};

	row[unknown] = 1.0;
	return add_equation(normal, row, value, fmax(sigma, 1e-9));
}

/* The sum of squares, in sigmas, that x leaves; `none`: that which 0 leaves. */
static double misfit(const struct lp_nnls *normal, const double *x, double none)
{
	double sum = none;

	for (int i = 0; i < normal->count; i++) {
		sum -= 2.0 * normal->right[i] * x[i];
		for (int j = 0; j < normal->count; j++)
			sum += normal->normal[i][j] * x[i] * x[j];
	}
	return sum;
}

/* What is asked of one colour. */
struct question {
	const struct lp_ring_view *view;
	const struct lp_ring_sample *sample;
	const struct lp_ring_fusion *luminance;
	const struct lp_clipped_parts *parts;
	int channel;
	struct lp_ring_scale white;
};

/* Unknown 0: the scale of this colour over that of the luminance; 1 + j: the same times the tint
 * of part j. Both are near 1. False: the readings make no sense. */
static bool solve(const struct question *q, double x[LP_NNLS_MAX],
		  double covariance[LP_NNLS_MAX][LP_NNLS_MAX])
{
	const double scale = q->luminance->scale.lux_per_unit;
	struct lp_nnls normal = {.count = 1 + q->parts->count};
	double none;
	int readings = 0;

	none = expect(&normal, 0, q->white.lux_per_unit,
		      (double)q->white.sigma * q->white.lux_per_unit);
	for (int j = 0; j < q->parts->count; j++) {
		const double seen = fmaxf(q->parts->list[j].tint[q->channel], 0.01F);

		none += expect(&normal, 1 + j, q->white.lux_per_unit * seen,
			       (double)LOOK_SIGMA * seen);
	}
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const double reading = q->sample->rgb[k][q->channel];
		const double seen = scale * q->view->seen[k];
		double row[LP_NNLS_MAX] = {seen}, variance = 0.0;

		if (!isfinite(reading) || q->luminance->wrong >> k & 1)
			continue;
		for (int j = 0; j < q->parts->count; j++) {
			const struct lp_ring_part *part = &q->view->parts[j];
			const double hidden = scale * q->luminance->excess[j];

			row[1 + j] = hidden * part->weight[k];
			variance += pow(hidden * part->spread[k], 2.0);
		}
		variance += pow(q->sample->colour_sigma * fmax(reading, seen), 2.0) +
			    pow(q->view->seen_sigma * seen, 2.0);
		if (!(variance > 0.0))
			continue;
		none += add_equation(&normal, row, reading, sqrt(variance));
		readings++;
	}
	lp_nnls_solve(&normal, x);
	return lp_nnls_covariance(&normal, x, covariance) && x[0] > 0.0 &&
	       misfit(&normal, x, none) <= MOST_MISFIT * (readings + 1);
}

/* A solution becomes one colour of a part's tint; its variance is added. */
static void take_tint(struct lp_ring_colour *colour, float *variance, int part, int channel,
		      const double x[LP_NNLS_MAX],
		      const double covariance[LP_NNLS_MAX][LP_NNLS_MAX])
{
	/* at 0 it is bound: as uncertain as it was */
	const double own = x[1 + part] > 0.0 ? covariance[1 + part][1 + part]
					     : (double)(TINT_SIGMA * TINT_SIGMA);

	colour->tint[part][channel] = (float)(x[1 + part] / x[0]);
	variance[part] += (float)(own / (x[0] * x[0]));
}

/* The luminance is known better than its colours are. */
static void make_luminance_1(struct lp_ring_colour *colour, int count)
{
	for (int j = 0; j < count; j++) {
		float *tint = colour->tint[j];
		const float sum = lp_luminance(tint);

		for (int c = 0; c < 3 && sum > 0.0F; c++)
			tint[c] /= sum;
	}
}

void lp_ring_colour_update(struct lp_ring_colour *colour, const struct lp_ring_view views[3],
			   const struct lp_ring_sample *sample,
			   const struct lp_ring_fusion *luminance,
			   const struct lp_clipped_parts *parts, bool learns)
{
	float variance[LP_MAX_CLIPPED_PARTS] = {0.0F};

	lp_ring_colour_as_seen(colour, parts, luminance);
	for (int c = 0; c < 3; c++) {
		const struct question question = {&views[c], sample, luminance,
						  parts,     c,	     colour->white[c]};
		double x[LP_NNLS_MAX] = {0.0}, covariance[LP_NNLS_MAX][LP_NNLS_MAX];

		if (!solve(&question, x, covariance)) {
			lp_ring_colour_as_seen(colour, parts, luminance);
			return;
		}
		for (int j = 0; j < parts->count; j++)
			take_tint(colour, variance, j, c, x,
				  (const double(*)[LP_NNLS_MAX])covariance);
		if (learns)
			learn(&colour->white[c], (float)x[0],
			      (float)(sqrt(covariance[0][0]) / x[0]));
	}
	for (int j = 0; j < parts->count; j++)
		colour->tint_sigma[j] = sqrtf(variance[j] / 3.0F);
	make_luminance_1(colour, parts->count);
}
