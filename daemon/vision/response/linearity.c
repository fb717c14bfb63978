/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/response/linearity.h"

#include <math.h>
#include <string.h>

/* Chosen by hand, on tests/accuracy/live.py --defects. */

/* A cell whose linear value differs by less (logarithm) between two frames tells nothing... */
#define LEAST_APART 0.5F
/* ...nor does one that was seen more frames ago: than a bracket of five has... */
#define MOST_AGO 5
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
/* Regions with fewer cells do not count, and fewer regions tell nothing. */
#define LEAST_IN_REGION 4
#define LEAST_REGIONS 4
/* After so many frames without a pair nothing is known of a cell. */
#define MOST_FRAMES 300
/* Exposures disagree from this spread on, besides a share of what rounding does to a cell, which is
 * much the same for cells next to each other; and as long as it is above so much of that. */
#define LEAST_SPREAD 0.0015F
#define ROUNDING_SHARE 0.45F
#define GOES_ON 0.85F
/* A response that is another power is not quite one: regions may differ by this share of it. */
#define FORM_SHARE 0.025F
/* What the camera does in all exposures alike does not show. Cameras whose exposures disagree are
 * off by this besides: 1 sigma of light, relative. */
#define UNSEEN_SIGMA 0.15F
/* "Lately", a time constant. */
#define LATELY_S 5.0F
/* A power nearer to 1 than this many of its sigmas is not worth another response. */
#define WORTH_SIGMAS 1.0F

void lp_linearity_init(struct lp_linearity *linearity, float sigma)
{
	*linearity = (struct lp_linearity){.variance = sigma * sigma, .log_exposure = NAN};
}

void lp_linearity_inherit(struct lp_linearity *linearity, const struct lp_linearity *from)
{
	*linearity = *from;
	linearity->applied = 0.0F;
	/* they are of another panorama */
	memset(linearity->cells, 0, sizeof(linearity->cells));
	memset(linearity->regions, 0, sizeof(linearity->regions));
}

void lp_linearity_forget_looks(struct lp_linearity *linearity)
{
	linearity->serial += MOST_AGO + 1;
}

/* What cells ask for that a frame shows, and that one of those before it has shown last. */
struct sums {
	double weight, power, apart;
	int count;
};

/* A cell in two frames. */
struct pair {
	float apart, power, weight, rounding;
	int ago; /* 0: it tells nothing */
};

static struct pair pair_of(const struct lp_linearity *l, const struct lp_linearity_cell *cell,
			   const struct lp_linearity_look *look)
{
	const float apart = look->log_linear - cell->last.log_linear;
	const float difference = look->log_light - cell->last.log_light;
	const float variance = look->variance + cell->last.variance;
	const float most = GATE * sqrtf(variance) + MOST_POWER * fabsf(apart);
	const uint64_t ago = l->serial - cell->serial;

	/* also of NAN */
	if (!cell->serial || ago > MOST_AGO || !(fabsf(apart) > LEAST_APART) ||
	    !(fabsf(difference) < most))
		return (struct pair){0};
	return (struct pair){.apart = fabsf(apart),
			     .power = -difference / apart,
			     .weight = apart * apart / variance,
			     .rounding = (look->rounding + cell->last.rounding) / (apart * apart),
			     .ago = (int)ago};
}

/* One more pair of exposures of a cell, less what its fellows ask for. */
static void add(struct lp_linearity_cell *cell, const struct pair *pair, float fellows,
		uint64_t serial)
{
	if (serial - cell->told > MOST_FRAMES) {
		cell->power = cell->weight = cell->rounding = 0.0F;
		cell->count = 0;
	}
	cell->told = serial;
	cell->count += cell->count < MOST_PAIRS;
	cell->power += (pair->power - fellows - cell->power) / (float)cell->count;
	cell->weight += (pair->weight - cell->weight) / (float)cell->count;
	cell->rounding += (pair->rounding - cell->rounding) / (float)cell->count;
}

/* By frames ago; [0]: of all. */
static void sum_up(const struct lp_linearity *l, const struct lp_linearity_look *looks,
		   struct sums sums[MOST_AGO + 1])
{
	for (int k = 0; k < l->count; k++) {
		const struct pair pair = pair_of(l, &l->cells[k], &looks[k]);

		for (int n = 0; pair.ago && n <= pair.ago; n += pair.ago) {
			sums[n].weight += (double)pair.weight;
			sums[n].power += (double)pair.weight * (double)pair.power;
			sums[n].apart += (double)pair.weight * (double)pair.apart;
			sums[n].count++;
		}
	}
}

/* One more frame of a region: what it asks for, beyond all. */
static void add_frame(struct lp_linearity_region *region, float power)
{
	region->count += region->count < MOST_PAIRS;
	region->power += (power - region->power) / (float)region->count;
	region->square += (power * power - region->square) / (float)region->count;
}

/* Each cell beside its fellows, of the same two frames: how honest exposures are, and light that
 * has changed as a whole, is no matter. */
static void compare(struct lp_linearity *l, const struct lp_linearity_look *looks,
		    const struct sums sums[MOST_AGO + 1])
{
	struct sums own[LP_LINEARITY_REGIONS] = {0};

	for (int k = 0; k < l->count; k++) {
		const struct pair pair = pair_of(l, &l->cells[k], &looks[k]);
		const struct sums *fellows = &sums[pair.ago];
		struct sums *region = &own[looks[k].region];

		if (!pair.ago || fellows->count < LEAST_CELLS)
			continue;
		const float power = (float)(fellows->power / fellows->weight);

		add(&l->cells[k], &pair, power, l->serial);
		region->weight += (double)pair.weight;
		region->power += (double)pair.weight * (double)(pair.power - power);
	}
	for (int r = 0; r < LP_LINEARITY_REGIONS; r++)
		if (own[r].weight > 0.0)
			add_frame(&l->regions[r], (float)(own[r].power / own[r].weight));
}

/* Variance of a region's mean, from how what it asks for differs from frame to frame. Each frame is
 * compared with up to MOST_AGO others: so many in a row count as one. */
static double variance_of_mean(const struct lp_linearity_region *region)
{
	const double power = (double)region->power;

	return MOST_AGO * fmax((double)region->square - power * power, 0.0) / region->count;
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

/* Of a region, or of all: sums over cells. */
struct region {
	double weight, power, square, rounding;
	int count;
};

static void add_cell(struct region *region, const struct lp_linearity_cell *cell)
{
	const double weight = (double)cell->weight, power = (double)cell->power;

	region->weight += weight;
	region->power += weight * power;
	region->square += weight * power * power;
	region->rounding += weight * (double)cell->rounding;
	region->count++;
}

/* Sum of squares about the mean. */
static double deviation(const struct region *region)
{
	return fmax(region->square - region->power * region->power / region->weight, 0.0);
}

/* Variance of the regions' own powers, by the method of moments (DerSimonian and Laird 1986). */
static void weigh_spread(struct lp_linearity *l)
{
	struct region regions[LP_LINEARITY_REGIONS] = {0}, all = {0};
	double within = 0.0, squared_weights = 0.0, changes = 0.0, squared_changes = 0.0;
	int count = 0;

	for (int k = 0; k < l->count; k++) {
		const struct lp_linearity_cell *cell = &l->cells[k];

		if (cell->count >= LEAST_PAIRS && l->serial - cell->told <= MOST_FRAMES)
			add_cell(&regions[cell->last.region], cell);
	}
	for (int r = 0; r < LP_LINEARITY_REGIONS; r++) {
		const struct region *region = &regions[r];

		if (region->count < LEAST_IN_REGION)
			continue;
		all.weight += region->weight;
		all.power += region->power;
		all.square += region->square;
		all.rounding += region->rounding;
		all.count += region->count;
		within += deviation(region);
		squared_weights += region->weight * region->weight;
		const double variance = variance_of_mean(&l->regions[r]);

		changes += region->weight * variance;
		squared_changes += region->weight * region->weight * variance;
		count++;
	}
	if (count < LEAST_REGIONS)
		return;
	const double noise = within / (all.count - count);
	const double between = deviation(&all) - within - noise * (count - 1) -
			       (changes - squared_changes / all.weight);

	l->spread = (float)sqrt(fmax(between, 0.0) / (all.weight - squared_weights / all.weight));
	l->rounding = (float)sqrt(all.rounding / all.weight);
	const float least = hypotf(hypotf(LEAST_SPREAD, ROUNDING_SHARE * l->rounding),
				   FORM_SHARE * l->log_power);

	l->disagrees = l->spread > (l->disagrees ? GOES_ON * least : least);
}

/* A bracket goes from its longest exposure to its shortest, or back, in one step. */
static void note_exposure(struct lp_linearity *l, float log_exposure, float elapsed_s)
{
	const float step = fabsf(log_exposure - l->log_exposure); /* NAN: nothing */

	l->log_range = fmaxf(l->log_range * expf(-elapsed_s / LATELY_S), step);
	l->log_exposure = log_exposure;
}

/* What the frame shows, for those that follow. */
static void keep(struct lp_linearity *l, const struct lp_linearity_look *looks, float elapsed_s)
{
	double depth = 0.0;
	int told = 0;

	for (int k = 0; k < l->count; k++) {
		if (isnan(looks[k].log_light))
			continue;
		depth -= (double)looks[k].log_linear;
		told++;
		l->cells[k].last = looks[k];
		l->cells[k].serial = l->serial;
	}
	if (told < LEAST_CELLS)
		return;
	const float share = l->depth > 0.0F ? fminf(elapsed_s / LATELY_S, 1.0F) : 1.0F;

	l->depth += share * ((float)(depth / told) - l->depth);
}

void lp_linearity_learn(struct lp_linearity *l, const struct lp_linearity_look *looks, int count,
			float log_exposure, float elapsed_s)
{
	struct sums sums[MOST_AGO + 1] = {0};

	l->serial++;
	l->count = count;
	l->variance += DRIFT * DRIFT * elapsed_s;
	note_exposure(l, log_exposure, elapsed_s);
	sum_up(l, looks, sums);
	if (sums[0].count >= LEAST_CELLS) {
		correct(l, &sums[0]);
		compare(l, looks, sums);
		weigh_spread(l);
	}
	keep(l, looks, elapsed_s);
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
	}
	l->applied = l->log_power;
	return power;
}

float lp_linearity_sigma(const struct lp_linearity *l)
{
	if (!(l->log_range > 0.0F))
		return 0.0F;
	/* a power raises light by how far it is below full scale; and where regions differ, the
	 * longest exposure and the shortest contradict each other by that over all between them */
	const float seen = l->disagrees ? l->spread * l->log_range : 0.0F;
	const float unseen = l->disagrees ? UNSEEN_SIGMA : 0.0F;

	return sqrtf(l->variance * l->depth * l->depth + seen * seen + unseen * unseen);
}
