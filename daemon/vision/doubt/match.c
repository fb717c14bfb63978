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
	const float *exposures_us;
	float codes[LP_MAX_CANDIDATES]; /* predicted for a cell; NAN: not known */
	double sum[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES],
		apart[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES];
	int cells[LP_MAX_CANDIDATES][LP_MAX_CANDIDATES];
};

/* What the longest exposure so far could just make out. */
static float least_known(const struct lp_imager *imager)
{
	float least = INFINITY;

	for (int k = 0; k < LP_MAX_BRACKET; k++)
		if (imager->eye->recent[k].serial)
			least = fminf(least,
				      LEAST_LINEAR * 1e6F / imager->eye->recent[k].exposure_us);
	return least;
}

static void predict(struct comparison *c, float known, bool is_bound, float least)
{
	for (int k = 0; k < c->count; k++) {
		const float predicted = known * c->exposures_us[k] * 1e-6F;

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
		    const struct lp_cover_view *view, const struct lp_cover *cover, int step)
{
	const struct lp_radiance_map *map = imager->map;
	const int count = imager->grid->width * imager->grid->height;
	const float least = least_known(imager);

	memset(c->sum, 0, sizeof(c->sum));
	memset(c->apart, 0, sizeof(c->apart));
	memset(c->cells, 0, sizeof(c->cells));
	for (int i = 0; i < count; i += step) {
		const int seen = lp_cover_seen_cell(view, i);

		if (((map->flags[i] | imager->eye->seen.flags[seen]) & LP_CELL_UNSEEN) ||
		    (cover && cover->near[lp_cover_block(imager->grid->width, seen)]))
			continue;
		predict(c, map->radiance[i][LP_LUMINANCE], map->flags[i] & LP_CELL_CLIPPED, least);
		add_cell(c, 255.0F * code_of(imager->eye->seen.cells[seen][LP_LUMINANCE] /
					     imager->eye->incoming.cells.scale));
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
			   const struct lp_cover_view *view, const struct lp_cover *cover)
{
	compare(imager, c, view, cover, STEP);
	if (!tells_all(c)) /* maybe by a lamp of a few cells */
		compare(imager, c, view, cover, 1);
}

static float difference(const struct comparison *c, int a, int b)
{
	return c->apart[a][b] < LEAST_EVIDENCE ? NAN : (float)(c->sum[a][b] / c->cells[a][b]);
}

/* A hand before the lens, which shows if the frame was exposed so, says nothing of the exposure. */
static bool look_for_cover(const struct lp_imager *imager, float exposure_us,
			   struct lp_cover *cover)
{
	const struct lp_cover_view view = lp_imager_cover_view(imager, exposure_us);

	*cover = lp_cover_look(&imager->eye->cover, &view);
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
	struct comparison c = {.count = count, .exposures_us = exposures_us}, uncovered = c;
	struct lp_cover cover;

	for (int i = 0; i < LP_MAX_CANDIDATES * LP_MAX_CANDIDATES; i++)
		matches->codes[i / LP_MAX_CANDIDATES][i % LP_MAX_CANDIDATES] = NAN;
	if (count < 2 || !imager->loaded || !imager->t_map_ns ||
	    isnan(imager->eye->incoming.cells.mean_code))
		return;
	const struct lp_cover_view view = lp_imager_cover_view(imager, NAN);

	compare_enough(imager, &c, &view, NULL);
	for (int a = 0; a < count; a++) {
		take_row(&c, a, matches);
		if (is_doubtful(imager, matches->codes[a], count) &&
		    look_for_cover(imager, exposures_us[a], &cover)) {
			compare_enough(imager, &uncovered, &view, &cover);
			take_row(&uncovered, a, matches);
		}
	}
}
