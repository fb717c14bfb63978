/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/holding.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/panorama.h"
#include "light/find/detection.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* A found lamp is a remembered one when they share this much of the cells of each. */
#define SAME_CELLS 0.5F
/* Sharing less than this of the cells of both they have nothing to do with each other. */
#define FEW_CELLS 0.2F

/* A remembered lamp and what has been found over its cells. */
struct claim {
	struct lp_remembered_lamp *lamp;
	int shared[LP_MAX_LAMPS]; /* cells, per found lamp */
};

/* Which found lamp each cell is of: index + 1; 0: of none. */
static void mark_owners(struct lp_lamp_finder *finder)
{
	memset(finder->owner, 0, (size_t)finder->grid->width * finder->grid->height);
	for (int k = 0; k < finder->count; k++)
		for (int i = 0; i < finder->lamps[k].count; i++)
			finder->owner[finder->cells[finder->lamps[k].first + i]] = (uint8_t)(k + 1);
}

static void count_shared(const struct lp_lamp_finder *finder, struct claim *claim)
{
	const struct lp_lamp *lamp = &claim->lamp->on_grid;

	for (int i = 0; i < lamp->count; i++) {
		const int owner = finder->owner[finder->cells_before[lamp->first + i]];

		if (owner)
			claim->shared[owner - 1]++;
	}
}

static bool touches(const struct claim *claim, const struct lp_lamp_finder *finder, int k)
{
	return (float)claim->shared[k] > FEW_CELLS * (float)claim->lamp->on_grid.count ||
	       (float)claim->shared[k] > FEW_CELLS * (float)finder->lamps[k].count;
}

/* Whether a found lamp has the borders of a remembered one, or those of what was clipped of it:
 * they leave out its rim, and were never those of the lamp. */
static bool has_borders(const struct claim *claim, const struct lp_lamp *found, int shared)
{
	const struct lp_lamp *known = &claim->lamp->on_grid;
	const bool showed = (known->flags & ~found->flags) & LP_LIGHT_CLIPPED;

	return (float)shared > SAME_CELLS * (float)known->count &&
	       (showed || (float)shared > SAME_CELLS * (float)found->count);
}

/* The found lamp with the same borders as a remembered one; -1: none. */
static int same_borders(const struct claim *claim, const struct lp_detection *detection)
{
	const struct lp_lamp_finder *finder = detection->finder;

	for (int k = 0; k < finder->count; k++) {
		const struct lp_lamp *found = &finder->lamps[k];

		if (has_borders(claim, found, claim->shared[k]) &&
		    lp_lamp_stays_wide(claim->lamp, lp_detection_width_deg(detection, found)) ==
			    claim->lamp->wide)
			return k;
	}
	return -1;
}

/* Whether a found lamp would take the place of this remembered one: a small lamp before a wide one
 * is another, and a wide one around a small one is only a sky that has reached it. */
static bool rivals(const struct claim *claim, const struct lp_detection *detection, int k)
{
	const bool wide =
		lp_detection_width_deg(detection, &detection->finder->lamps[k]) >= LP_COMPACT_DEG;

	return wide == claim->lamp->wide && touches(claim, detection->finder, k);
}

static bool is_disputed(const struct claim *claim, const struct lp_detection *detection)
{
	for (int k = 0; k < detection->finder->count; k++)
		if (!detection->finder->lamps[k].known_id && rivals(claim, detection, k))
			return true;
	return false;
}

/* Found lamps that share cells with a held one go, but small ones before a wide one. */
static void drop_rivals(const struct claim *claim, const struct lp_detection *detection,
			bool dropped[LP_MAX_LAMPS])
{
	for (int k = 0; k < detection->finder->count; k++)
		if (!detection->finder->lamps[k].known_id && touches(claim, detection->finder, k) &&
		    (!claim->lamp->wide || rivals(claim, detection, k)))
			dropped[k] = true;
}

/* A small lamp before a wide one has its own cells: what is held of the wide one is the rest.
 * Changes the cells of the frame before in place. */
static void leave_out_lamps_before(const struct claim *claim, const struct lp_detection *detection,
				   struct lp_lamp *held)
{
	const struct lp_lamp_finder *finder = detection->finder;
	int32_t *cells = finder->cells_before + held->first;
	int count = 0, core_count = 0;

	for (int i = 0; i < held->count; i++) {
		const int owner = finder->owner[cells[i]];

		if (owner && !rivals(claim, detection, owner - 1))
			continue;
		core_count += i < held->core_count;
		cells[count++] = cells[i];
	}
	held->count = count;
	held->core_count = core_count;
}

/* In the first seconds the map is still being filled: the first borders are guesses. */
static float patience_s(const struct lp_remembered_lamp *lamp)
{
	return fminf(LP_BORDERS_S, 0.5F * lamp->known_s);
}

static int make_claims(struct lp_lamp_memory *memory, const struct lp_lamp_finder *finder,
		       struct claim claims[LP_MAX_LAMPS])
{
	int count = 0;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		struct lp_remembered_lamp *m = &memory->list[p];

		if (!m->id || !m->seen || !m->on_grid.count)
			continue;
		claims[count] = (struct claim){.lamp = m};
		count_shared(finder, &claims[count++]);
	}
	return count;
}

static void insert_held(struct lp_lamp_finder *finder, const bool dropped[LP_MAX_LAMPS],
			const struct lp_lamp *held, int held_count)
{
	struct lp_lamp found[LP_MAX_LAMPS];
	const int count = finder->count;

	memcpy(found, finder->lamps, sizeof(found));
	finder->count = 0;
	for (int k = 0; k < count; k++)
		if (!dropped[k])
			lp_lamp_insert(finder, &found[k]);
	for (int k = 0; k < held_count; k++)
		lp_lamp_insert(finder, &held[k]);
}

void lp_hold_lamps(struct lp_lamp_memory *memory, struct lp_detection *detection,
		   const struct lp_panorama *panorama, float mean, float elapsed_s)
{
	struct lp_lamp_finder *finder = detection->finder;
	struct claim claims[LP_MAX_LAMPS];
	struct lp_lamp held[LP_MAX_LAMPS];
	bool dropped[LP_MAX_LAMPS] = {false};
	int held_count = 0;

	if (!lp_detection_finds_regions(detection))
		return;
	mark_owners(finder);
	const int count = make_claims(memory, finder, claims);

	for (int c = 0; c < count; c++) {
		const int same = same_borders(&claims[c], detection);

		if (same >= 0 && !finder->lamps[same].known_id)
			finder->lamps[same].known_id = claims[c].lamp->id;
		else
			claims[c].lamp->seen = false; /* not yet */
	}
	for (int c = 0; c < count; c++) {
		struct lp_remembered_lamp *m = claims[c].lamp;

		if (m->seen || !is_disputed(&claims[c], detection))
			m->disputed_s = 0.0F;
		else
			m->disputed_s += elapsed_s;
		/* what may be clutter keeps none: who walks before a window cuts pieces off it */
		if (m->seen || m->disputed_s > patience_s(m) || !lp_exists(&m->existence))
			continue;
		held[held_count] = m->on_grid;
		if (m->wide)
			leave_out_lamps_before(&claims[c], detection, &held[held_count]);
		if (!held[held_count].core_count ||
		    !lp_detection_hold(detection, panorama, mean, &held[held_count]))
			continue;
		held[held_count++].known_id = m->id;
		drop_rivals(&claims[c], detection, dropped);
	}
	insert_held(finder, dropped, held, held_count);
}
