/* SPDX-License-Identifier: Apache-2.0 */
/* Which exposure a frame had, by what it shows: lp_imager_match(). */
#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "light/math/grid.h"
#include "vision/imager_internal.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* Every so many cells is compared: enough for a mean. */
#define STEP 5
/* Linear values below this, of full scale, are within a camera's noise: they are all alike, and
 * tell nothing when longer exposures are predicted from them. */
#define LEAST_LINEAR 0.002F

/* Cells whose codes two exposures predict so far apart tell them; they do when these distances sum
 * up to so much. */
#define LEAST_APART 2.0F
#define LEAST_EVIDENCE 64.0
/* From this difference on it is looked whether the lens is covered. */
#define DOUBTFUL_CODES 4.0F

/* Of a square-root response, 0..1, between noise and full scale. */
static float code_of(float linear)
{
	return sqrtf(fminf(fmaxf(linear, LEAST_LINEAR), 1.0F));
}

/* Exposures, and what cells say of each pair of them. */
struct comparison {
	int count;
	float scales[LP_MAX_CANDIDATES]; /* full scale to radiance, by each */
	float codes[LP_MAX_CANDIDATES];	 /* predicted for a cell; NAN: not known */
	double sum[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES],
		apart[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES];
	int cells[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES];
};

/* What the longest exposure so far could just make out. */
static float least_known(const struct lp_imager *imager)
{
	float least = INFINITY;

	for (int k = 0; k < LP_MAX_BRACKET; k++) {
		const struct lp_recent_exposure *e = &imager->eye->recent[k];

		if (e->serial)
			least = fminf(least,
				      LEAST_LINEAR * lp_imager_scale_of(imager, e->exposure_us));
	}
	return least;
}

static void predict(struct comparison *c, float known, bool is_bound, float least)
{
	for (int k = 0; k < c->count; k++) {
		const float predicted = known / c->scales[k];

		/* a clipped cell is known to be bright, not how bright */
		c->codes[k] = (is_bound && predicted < 1.0F) ||
					      (known < least && predicted > LEAST_LINEAR)
				      ? NAN
				      : 255.0F * code_of(predicted);
	}
}

static void add_cell(struct comparison *c, float observed)
{
	for (int a = 0; a < c->count; a++)
		for (int b = 0; b < c->count; b++) {
			const float apart = fabsf(c->codes[a] - c->codes[b]);

			if (!(apart >= LEAST_APART)) /* also of NAN */
				continue;
			c->sum[a][b] += fabsf(c->codes[a] - observed);
			c->apart[a][b] += apart;
			c->cells[a][b]++;
		}
}

/* cover: what is left out; NULL: nothing. */
static void compare(const struct lp_imager *imager, struct comparison *c,
		    const struct lp_residual *residual, const struct lp_cover *cover, int step)
{
	const struct lp_radiance_map *map = imager->map;
	const int count = imager->grid->width * imager->grid->height;
	const float least = least_known(imager);

	memset(c->sum, 0, sizeof(c->sum));
	memset(c->apart, 0, sizeof(c->apart));
	memset(c->cells, 0, sizeof(c->cells));
	for (int i = 0; i < count; i += step) {
		const int seen = lp_residual_seen(residual, i);

		if (((map->flags[i] | residual->seen.flags[seen]) & LP_CELL_UNSEEN) ||
		    (cover && cover->near[lp_cover_block(imager->grid->width, seen)]))
			continue;
		predict(c, map->radiance[i][LP_LUMINANCE], map->flags[i] & LP_CELL_CLIPPED, least);
		add_cell(c, 255.0F * code_of(residual->seen.radiance[seen][LP_LUMINANCE] /
					     residual->seen.scale));
	}
}

static bool tells_all(const struct comparison *c)
{
	for (int a = 1; a < c->count; a++)
		for (int b = 0; b < a; b++)
			if (c->apart[a][b] < LEAST_EVIDENCE)
				return false;
	return true;
}

static void compare_enough(const struct lp_imager *imager, struct comparison *c,
			   const struct lp_residual *residual, const struct lp_cover *cover)
{
	compare(imager, c, residual, cover, STEP);
	if (!tells_all(c)) /* maybe by a lamp of a few cells */
		compare(imager, c, residual, cover, 1);
}

static float difference(const struct comparison *c, int a, int b)
{
	return c->apart[a][b] < LEAST_EVIDENCE ? NAN : (float)(c->sum[a][b] / c->cells[a][b]);
}

/* A hand before the lens, which shows if the frame was exposed so, says nothing of the exposure. */
static bool look_for_cover(const struct lp_imager *imager, const struct lp_residual *residual,
			   float scale, struct lp_cover *cover)
{
	*cover = lp_cover_look(&imager->eye->cover, residual, scale);
	return cover->found;
}

static void take_row(const struct comparison *c, int a, struct lp_exposure_matches *matches)
{
	for (int b = 0; b < c->count; b++)
		matches->codes[a][b] = difference(c, a, b);
}

static bool is_doubtful(const struct lp_imager *imager, const float *codes, int count)
{
	bool is_far = imager->eye->cover.found;

	for (int b = 0; b < count; b++)
		is_far |= codes[b] > DOUBTFUL_CODES;
	return is_far;
}

void lp_imager_match(const struct lp_imager *imager, const float *exposures_us, int count,
		     struct lp_exposure_matches *matches)
{
	struct comparison c = {.count = count}, uncovered;
	struct lp_cover cover;

	for (int i = 0; i < LP_MAX_CANDIDATES * LP_MAX_CANDIDATES; i++)
		matches->codes[i / LP_MAX_CANDIDATES][i % LP_MAX_CANDIDATES] = NAN;
	if (count < 2 || !imager->loaded || !imager->t_map_ns ||
	    isnan(imager->eye->incoming.cells.mean_code))
		return;
	const struct lp_residual residual = lp_imager_residual(imager);

	for (int k = 0; k < count; k++)
		c.scales[k] = lp_imager_scale_of(imager, exposures_us[k]);
	uncovered = c;
	compare_enough(imager, &c, &residual, NULL);
	for (int a = 0; a < count; a++) {
		take_row(&c, a, matches);
		if (is_doubtful(imager, matches->codes[a], count) &&
		    look_for_cover(imager, &residual, c.scales[a], &cover)) {
			compare_enough(imager, &uncovered, &residual, &cover);
			take_row(&uncovered, a, matches);
		}
	}
}
