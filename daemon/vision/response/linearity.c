/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/response/linearity.h"

#include <math.h>

/* Chosen by hand, on tests/accuracy/live.py --defects; docs/maintainers/constants.md says what
 * other values do. */

/* A cell whose linear value differs by less (logarithm) between two frames tells nothing... */
#define LEAST_APART 0.5F
/* ...nor does one that was seen longer ago... */
#define MOST_AGO_S 0.5F
/* ...nor one that differs by more sigmas than noise and this power explain: its light is another.
 */
#define GATE 3.0F
#define MOST_POWER 0.5F
/* Fewer cells may be one lamp. */
#define LEAST_CELLS 40
/* All light of a frame errs alike, by how honest exposures are: 1 sigma. */
#define FRAME_SIGMA 0.03F
/* 1 sigma of how the response changes, per root second. */
#define DRIFT 0.0005F
/* A cell's mean is over so many pairs at most; fewer than the least say nothing of it. */
#define MOST_PAIRS 60
#define LEAST_PAIRS 6
/* Exposures disagree from this spread on, and as long as it is above the other one. */
#define BEGINS 0.008F
#define GOES_ON 0.005F
/* "Lately", a time constant. */
#define LATELY_S 5.0F
/* A power nearer to 1 than this many of its sigmas is not worth another response. */
#define WORTH_SIGMAS 1.0F

void lp_linearity_init(struct lp_linearity *linearity, float sigma)
{
	*linearity = (struct lp_linearity){.variance = sigma * sigma, .log_exposure = NAN};
	for (int k = 0; k < LP_LINEARITY_CELLS; k++)
		linearity->cells[k].last.log_light = NAN;
}

void lp_linearity_inherit(struct lp_linearity *linearity, const struct lp_linearity *from)
{
	*linearity = *from;
	linearity->applied = 0.0F;
	for (int k = 0; k < LP_LINEARITY_CELLS; k++) /* they are of another panorama */
		linearity->cells[k] = (struct lp_linearity_cell){.last.log_light = NAN};
}

/* What a frame's cells ask for. */
struct sums {
	double weight, power, apart;
	int count;
};

/* One more pair of exposures of a cell. */
static void add(struct lp_linearity_cell *cell, float power, float weight)
{
	const float before = power - cell->power;

	cell->count += cell->count < MOST_PAIRS;
	cell->power += before / (float)cell->count;
	cell->variance +=
		(before * (power - cell->power) - cell->variance) / (float)cell->count;
	cell->weight += (weight - cell->weight) / (float)cell->count;
}

static void compare(const struct lp_linearity *l, struct lp_linearity_cell *cell,
		    const struct lp_linearity_look *look, struct sums *sums)
{
	const float apart = look->log_linear - cell->last.log_linear;
	const float difference = look->log_light - cell->last.log_light;
	const float variance = look->variance + cell->last.variance;
	const float most = GATE * sqrtf(variance) + MOST_POWER * fabsf(apart);

	/* also of NAN */
	if (!(fabsf(apart) > LEAST_APART) || !(fabsf(difference) < most) ||
	    l->t_s - cell->t_s > MOST_AGO_S)
		return;
	const float power = -difference / apart, weight = apart * apart / variance;

	sums->weight += (double)weight;
	sums->power += (double)weight * (double)power;
	sums->apart += (double)weight * (double)fabsf(apart);
	sums->count++;
	add(cell, power, weight);
}

static void correct(struct lp_linearity *l, const struct sums *sums)
{
	const float apart = (float)(sums->apart / sums->weight);
	const float found = l->applied + log1pf((float)(sums->power / sums->weight));
	const float variance = FRAME_SIGMA * FRAME_SIGMA / (apart * apart);
	const float gain = l->variance / (l->variance + variance);

	l->log_power += gain * (found - l->log_power);
	l->variance *= 1.0F - gain;
}

/* The variance of the cells' means, less what their own noise makes of it. */
static void weigh_spread(struct lp_linearity *l)
{
	double weights = 0.0, sum = 0.0, squares = 0.0, noise = 0.0;
	int cells = 0;

	for (int k = 0; k < l->count; k++) {
		const struct lp_linearity_cell *cell = &l->cells[k];
		const double weight = (double)cell->weight, power = (double)cell->power;

		if (cell->count < LEAST_PAIRS)
			continue;
		weights += weight;
		sum += weight * power;
		squares += weight * power * power;
		noise += weight * (double)cell->variance / (double)(cell->count - 1);
		cells++;
	}
	if (cells < LEAST_CELLS)
		return;
	const double mean = sum / weights;

	l->spread = (float)sqrt(fmax((squares - noise) / weights - mean * mean, 0.0));
	l->disagrees = l->spread > (l->disagrees ? GOES_ON : BEGINS);
}

/* A bracket goes from its longest exposure to its shortest, or back, in one step. */
static void note_exposure(struct lp_linearity *l, float log_exposure, float elapsed_s)
{
	const float step = fabsf(log_exposure - l->log_exposure); /* NAN: nothing */

	l->log_range = fmaxf(l->log_range * expf(-elapsed_s / LATELY_S), step);
	l->log_exposure = log_exposure;
}

void lp_linearity_learn(struct lp_linearity *l, const struct lp_linearity_look *looks, int count,
			float log_exposure, float elapsed_s)
{
	struct sums sums = {0};
	double depth = 0.0;
	int told = 0;

	l->t_s += elapsed_s;
	l->count = count;
	l->variance += DRIFT * DRIFT * elapsed_s;
	note_exposure(l, log_exposure, elapsed_s);
	for (int k = 0; k < count; k++) {
		struct lp_linearity_cell *cell = &l->cells[k];

		if (isnan(looks[k].log_light))
			continue;
		depth -= (double)looks[k].log_linear;
		told++;
		compare(l, cell, &looks[k], &sums);
		cell->last = looks[k];
		cell->t_s = l->t_s;
	}
	if (told >= LEAST_CELLS) {
		const float share = l->depth > 0.0F ? fminf(elapsed_s / LATELY_S, 1.0F) : 1.0F;

		l->depth += share * ((float)(depth / told) - l->depth);
	}
	if (sums.count < LEAST_CELLS)
		return;
	correct(l, &sums);
	weigh_spread(l);
}

float lp_linearity_apply(struct lp_linearity *l)
{
	const float change = l->log_power - l->applied;
	const float power = expf(change);

	if (fabsf(change) <= WORTH_SIGMAS * sqrtf(l->variance))
		return 1.0F;
	for (int k = 0; k < l->count; k++) {
		struct lp_linearity_look *last = &l->cells[k].last;

		last->log_light += (power - 1.0F) * last->log_linear;
		last->log_linear *= power;
		l->cells[k].power = (1.0F + l->cells[k].power) / power - 1.0F;
	}
	l->applied = l->log_power;
	return power;
}

float lp_linearity_sigma(const struct lp_linearity *l)
{
	const float beyond = fmaxf(l->spread * l->spread - GOES_ON * GOES_ON, 0.0F);

	/* a power raises light by how far it is below full scale; and where cells differ, those of
	 * the longest exposure and those of the shortest differ by that over all between */
	return sqrtf(l->variance * l->depth * l->depth + beyond * l->log_range * l->log_range);
}
