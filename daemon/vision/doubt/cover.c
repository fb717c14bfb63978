/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/doubt/cover.h"

#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/math/grid.h"
#include "vision/map/residual.h"

/* Chosen by hand, on the covered scenes of docs/users/accuracy.md, "When things go wrong". */

/* Every so many columns and rows of cells are compared; and to see whether that is worth while. */
#define STEP 2
#define FIRST_STEP (2 * STEP)
/* Below this linear value a cell is too dark in the frame to tell whether it is covered. */
#define LEAST_LINEAR 0.008F
/* Covered: the frame shows less than this share of what is known. */
#define DARK 0.15F
/* Open: it shows what is known, within this ratio. */
#define ALIKE 1.6F
/* A block is covered when so much of what tells is dark, and tells when so many cells do. */
#define DARK_SHARE 0.6F
#define LEAST_TELLING 3
/* Share of the sphere that a hand covers at least when it comes; and as long as it stays. */
#define LEAST_COVERED 0.08F
#define LEAST_STAYING 0.03F
/* Share of the sphere that must be dark in the frame, and known to be bright, for a hand to have
 * come: of LEAST_COVERED, the few cells that tell may be as few as this. */
#define LEAST_DARK (LEAST_COVERED / 16.0F)
/* When it comes, so much of the telling sphere is open at least, and of that so much is alike. */
#define LEAST_OPEN 0.15F
#define LEAST_ALIKE 0.6F
/* Neighbouring blocks that must be covered for a block to be taken as covered, too. */
#define SURROUNDED 5
/* 1 sigma of a cell's linear value: noise and rounding of codes in the dark. */
#define NOISE_LINEAR 0.0005F
/* Less light leaves detail in proportion; this share of it at least, or the detail is gone. */
#define DETAIL_SHARE 0.5
#define DETAIL_SIGMAS 3.0
/* Such frames in a row, until what was taken for a hand is taken for lights that went off. */
#define MOST_DIMMED 3

struct tally {
	uint16_t telling[LP_COVER_BLOCKS], dark[LP_COVER_BLOCKS];
	double open_sr, alike_sr; /* of cells that are not dark */
	/* of dark cells, for a regression of the frame on the map */
	double map, frame, map_steps2, steps;
};

/* A frame and what is known, both per full scale of the frame. */
struct view {
	const struct lp_residual *residual;
	const struct lp_grid *grid;
	float map_scale; /* radiance of what is known, if the frame's exposure is right */
};

static float linear(const float *radiance, float scale)
{
	return fminf(radiance[LP_LUMINANCE] / scale, 1.0F);
}

static float shown_linear(const struct view *view, int seen)
{
	return linear(view->residual->seen.radiance[seen], view->residual->seen.scale);
}

/* What is known of a cell, or was before the light changed: by a hand that is only found now,
 * maybe.
 */
static float known_linear(const struct view *view, int cell)
{
	return linear(lp_radiance_map_before(view->residual->map, cell, LP_COVER_COMES_S),
		      view->map_scale);
}

static bool is_dark(const struct view *view, int seen, float known, float shown)
{
	return !(view->residual->seen.flags[seen] & LP_CELL_CLIPPED) && shown < DARK * known;
}

/* Whether enough of the sphere is dark that the lens may be covered: nearly never so. */
static bool may_be_covered(const struct view *view)
{
	const struct lp_grid *grid = view->grid;
	double dark_sr = 0.0;

	for (int r = 0; r < grid->height; r += FIRST_STEP)
		for (int c = r / FIRST_STEP % FIRST_STEP; c < grid->width; c += FIRST_STEP) {
			const int i = r * grid->width + c,
				  seen = lp_residual_seen(view->residual, i);
			const float shown = shown_linear(view, seen);

			if (shown >= DARK || /* of full scale, more than which is not known */
			    ((view->residual->map->flags[i] | view->residual->seen.flags[seen]) &
			     LP_CELL_UNSEEN))
				continue;
			const float known = known_linear(view, i);

			if (known >= LEAST_LINEAR && is_dark(view, seen, known, shown))
				dark_sr += grid->row_solid_angle_sr[r];
		}
	return dark_sr * FIRST_STEP * FIRST_STEP > 4.0 * M_PI * LEAST_DARK;
}

/* Steps to the cell on the right, of map and frame. */
static void add_detail(const struct view *view, int i, int seen, float known, float shown,
		       struct tally *t)
{
	const int next = lp_residual_seen(view->residual, i + 1);
	const double known_step = known_linear(view, i + 1) - known;
	const double shown_step = shown_linear(view, next) - shown;

	t->map += known;
	t->frame += shown;
	if (next == seen || shown + shown_step >= DARK * (known + known_step))
		return; /* across the rim */
	t->map_steps2 += known_step * known_step;
	t->steps += known_step * shown_step;
}

static void compare(const struct view *view, struct tally *t)
{
	const struct lp_grid *grid = view->grid;
	const struct lp_radiance_map *map = view->residual->map;
	const uint8_t unseen = LP_CELL_UNSEEN;

	memset(t, 0, sizeof(*t));
	for (int r = 0; r < grid->height; r += STEP)
		for (int c = r / STEP % STEP; c + 1 < grid->width; c += STEP) {
			const int i = r * grid->width + c,
				  seen = lp_residual_seen(view->residual, i);
			const int block = lp_cover_block(grid->width, seen);
			const float sr = grid->row_solid_angle_sr[r];

			if ((map->flags[i] | view->residual->seen.flags[seen]) & unseen)
				continue;
			const float known = known_linear(view, i);
			const float shown = shown_linear(view, seen);

			if (known < LEAST_LINEAR)
				continue;
			t->telling[block]++;
			if (is_dark(view, seen, known, shown)) {
				t->dark[block]++;
				add_detail(view, i, seen, known, shown, t);
				continue;
			}
			t->open_sr += sr;
			if (shown < ALIKE * known && known < ALIKE * shown)
				t->alike_sr += sr;
		}
}

/*
 * Light has gone, and nothing stands before it: what is dark has kept its detail in proportion.
 * Frames in a row that say so, after `before` of them; a frame that shows too little to say does
 * not count.
 */
static int dimmed_frames(const struct tally *t, int before)
{
	if (!(t->map_steps2 > 0.0) || !(t->map > 0.0))
		return before;
	const double slope = t->steps / t->map_steps2;
	const double sigma = sqrt(2.0 * NOISE_LINEAR * NOISE_LINEAR / t->map_steps2);
	const double least = DETAIL_SHARE * t->frame / t->map;

	if (slope > least + DETAIL_SIGMAS * sigma)
		return before + 1;
	return DETAIL_SIGMAS * sigma < least ? 0 : before;
}

static int covered_around(const uint8_t *covered, int block)
{
	const int row = block / LP_COVER_COLUMNS, column = block % LP_COVER_COLUMNS;
	int count = 0;

	for (int y = row - 1; y <= row + 1; y++)
		for (int x = -1; x <= 1; x++) {
			const int at = (column + x + LP_COVER_COLUMNS) % LP_COVER_COLUMNS;

			if (y >= 0 && y < LP_COVER_ROWS && (x || y != row))
				count += covered[y * LP_COVER_COLUMNS + at];
		}
	return count;
}

/* Each block by its cells, or as it was where they do not tell; and the holes in between. */
static void judge_blocks(const struct lp_cover *before, const struct tally *t,
			 uint8_t covered[LP_COVER_BLOCKS])
{
	uint8_t own[LP_COVER_BLOCKS];

	for (int b = 0; b < LP_COVER_BLOCKS; b++)
		own[b] = t->telling[b] >= LEAST_TELLING
				 ? (float)t->dark[b] >= DARK_SHARE * (float)t->telling[b]
				 : before->found && before->covered[b];
	for (int b = 0; b < LP_COVER_BLOCKS; b++)
		covered[b] = own[b] || (t->telling[b] < LEAST_TELLING &&
					covered_around(own, b) >= SURROUNDED);
}

/* Solid angle of a block, as a share of the sphere. */
static float share_of(int block)
{
	const double row = block / LP_COVER_COLUMNS;

	return (float)((cos(M_PI * row / LP_COVER_ROWS) - cos(M_PI * (row + 1.0) / LP_COVER_ROWS)) /
		       2.0 / LP_COVER_COLUMNS);
}

/* Give a connected region of `from` its mark in `region`; returns its share of the sphere. */
static float grow(const uint8_t *from, int start, uint8_t mark, uint8_t region[LP_COVER_BLOCKS])
{
	int16_t stack[LP_COVER_BLOCKS];
	int count = 0;
	float share = 0.0F;

	stack[count++] = (int16_t)start;
	region[start] = mark;
	while (count) {
		const int block = stack[--count];
		const int row = block / LP_COVER_COLUMNS, column = block % LP_COVER_COLUMNS;
		const int beside[4] = {
			row ? block - LP_COVER_COLUMNS : block,
			row + 1 < LP_COVER_ROWS ? block + LP_COVER_COLUMNS : block,
			row * LP_COVER_COLUMNS + (column + 1) % LP_COVER_COLUMNS,
			row * LP_COVER_COLUMNS + (column + LP_COVER_COLUMNS - 1) % LP_COVER_COLUMNS,
		};

		share += share_of(block);
		for (int k = 0; k < 4; k++)
			if (from[beside[k]] && !region[beside[k]]) {
				region[beside[k]] = mark;
				stack[count++] = (int16_t)beside[k];
			}
	}
	return share;
}

/* Keep the regions that are large enough; returns the largest one's share of the sphere. */
static float keep_large(uint8_t covered[LP_COVER_BLOCKS])
{
	uint8_t region[LP_COVER_BLOCKS] = {0};
	bool large[UINT8_MAX + 1] = {false};
	uint8_t mark = 0;
	float largest = 0.0F;

	for (int b = 0; b < LP_COVER_BLOCKS && mark < UINT8_MAX; b++)
		if (covered[b] && !region[b]) {
			const float share = grow(covered, b, ++mark, region);

			large[mark] = share >= LEAST_STAYING;
			largest = fmaxf(largest, share);
		}
	for (int b = 0; b < LP_COVER_BLOCKS; b++)
		covered[b] = large[region[b]];
	return largest;
}

struct lp_cover lp_cover_look(const struct lp_cover *before, const struct lp_residual *residual,
			      float scale)
{
	const struct view view = {residual, residual->map->grid, scale};
	struct lp_cover cover = {.found = false};
	struct tally t;

	if (!before->found && !may_be_covered(&view))
		return cover;
	compare(&view, &t);
	judge_blocks(before, &t, cover.covered);
	const float largest = keep_large(cover.covered);
	double telling_sr = 0.0;

	for (int b = 0; b < LP_COVER_BLOCKS; b++)
		telling_sr += t.telling[b] ? 4.0 * M_PI * share_of(b) : 0.0;
	/* sampled cells stand for STEP^2 */
	const double open_sr = t.open_sr * STEP * STEP, alike_sr = t.alike_sr * STEP * STEP;
	const bool comes = largest >= LEAST_COVERED && open_sr > LEAST_OPEN * telling_sr &&
			   alike_sr > LEAST_ALIKE * open_sr;

	cover.dimmed_frames = dimmed_frames(&t, before->found ? before->dimmed_frames : 0);
	cover.found = before->found ? largest >= LEAST_STAYING && cover.dimmed_frames < MOST_DIMMED
				    : comes && !cover.dimmed_frames;
	for (int b = 0; b < LP_COVER_BLOCKS; b++) {
		cover.covered[b] &= cover.found;
		cover.near[b] =
			cover.found && (cover.covered[b] || covered_around(cover.covered, b) > 0);
	}
	return cover;
}

void lp_cover_mark(const struct lp_cover *cover, const struct lp_grid *grid, uint8_t *flags)
{
	for (int i = 0; i < grid->width * grid->height; i++) {
		const bool covered = cover->near[lp_cover_block(grid->width, i)];

		flags[i] =
			(uint8_t)((flags[i] & ~LP_CELL_COVERED) | (covered ? LP_CELL_COVERED : 0));
	}
}
