/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/doubt/overlap.h"

#include <math.h>

#include "vision/camera/response.h"
#include "vision/doubt/gain.h"

/* Chosen by hand, on tests/accuracy/several.py. */

/* 1 sigma of the logarithm of the factor between two cameras of one make. */
#define FIRST_SIGMA 0.1F
/* A larger one is no difference between two cameras of one make: they do not see the same thing. */
#define MOST 0.3F
/* Such a share of the compared cells must have the factor in common. */
#define LEAST_AGREEMENT 0.5F
/* Frames err alike, by roll-off and lenses: 1 sigma of what one frame tells at best. */
#define FRAME_SIGMA 0.05F
/* Drift by temperature, 1 sigma per root second: 1 % in five minutes. */
#define DRIFT 0.0006F

void lp_overlap_init(struct lp_overlap *overlap, bool is_first)
{
	*overlap = (struct lp_overlap){0};
	for (int c = 0; c < 3 && !is_first; c++)
		overlap->variance[c] = FIRST_SIGMA * FIRST_SIGMA;
}

void lp_overlap_pass(struct lp_overlap *overlap, float elapsed_s)
{
	for (int c = 0; c < 3; c++)
		overlap->variance[c] = fminf(overlap->variance[c] + DRIFT * DRIFT * elapsed_s,
					     FIRST_SIGMA * FIRST_SIGMA);
}

void lp_overlap_correct(struct lp_overlap *overlap, int channel, struct lp_gain *cells,
			float other_variance)
{
	const struct lp_gain_look look = lp_gain_look(cells);
	const float found = overlap->applied[channel] - look.log_gain;
	const float variance = FRAME_SIGMA * FRAME_SIGMA + look.sigma * look.sigma + other_variance;
	float *own = &overlap->variance[channel];

	if (look.agreement < LEAST_AGREEMENT || fabsf(found) > MOST)
		return;
	const float gain = *own / (*own + variance);

	overlap->log_gain[channel] += gain * (found - overlap->log_gain[channel]);
	*own *= 1.0F - gain;
}

bool lp_overlap_apply(struct lp_overlap *overlap, struct lp_response *response)
{
	float factor[3], most = 0.0F;

	for (int c = 0; c < 3; c++) {
		const float change = overlap->log_gain[c] - overlap->applied[c];

		most = fmaxf(most, fabsf(change));
		factor[c] = expf(change);
	}
	if (!(most > 0.0F))
		return false;
	lp_response_scale(response, factor);
	for (int c = 0; c < 3; c++)
		overlap->applied[c] = overlap->log_gain[c];
	return true;
}

float lp_overlap_sigma(const struct lp_overlap *overlap)
{
	return sqrtf(
		fmaxf(overlap->variance[0], fmaxf(overlap->variance[1], overlap->variance[2])));
}
