/* SPDX-License-Identifier: Apache-2.0 */
/* By what a frame shows, which cells shine by themselves: lp_stuck_learn(). */
#include <math.h>
#include <string.h>

#include "light/math/rotation.h"
#include "vision/stuck/stuck_state.h"

/* A spot stands out of what is beside it by this share of that, and so much of full scale: the
 * rounding of a JPEG's dark blocks. What shows less does no harm. */
#define EXCESS 2.0F
#define LEAST_EXCESS 0.0006F
/* A cell that shows so many times what it shone by itself sees a lamp besides; and one that shows
 * less than this share of it does not shine. */
#define ALIKE 3.0F
#define GONE 0.05F
/* Whether it shows tells something where it would stand out by so many times the least. */
#define CLEARLY 1.5F
/* It was a lamp if at least this share of it is still seen where it was: a lamp lies between cells,
 * and may clip. */
#define KNOWN 0.3F
/* Of eight neighbours two cells away AS_BRIGHT may be as bright, as those of a row that shines;
 * LEAST_BESIDE of them must be seen. */
#define AS_BRIGHT 2
#define LEAST_BESIDE 5
/* A cell that shines by itself does so in a look with this probability: a lamp may be beside it. */
#define SHINES 0.9F
/* Any other one stands out in two looks as often as cells of this frame do, and at least as often
 * as this: lamps stand in rows. Behind a hand: between fingers. */
#define LEAST_OTHERS 0.05F
#define LEAST_BEHIND 0.001F

/* Logarithms of the odds before any look: that a cell of 64 pixels of a cheap sensor holds a stuck
 * one, one of half a million; and that it sees a light of the box, which is more than
 * MOST_PIXELS shine: the four into which colours of one are mixed. */
#define PIXEL_PRIOR (-9.0F)
#define LIGHT_PRIOR (-14.0F)
#define MOST_PIXELS 4.0F

static const int beside[8][2] = {{-2, 0},  {2, 0},  {0, -2}, {0, 2},
				 {-2, -2}, {2, -2}, {-2, 2}, {2, 2}};

/* What the surroundings of a cell show: the third brightest of its neighbours. NAN: too few are
 * seen. */
static float surround(const struct lp_stuck *stuck, int cell)
{
	float most[AS_BRIGHT + 1] = {0.0F};
	int seen = 0;

	for (int n = 0; n < 8; n++) {
		const int at = lp_stuck_beside(stuck, cell, beside[n][0], beside[n][1]);
		float light = at < 0 ? 0.0F : stuck->light[at];

		seen += at >= 0;
		for (int k = 0; k <= AS_BRIGHT; k++)
			if (light > most[k]) {
				const float less = most[k];

				most[k] = light;
				light = less;
			}
	}
	return seen < LEAST_BESIDE ? NAN : most[AS_BRIGHT];
}

static float least_excess(float surround)
{
	return EXCESS * surround + LEAST_EXCESS;
}

/* A cell that does not exceed two of these four does not stand out; nearly none does. */
static bool may_stand_out(const struct lp_stuck *stuck, int i)
{
	const float most = (stuck->light[i] - LEAST_EXCESS) / (1.0F + EXCESS);
	const float *at = stuck->light + i;
	const int row = 2 * stuck->columns;

	return (at[-2] < most) + (at[2] < most) + (at[-row] < most) + (at[row] < most) >= 2;
}

/* Marks cells that stand out, but those that are left out; gives how many do. */
static int find(struct lp_stuck *stuck)
{
	const int columns = stuck->columns;
	int count = 0;

	memset(stuck->stands, 0, (size_t)columns * stuck->rows);
	for (int i = 0; i < columns * stuck->rows; i++) {
		const int c = i % columns, r = i / columns;
		const bool inner = c >= 2 && c < columns - 2 && r >= 2 && r < stuck->rows - 2;

		if ((inner && !may_stand_out(stuck, i)) || stuck->is_sliver[i] ||
		    lp_stuck_leaves_out(stuck, i))
			continue;
		const float around = surround(stuck, i);

		stuck->stands[i] = stuck->light[i] > around + least_excess(around); /* not NAN */
		count += stuck->stands[i];
	}
	return count;
}

/* What every cell shows; of those that are left out, what fills them. */
static void measure(struct lp_stuck *stuck, const struct lp_cells *cells)
{
	for (int i = 0; i < stuck->columns * stuck->rows; i++)
		stuck->light[i] = lp_stuck_light(cells, i);
}

enum evidence { NOTHING, FOR, AGAINST };

/*
 * `light`: what the cell shows. A stuck pixel shows the same of full scale in every exposure, a
 * warm one the less the shorter it is; much more is a lamp that passes by. A JPEG's block that is
 * not decoded shows far less of it.
 */
static enum evidence judge(const struct lp_stuck *stuck, int i, float light, float scale)
{
	const struct lp_stuck_cell *cell = &stuck->cell[i];
	const float around = surround(stuck, i), excess = light - around; /* may be NAN */
	const float least = least_excess(around), ratio = cell->scale / scale;
	const float weakest = cell->excess * fminf(1.0F, ratio);
	const float strongest = cell->excess * fmaxf(1.0F, ratio);

	if (!isfinite(cell->excess))
		return excess > CLEARLY * least ? FOR : NOTHING;
	if (excess > least)
		return excess < ALIKE * strongest && strongest > CLEARLY * least ? FOR : NOTHING;
	return weakest > CLEARLY * least && excess < GONE * weakest ? AGAINST : NOTHING;
}

/* Whether a direction has nothing to do with one that was kept; nothing kept (0, 0, 0) has none. */
static bool is_apart(const struct lp_stuck *stuck, const int16_t then[3], const float now[3])
{
	const float cosine =
		(float)then[0] * now[0] + (float)then[1] * now[1] + (float)then[2] * now[2];

	return cosine < stuck->least_cosine * LP_STUCK_UNIT;
}

static void keep(int16_t then[3], const float now[3])
{
	for (int a = 0; a < 3; a++)
		then[a] = (int16_t)(now[a] * LP_STUCK_UNIT);
}

/* Whether light is at most of the places where the cell has shown itself, now that others look
 * there: those were lamps. In a row that shines some cells look at what others of it have looked
 * at. False of a first look: it counts, and one look is not enough. */
static bool saw_lamps(const struct lp_stuck *stuck, int i, float light,
		      const struct lp_stuck_look *look)
{
	const struct lp_stuck_cell *cell = &stuck->cell[i];
	const float around = surround(stuck, i);
	int lamps = 0;

	if (!look->known)
		return false;
	for (int k = 0; k < cell->shown_count; k++) {
		const int16_t *shown = cell->shown[k];
		const float there[3] = {shown[0], shown[1], shown[2]};
		const float known = look->known(look->context, there) / look->cells->scale;

		lamps += known > around + KNOWN * (light - around); /* not NAN */
	}
	return 2 * lamps > cell->shown_count;
}

/* Whether this is a look of its own; then it is noted. */
static bool looks_anew(const struct lp_stuck *stuck, int i, const struct lp_stuck_look *look,
		       bool shows, bool *behind)
{
	struct lp_stuck_cell *cell = &stuck->cell[i];
	float now[3];

	memcpy(now, stuck->ray[i], sizeof(now));
	*behind = look->covered && look->covered(look->context, now);
	if (*behind) {
		const bool first = !cell->looked_covered;

		cell->looked_covered = true;
		return first;
	}
	if (!look->turns)
		return false;
	lp_rotate_direction(look->to_anchor, now);
	if (!is_apart(stuck, cell->looked, now))
		return false;
	for (int k = 0; k < cell->shown_count && shows; k++)
		if (!is_apart(stuck, cell->shown[k], now))
			return false;
	keep(cell->looked, now);
	if (!shows)
		return true;
	keep(cell->shown[cell->next], now);
	cell->next = (uint8_t)((cell->next + 1) % LP_STUCK_SHOWN);
	if (cell->shown_count < LP_STUCK_SHOWN)
		cell->shown_count++;
	return true;
}

/* What a cell shows that may shine by itself. */
static void note(struct lp_stuck *stuck, int i, float excess, float scale)
{
	struct lp_stuck_cell *cell = &stuck->cell[i];
	const float pixels = excess * (float)(stuck->cell_px * stuck->cell_px);

	if (!isfinite(cell->excess))
		stuck->log_odds[i] = PIXEL_PRIOR;
	if (!isfinite(cell->excess) || isinf(cell->scale) || scale > cell->scale) {
		cell->excess = excess;
		cell->scale = scale;
	}
	if (pixels <= MOST_PIXELS || cell->is_light)
		return;
	cell->is_light = true;
	stuck->log_odds[i] += LIGHT_PRIOR - PIXEL_PRIOR;
}

/* One look at a cell that shows `light`; `others`: how often any cell stands out. True: whether it
 * is left out has changed. */
static bool weigh(struct lp_stuck *stuck, int i, float light, const struct lp_stuck_look *look,
		  float others)
{
	struct lp_stuck_cell *cell = &stuck->cell[i];
	const enum evidence evidence = judge(stuck, i, light, look->cells->scale);
	const bool before = stuck->log_odds[i] > 0.0F;
	const bool told = evidence == FOR && !saw_lamps(stuck, i, light, look);
	bool behind;

	if (evidence == NOTHING || !looks_anew(stuck, i, look, evidence == FOR, &behind))
		return false;
	stuck->any_covered |= behind;
	if (behind)
		others = LEAST_BEHIND;
	if (evidence == FOR)
		note(stuck, i, light - surround(stuck, i), look->cells->scale);
	if (evidence == AGAINST)
		stuck->log_odds[i] += logf((1.0F - SHINES) / (1.0F - others));
	else if (told || behind)
		stuck->log_odds[i] += logf(SHINES / others);
	if (stuck->log_odds[i] > LP_STUCK_CERTAIN)
		stuck->log_odds[i] = LP_STUCK_CERTAIN;
	if (evidence == AGAINST &&
	    stuck->log_odds[i] <= (cell->is_light ? LIGHT_PRIOR : PIXEL_PRIOR))
		lp_stuck_forget_cell(stuck, i);
	return before != (stuck->log_odds[i] > 0.0F);
}

/* The next hand that comes is another look. */
static void uncover(struct lp_stuck *stuck)
{
	for (int i = 0; i < stuck->columns * stuck->rows && stuck->any_covered; i++)
		stuck->cell[i].looked_covered = false;
	stuck->any_covered = false;
}

/* Whether any cell looks elsewhere than in the last look, as far as that matters. */
static bool has_turned(const struct lp_stuck *stuck, const struct lp_rotation *to_anchor)
{
	double trace = 0.0;

	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			trace += to_anchor->m[a][b] * stuck->looked_from.m[a][b];
	return (trace - 1.0) / 2.0 < (double)stuck->least_cosine;
}

void lp_stuck_learn(struct lp_stuck *stuck, const struct lp_stuck_look *look)
{
	const int cells = stuck->columns * stuck->rows;
	bool changed = false;

	if (!look->covered)
		uncover(stuck);
	if (!look->covered && (!look->turns || !has_turned(stuck, look->to_anchor)))
		return;
	stuck->looked_from = *look->to_anchor;
	measure(stuck, look->cells);
	const float others = fmaxf((float)find(stuck) / (float)cells, LEAST_OTHERS);

	for (int k = 0; k < stuck->count; k++)
		changed |= weigh(stuck, stuck->list[k], stuck->own[k], look, others);
	for (int i = 0; i < cells; i++)
		if ((stuck->stands[i] || stuck->log_odds[i] > LP_STUCK_UNKNOWN) &&
		    stuck->log_odds[i] <= 0.0F)
			changed |= weigh(stuck, i, stuck->light[i], look, others);
	if (changed)
		lp_stuck_make_list(stuck);
}
