/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/lamp_memory.h"

#include <math.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "light/find/detection.h"
#include "light/lamps/lamp_follow.h"
#include "light/math/rotation.h"

#define RAD ((float)M_PI / 180.0F)
/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* A lamp becomes an area light, or an area light a lamp, beyond LP_COMPACT_DEG by this factor. */
#define STAYS_WIDE 1.4F
/* Of the two limits that make a lamp a piece of a wider one, for a lamp that is known already. */
#define STAYS_APART 0.77F
/* A lamp's light has come with it when this share of it was not there before. */
#define CAME_SHARE 0.5F
/* A block of the picture of 1920 pixels: 1.5 degrees along and across. */
#define BLOCK_SR (1.5F * RAD * 1.5F * RAD)

bool lp_lamp_stays_wide(const struct lp_remembered_lamp *lamp, float width_deg)
{
	return width_deg >=
	       (lamp->wide ? LP_COMPACT_DEG / STAYS_WIDE : LP_COMPACT_DEG * STAYS_WIDE);
}

/* Those whose cells tell which lamps they are. */
static void associate_known(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *sightings,
			    int count, int place[LP_MAX_LAMPS])
{
	for (int k = 0; k < count; k++) {
		place[k] = -1;
		for (int p = 0; sightings[k].on_grid.known_id && p < LP_MAX_LAMPS; p++)
			if (memory->list[p].id == sightings[k].on_grid.known_id) {
				place[k] = p;
				memory->list[p].seen = true;
			}
	}
}

/* Which place each sighting belongs to; -1: none. */
static void associate(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *sightings,
		      int count, int place[LP_MAX_LAMPS])
{
	associate_known(memory, sightings, count, place);
	for (;;) {
		float best = INFINITY;
		int best_sighting = 0, best_place = -1;

		for (int k = 0; k < count; k++) {
			const struct lp_lamp *lamp = &sightings[k].on_grid;

			for (int p = 0; place[k] < 0 && p < LP_MAX_LAMPS; p++) {
				const struct lp_remembered_lamp *m = &memory->list[p];

				if (!m->id || m->seen ||
				    lp_lamp_stays_wide(m, sightings[k].width_deg) != m->wide)
					continue;
				const float apart =
					fminf(lp_lamp_apart_rad(m->on_grid.direction,
								lamp->direction),
					      lp_lamp_apart_rad(m->whole, lamp->direction));
				if (apart < best && apart < lp_lamp_gate_rad(lamp)) {
					best = apart;
					best_sighting = k;
					best_place = p;
				}
			}
		}
		if (best_place < 0)
			return;
		place[best_sighting] = best_place;
		memory->list[best_place].seen = true;
	}
}

/* Of its disc, luminance. */
static float mean_radiance(const struct lp_lamp *lamp)
{
	return lamp->irradiance[LP_LUMINANCE] / fmaxf(lamp->solid_angle_sr, 1e-12F);
}

/* With what the ring finds of it, which clips in the picture. */
static float known_radiance(const struct lp_remembered_lamp *m)
{
	return mean_radiance(&m->lamp) +
	       m->recovered[LP_LUMINANCE] / fmaxf(m->lamp.solid_angle_sr, 1e-12F);
}

/* Radius of a disc that lies within it: of one that is longer than wide, half of its width. */
static float inner_radius_rad(const struct lp_lamp *lamp)
{
	const float radius = sqrtf(lamp->solid_angle_sr / (float)M_PI);
	const float half_width = lamp->half_angle_deg[1] * RAD;

	return half_width > 0.0F ? fminf(radius, half_width) : radius;
}

/* Whether a lamp of this radiance is only a piece of another: it lies within the other and is
 * hardly brighter. What a misplaced frame left beside a lamp would be held as if it were one. The
 * margin is a factor on the limits of radiance and of distance. */
static bool is_piece(const struct lp_lamp *lamp, float radiance,
		     const struct lp_remembered_lamp *of, float margin)
{
	return of->id && of->seen && lamp->solid_angle_sr <= of->lamp.solid_angle_sr &&
	       radiance < margin * LP_PEAK_STANDS_OUT * known_radiance(of) &&
	       lp_lamp_apart_rad(lamp->direction, of->lamp.direction) <
		       margin * inner_radius_rad(&of->lamp);
}

static bool is_piece_of_any(const struct lp_lamp_memory *memory, const struct lp_lamp *lamp,
			    float radiance, float margin)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (&memory->list[p].lamp != lamp &&
		    is_piece(lamp, radiance, &memory->list[p], margin))
			return true;
	return false;
}

static void give_up(struct lp_lamp_memory *memory, struct lp_remembered_lamp *m)
{
	lp_existence_end(&m->existence, &memory->clutter);
	m->id = 0;
}

/* Of two pieces of the same size the newer one goes. */
static void drop_pieces(struct lp_lamp_memory *memory)
{
	for (int p = LP_MAX_LAMPS - 1; p >= 0; p--) {
		struct lp_remembered_lamp *m = &memory->list[p];

		if (m->id && m->seen &&
		    is_piece_of_any(memory, &m->lamp, known_radiance(m), STAYS_APART))
			give_up(memory, m);
	}
}

static bool enters(const struct lp_lamp_memory *memory, const struct lp_lamp_sighting *s)
{
	const struct lp_lamp *lamp = s->refined ? &s->pixels : &s->on_grid;

	return s->enters && !is_piece_of_any(memory, lamp, mean_radiance(lamp), 1.0F);
}

/* A free place; else that of the least likely lamp that is not seen, if it is less likely than one
 * of these log odds; -1: there is none. */
static int free_place(const struct lp_lamp_memory *memory, float log_odds)
{
	int found = -1;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (!m->id)
			return p;
		if (!m->seen && m->existence.log_odds < log_odds) {
			found = p;
			log_odds = m->existence.log_odds;
		}
	}
	return found;
}

/* A lamp that is new; returns its place, -1: there is none. */
static int begin(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *s)
{
	struct lp_existence existence = lp_existence_found(&memory->clutter);

	if (s->came > CAME_SHARE)
		lp_existence_prove(&existence);
	const int place = free_place(memory, existence.log_odds);

	if (place < 0)
		return place;
	if (memory->list[place].id)
		give_up(memory, &memory->list[place]);
	if (++memory->last_id == 0) /* 0 means none */
		memory->last_id = 1;
	memory->list[place] = (struct lp_remembered_lamp){.id = memory->last_id,
							  .lamp = s->on_grid,
							  .hidden = lp_lamp_hidden(&s->on_grid),
							  .wide = s->width_deg >= LP_COMPACT_DEG,
							  .existence = existence,
							  .image_probability = NAN,
							  .seen = true};
	return place;
}

static void age(struct lp_lamp_memory *memory, struct lp_remembered_lamp *m, float elapsed_s)
{
	lp_lamp_age(m, elapsed_s);
	lp_existence_update(&m->existence, &memory->clutter, m->seen, elapsed_s);
}

/* By its pixels. How strong a lamp is that clips they do not tell. */
static void see_from(struct lp_parallax *parallax, const struct lp_probe_pose *pose,
		     const struct lp_lamp *pixels, float strength_sigma)
{
	const bool clips = pixels->flags & LP_LIGHT_CLIPPED;
	struct lp_parallax_sighting sighting = {
		.sigma_rad = pixels->direction_sigma_deg * RAD,
		.strength_sigma = strength_sigma,
		.irradiance = clips ? 0.0F : pixels->irradiance[LP_LUMINANCE],
		.radius_rad = sqrtf(pixels->solid_angle_sr / (float)M_PI)};

	memcpy(sighting.direction, pixels->direction, sizeof(sighting.direction));
	lp_parallax_see(parallax, pose, &sighting);
}

void lp_lamp_memory_update(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *sightings,
			   int count, const struct lp_memory_times *times)
{
	int place[LP_MAX_LAMPS];

	for (int p = 0; p < LP_MAX_LAMPS; p++)
		memory->list[p].seen = false;
	associate(memory, sightings, count, place);
	lp_clutter_age(&memory->clutter, times->elapsed_s);
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].id)
			age(memory, &memory->list[p], times->elapsed_s);
	for (int k = 0; k < count; k++) {
		if (place[k] < 0 && enters(memory, &sightings[k]))
			place[k] = begin(memory, &sightings[k]);
		if (place[k] < 0)
			continue;
		struct lp_remembered_lamp *m = &memory->list[place[k]];

		if (sightings[k].came > CAME_SHARE)
			lp_existence_prove(&m->existence);
		lp_lamp_follow(m, &sightings[k], times);
		if (times->pose && sightings[k].refined)
			see_from(&m->parallax, times->pose, &sightings[k].pixels,
				 sightings[k].strength_sigma);
	}
	drop_pieces(memory);
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].id && lp_existence_is_over(&memory->list[p].existence))
			give_up(memory, &memory->list[p]);
}

float lp_lamp_memory_flicker(const struct lp_lamp_memory *memory)
{
	float deepest = 0.0F;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (m->id && m->seen && m->flicker.flickers)
			deepest = fmaxf(deepest, m->flicker.depth);
	}
	return deepest;
}

bool lp_lamp_memory_flicker_clips(const struct lp_lamp_memory *memory)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].id && memory->list[p].seen &&
		    lp_flicker_clips(&memory->list[p].flicker))
			return true;
	return false;
}

const struct lp_remembered_lamp *lp_lamp_memory_find(const struct lp_lamp_memory *memory,
						     const struct lp_lamp *on_grid)
{
	const float gate = lp_lamp_gate_rad(on_grid);

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (m->id && (on_grid->known_id ? m->id == on_grid->known_id
						: lp_lamp_apart_rad(m->on_grid.direction,
								    on_grid->direction) < gate))
			return m;
	}
	return NULL;
}

bool lp_lamp_may_be_hidden(const struct lp_remembered_lamp *lamp)
{
	return lamp->id && lamp->missed && (lamp->lamp.flags & LP_LIGHT_CLIPPED) &&
	       lamp->lamp.solid_angle_sr < BLOCK_SR;
}

void lp_lamp_memory_go(struct lp_lamp_memory *memory, const double way_m[3], double sigma_m)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		struct lp_remembered_lamp *m = &memory->list[p];
		float before[3];

		if (!m->id)
			continue;
		memcpy(before, m->lamp.direction, sizeof(before));
		float nearer;

		m->direction_variance +=
			lp_parallax_go(&m->parallax, way_m, sigma_m, m->lamp.direction, &nearer);
		for (int c = 0; c < 4; c++)
			m->lamp.irradiance[c] *= nearer * nearer;
		m->lamp.solid_angle_sr *= nearer * nearer;
		for (int a = 0; a < 3; a++) {
			const float moved = m->lamp.direction[a] - before[a];

			m->lamp.centroid[a] += moved;
			m->on_grid.direction[a] += moved;
			m->on_grid.centroid[a] += moved;
			m->whole[a] += moved;
		}
	}
}

bool lp_lamp_memory_doubts_places(const struct lp_lamp_memory *memory)
{
	double doubt = 0.0, most = 0.0;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (!m->id || !m->parallax.count)
			continue;
		doubt += lp_parallax_doubt(&m->parallax);
		most += LP_PARALLAX_MOST_DOUBT;
	}
	return doubt > most;
}

void lp_lamp_memory_lose_cells(struct lp_lamp_memory *memory)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		memory->list[p].seen = false;
}

static void turn_lamp(struct lp_lamp *lamp, const struct lp_rotation *turn)
{
	lp_rotate_direction(turn, lamp->direction);
	lp_rotate_direction(turn, lamp->centroid);
	lp_rotate_direction(turn, lamp->axis);
}

void lp_lamp_memory_turn(struct lp_lamp_memory *memory, const struct lp_rotation *turn)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		struct lp_remembered_lamp *m = &memory->list[p];
		const float turn_rad = lp_stokes_frame_turn(turn, m->lamp.direction);

		lp_stokes_turn(&m->stokes, turn_rad);
		lp_polarization_turn(&m->polarization, turn_rad);
		lp_rotate_direction(turn, m->aside);
		lp_rotate_direction(turn, m->whole);
		turn_lamp(&m->lamp, turn);
		turn_lamp(&m->on_grid, turn);
	}
}
