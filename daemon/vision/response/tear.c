/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/response/tear.h"

#include <math.h>

#include "include/luminance.h"

/* Places of a row that are looked at. */
#define COLUMNS 32
/* Exposures that differ by less (logarithm) tell nothing. */
#define LEAST_APART 0.5F
/* Light of full scale below which rounding is as large as a step: less counts as that. */
#define DARKEST 0.002F
/* "Lately": of so many frames. */
#define LATELY 64.0F
/* Fewer places than half a row of so many frames tell nothing, nor do exposures that always change
 * by the same. */
#define LEAST_FRAMES 6
#define LEAST_VARIANCE 0.25F
/* So many errors of a slope are taken off it. */
#define SIGMAS 3.0F
/* The slope from which on it is found, and below which it is gone. */
#define FOUND 0.4F
#define GONE 0.2F

void lp_tear_init(struct lp_tear *tear)
{
	*tear = (struct lp_tear){.log_exposure = NAN};
}

/* Logarithm of a place's light, of full scale; what is darker, or clips, is at the end of it. */
static float look(const struct lp_cells *cells, int row, int column)
{
	const int y = (2 * row + 1) * cells->height / (2 * LP_TEAR_ROWS);
	const int x = (2 * column + 1) * cells->width / (2 * COLUMNS);
	const int cell = y * cells->width + x;
	const float linear = cells->radiance[cell][LP_LUMINANCE] / cells->scale;

	return cells->clipped[cell] ? 0.0F : logf(fminf(fmaxf(linear, DARKEST), 1.0F));
}

static void forget(struct lp_tear_row *row)
{
	const float kept = 1.0F - 1.0F / LATELY;

	row->places *= kept;
	row->step *= kept;
	row->change *= kept;
	row->product *= kept;
	row->step2 *= kept;
	row->change2 *= kept;
}

/* A row that is torn itself lies between the two. */
static void learn_row(struct lp_tear *tear, const struct lp_cells *cells, int at, float change)
{
	struct lp_tear_row *row = &tear->rows[at];

	for (int k = 0; k < COLUMNS; k++) {
		const float step = look(cells, at + 1, k) - look(cells, at - 1, k);

		if (step == 0.0F)
			continue; /* both are too dark, or clip */
		row->places += 1.0F;
		row->step += step;
		row->change += change;
		row->product += step * change;
		row->step2 += step * step;
		row->change2 += change * change;
	}
}

/* What a row's light steps by, per change of the exposure, at least: the slope of their regression
 * less its error; 0: it cannot be told. Places of a row in one frame are taken to err alike. */
static float slope_of(const struct lp_tear_row *row)
{
	if (row->places < 0.5F * LEAST_FRAMES * COLUMNS)
		return 0.0F;
	const float change2 = row->change2 - row->change * row->change / row->places;

	if (change2 < LEAST_VARIANCE * row->places)
		return 0.0F;
	const float step2 = row->step2 - row->step * row->step / row->places;
	const float slope = (row->product - row->step * row->change / row->places) / change2;
	const float variance = fmaxf(step2 / change2 - slope * slope, 0.0F);

	return slope - SIGMAS * sqrtf(variance * COLUMNS / row->places);
}

static void find(struct lp_tear *tear)
{
	float most = 0.0F;

	for (int r = 1; r < LP_TEAR_ROWS - 1; r++) {
		const float slope = slope_of(&tear->rows[r]);

		if (slope <= most)
			continue;
		most = slope;
		tear->share = ((float)r + 0.5F) / LP_TEAR_ROWS;
	}
	tear->found = most > (tear->found ? GONE : FOUND);
}

void lp_tear_learn(struct lp_tear *tear, const struct lp_cells *cells, float log_exposure)
{
	const float apart = log_exposure - tear->log_exposure; /* NAN: there was no frame */
	const bool tells = fabsf(apart) > LEAST_APART;

	tear->log_exposure = log_exposure;
	if (tells) {
		tear->frames = fminf(tear->frames + 1.0F, LATELY);
		tear->apart += (fabsf(apart) - tear->apart) / tear->frames;
	}
	for (int r = 1; r < LP_TEAR_ROWS - 1; r++) {
		forget(&tear->rows[r]); /* with one exposure nothing is torn any more */
		if (tells)
			learn_row(tear, cells, r, apart);
	}
	find(tear);
}

float lp_tear_sigma(const struct lp_tear *tear)
{
	return tear->found ? tear->share * expm1f(tear->apart) : 0.0F;
}
