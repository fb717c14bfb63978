/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/doubt/gain.h"

#include <math.h>
#include <stdbool.h>

#include "base/select.h"

/* Chosen by hand, on tests/accuracy/live.py --exposures=auto. */

/* Cells within so many sigmas have the factor in common. */
#define NEAR_SIGMAS 3.0F
#define ROUNDS 4
/* Such a share of the compared cells must have it, or the light has changed unevenly... */
#define MOST 0.5F
/* ...and so many must be compared, or nothing is known. */
#define LEAST_COMPARED 0.02F
/* So many frames in a row must show that, before other light is what is known. */
#define LOST_FRAMES 2
/* More than a third of a stop at once, from rest, is no automatic exposure. */
#define SUDDEN 0.25F
/* From rest fewer cells agree than usual, by such a share, on so much: a lamp has been switched. */
#define FEWER 0.05F
#define SOME 0.05F
/* The exposure is at rest when it changed by less than this lately, with the time constant. */
#define AT_REST 0.03F
#define UNREST_S 0.2F
#define USUAL_S 0.3F
/* What a cell shows on average: over so long; another value is taken after so many frames. */
#define MEMORY_S 30.0F
#define STRANGE_FRAMES 15
/* Frames of one memory err alike: 1 sigma of what they add to the scale, in sigmas of one. */
#define DRIFT_SIGMAS 2.0F
/* How well a camera's response is known: 1 sigma of light, relative, where the scale is another by
 * a factor of e. */
#define RESPONSE_SIGMA 0.03F
/* 1 sigma of the logarithm of the scale in a frame that does not show it, from rest. */
#define HIDDEN_SIGMA 0.02F
/* The same as a share of the light that changed; and where all of it changed at once. */
#define DISTURBED 0.1F
#define AMBIGUOUS 0.5F

void lp_gain_init(struct lp_gain *gain, float scale)
{
	gain->scale = gain->first = scale;
	gain->variance = gain->own = gain->unrest = gain->usual = 0.0F;
	gain->lost = gain->count = 0;
}

static float median(struct lp_gain *gain, int *compared)
{
	int count = 0;

	for (int k = 0; k < gain->count; k++) {
		const float off = gain->cells[k].seen - gain->cells[k].reference;

		if (!isnan(off))
			gain->sorted[count++] = off;
	}
	*compared = count;
	return count ? lp_select(gain->sorted, count, count / 2) : 0.0F;
}

struct lp_gain_look lp_gain_look(struct lp_gain *gain)
{
	struct lp_gain_look look = {0};
	int compared, near = 0;

	look.log_gain = median(gain, &compared);
	if ((float)compared < LEAST_COMPARED * (float)gain->count || compared < LP_CORRELATED_CELLS)
		return (struct lp_gain_look){0};
	for (int round = 0; round < ROUNDS; round++) {
		double sum = 0.0, weights = 0.0, squares = 0.0;

		near = 0;
		for (int k = 0; k < gain->count; k++) {
			const struct lp_gain_cell *cell = &gain->cells[k];
			const float off = cell->seen - cell->reference - look.log_gain;

			if (!(fabsf(off) < NEAR_SIGMAS * cell->sigma)) /* also of NAN */
				continue;
			const double weight = 1.0 / ((double)cell->sigma * cell->sigma);

			near++;
			sum += weight * off;
			squares += weight * off * off;
			weights += weight;
		}
		if (!near)
			return (struct lp_gain_look){0};
		look.log_gain += (float)(sum / weights);
		look.sigma = sqrtf((float)(squares / weights) * LP_CORRELATED_CELLS / (float)near);
	}
	look.agreement = (float)near / (float)compared;
	return look;
}

/* Each cell's mean goes on, `correction` added to what is seen; `anew`: from nothing. */
static void learn(struct lp_gain *gain, float correction, float elapsed_s, bool anew)
{
	for (int k = 0; k < gain->count; k++) {
		struct lp_gain_cell *cell = &gain->cells[k];
		const float seen = cell->seen + correction;

		if (isnan(seen))
			continue;
		const bool strange = fabsf(seen - cell->reference) > NEAR_SIGMAS * cell->sigma;

		cell->strange = strange ? cell->strange + 1 : 0;
		if (anew || isnan(cell->reference) || cell->strange > STRANGE_FRAMES) {
			cell->reference = seen;
			cell->count = 1;
			cell->strange = 0;
		} else if (!strange) {
			cell->count++;
			cell->reference += fmaxf(1.0F / (float)cell->count, elapsed_s / MEMORY_S) *
					   (seen - cell->reference);
		}
	}
}

/* The scale stays. Automatic exposure will soon follow what has changed. */
static void hold(struct lp_gain *gain, float elapsed_s)
{
	gain->variance += HIDDEN_SIGMA * HIDDEN_SIGMA + gain->unrest * gain->unrest;
	if (++gain->lost < LOST_FRAMES)
		return;
	learn(gain, 0.0F, elapsed_s, true);
	gain->unrest = 1.0F;
}

void lp_gain_follow(struct lp_gain *gain, const struct lp_gain_look *look, float elapsed_s)
{
	const bool was_at_rest = gain->unrest < AT_REST;
	const float step = fabsf(look->log_gain);
	const float forgotten = fminf(elapsed_s / MEMORY_S, 1.0F);

	gain->unrest *= expf(-elapsed_s / UNREST_S);
	if (look->agreement < MOST || /* the light changed, or all is too dark or too bright */
	    (was_at_rest && step > SOME && look->agreement < (1.0F - FEWER) * gain->usual)) {
		hold(gain, elapsed_s);
		return;
	}
	const float odd = fmaxf(gain->usual - look->agreement, 0.0F) * step;

	gain->lost = 0;
	gain->own = look->sigma;
	gain->usual += (1.0F - expf(-elapsed_s / USUAL_S)) * (look->agreement - gain->usual);
	if (was_at_rest && step > SUDDEN) {
		gain->unrest = 1.0F;
		gain->variance += AMBIGUOUS * AMBIGUOUS * step * step;
		for (int k = 0; k < gain->count; k++)
			gain->cells[k].reference += look->log_gain;
		return;
	}
	gain->unrest = fmaxf(gain->unrest, step);
	gain->scale *= expf(-look->log_gain);
	gain->variance += odd * odd;
	gain->variance += forgotten * DRIFT_SIGMAS * DRIFT_SIGMAS * look->sigma * look->sigma;
	learn(gain, -look->log_gain, elapsed_s, false);
}

void lp_gain_anew(struct lp_gain *gain, float correction, float sigma)
{
	for (int k = 0; k < gain->count; k++)
		gain->cells[k] =
			(struct lp_gain_cell){.seen = NAN,
					      .reference = gain->cells[k].seen + correction,
					      .count = 1};
	gain->variance += sigma * sigma;
}

void lp_gain_disturb(struct lp_gain *gain, float changed)
{
	const float share = fminf(changed, 1.0F);

	gain->variance += DISTURBED * DISTURBED * share * share;
}

float lp_gain_sigma(const struct lp_gain *gain)
{
	const float response = RESPONSE_SIGMA * logf(gain->scale / gain->first);

	/* twice: what is known began with a frame that erred alike */
	return sqrtf(gain->variance + response * response + 2.0F * gain->own * gain->own);
}
