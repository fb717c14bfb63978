/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/flicker.h"

#include <math.h>
#include <string.h>

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While lamps change". */

/* So many measurements at least, and of the last so many, tell whether a lamp flickers. */
#define LEAST_COUNT 8
#define RECENT 16
/* It does when it crosses its mean so often in them; it goes on as long as so often. */
#define CROSSINGS 4
#define STILL_CROSSINGS 2
#define NOISE_SIGMAS 1.5F
/* Its depth (root mean square) is this, and so many sigmas of noise, at least. */
#define LEAST_DEPTH 0.03F
#define DEPTH_SIGMAS 2.0F
/* A camera of 30 frames a second sees 100 Hz in three phases. Brackets do not take them in turn:
 * but each comes twice in so many measurements (estimate/exposures/bracket.c). */
#define PHASES 6
/* The mean of so many phases changes by so many of its own sigmas when the lamp itself changes. */
#define CHANGE_SIGMAS 5.0F
/* 1 sigma of a mean of PHASES, relative, at least. */
#define LEAST_SIGMA 0.02F
/* Noisier measurements do not count. */
#define MOST_NOISE 0.1F
/* Exposures within this ratio are one setting. A longer one counts when no shorter one has come for
 * so many measurements. */
#define SAME_SCALE 1.4F
#define MOST_UNCOUNTED 30

static float mean_of(const struct lp_flicker *f, int first, int count)
{
	double sum = 0.0;

	for (int k = first; k < first + count; k++)
		sum += f->strength[k];
	return (float)(sum / count);
}

/* Means of PHASES measurements in a row: how much the newest differs from those before it, in their
 * own sigmas. The newest ones of a lamp that was switched stand apart. */
static bool has_changed(const struct lp_flicker *f)
{
	double sum = 0.0, squares = 0.0;
	int count = 0;

	for (int k = PHASES; k + PHASES <= f->count; k++, count++) {
		const double mean = mean_of(f, k, PHASES);

		sum += mean;
		squares += mean * mean;
	}
	if (count < PHASES)
		return false;
	const double mean = sum / count;
	const double least = LEAST_SIGMA * mean;
	const double variance = fmax(squares / count - mean * mean, least * least);
	const double off = mean_of(f, 0, PHASES) - mean;

	return off * off > CHANGE_SIGMAS * CHANGE_SIGMAS * variance;
}

/* Root mean square of the newest measurements' distance from their mean, relative. */
static float depth_of(const struct lp_flicker *f, int count)
{
	const float mean = mean_of(f, 0, count);
	double squares = 0.0;

	for (int k = 0; k < count; k++) {
		const double off = f->strength[k] / mean - 1.0;

		squares += off * off / count;
	}
	return (float)sqrt(squares);
}

/* How often the newest measurements go from one side of their mean to the other, beyond their
 * noise: noise on a slow change does not. */
static int crossings(const struct lp_flicker *f, int count, float noise)
{
	const float mean = mean_of(f, 0, count), beyond = NOISE_SIGMAS * noise * mean;
	int crossed = 0, side = 0;

	for (int k = 0; k < count; k++) {
		const float off = f->strength[k] - mean;
		const int now = off > beyond ? 1 : off < -beyond ? -1 : side;

		crossed += side && now != side;
		side = now;
	}
	return crossed;
}

/* Mean over whole rounds of phases; its sigma by the noise, and by what its halves differ. */
static void sum_up(struct lp_flicker *f, float noise)
{
	const int whole = f->count >= PHASES ? f->count / PHASES * PHASES : f->count;
	const int half = whole / 2;
	float uneven = 0.0F;

	f->mean = mean_of(f, 0, whole);
	f->depth = depth_of(f, whole);
	if (half > 0)
		uneven = (mean_of(f, 0, half) - mean_of(f, half, half)) / (2.0F * f->mean);
	/* a camera's response errs alike in all measurements */
	f->sigma = hypotf(noise, fmaxf(f->depth / (float)whole, fabsf(uneven)));
}

bool lp_flicker_clips(const struct lp_flicker *flicker)
{
	return flicker->flickers && flicker->since_bound < PHASES;
}

/* Of one exposure setting only: a longer one clips some phases, or averages over all. */
static bool counts(struct lp_flicker *f, const struct lp_lamp_strength *measured)
{
	const bool longer = measured->scale * SAME_SCALE < f->scale;
	const bool shorter = measured->scale > f->scale * SAME_SCALE;

	if (measured->noise > MOST_NOISE || (longer && ++f->since_counted < MOST_UNCOUNTED))
		return false;
	if (longer || shorter) {
		if (measured->is_bound)
			return false;
		*f = (struct lp_flicker){.scale = measured->scale, .since_bound = PHASES};
	}
	f->since_counted = 0;
	return true;
}

void lp_flicker_add(struct lp_flicker *flicker, const struct lp_lamp_strength *measured)
{
	struct lp_flicker *f = flicker;

	if (!counts(f, measured))
		return;
	f->since_bound = measured->is_bound ? 0 : f->since_bound + 1;
	memmove(f->strength + 1, f->strength, sizeof(f->strength) - sizeof(*f->strength));
	f->strength[0] = measured->strength;
	f->count += f->count < LP_FLICKER_HISTORY;
	if (f->flickers && has_changed(f))
		f->count = PHASES;
	sum_up(f, measured->noise);
	if (f->count < LEAST_COUNT) /* after a change a lamp goes on as it did */
		return;
	const int recent = f->count < RECENT ? f->count : RECENT;
	const int crossed = crossings(f, recent, measured->noise);
	const float least = fmaxf(LEAST_DEPTH, DEPTH_SIGMAS * measured->noise);

	f->flickers = crossed >= (f->flickers ? STILL_CROSSINGS : CROSSINGS) &&
		      depth_of(f, recent) > least;
}
