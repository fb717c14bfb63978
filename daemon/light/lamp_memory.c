/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamp_memory.h"

#include <math.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "light/rotation.h"

#define RAD ((float)M_PI / 180.0F)
/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* Two sightings are one lamp when they are closer than this, or than its own radius and
 * uncertainty. */
#define GATE_RAD (4.0F * RAD)
/* An id is kept this long for a lamp that is not seen (flicker, someone walking past). */
#define ABSENT_S 2.0F
/* Random walks, per root second, of a lamp's direction (in the anchor frame) and strength. */
#define DIRECTION_WALK_RAD (0.02F * RAD)
#define STRENGTH_WALK 0.1F
/* What the glow around a clipped lamp does to the middle of what is clipped: 1 sigma. */
#define GLOW_RAD (0.1F * RAD)
/* Sigmas beyond which a measurement is a change, which is taken as it is. */
#define CHANGE_SIGMAS 5.0F
/* A lamp that is found on the same side in frame after frame moves: a turn that the frames do not
 * show, as of a lamp near the axis in a room without texture. The mean over the last frames gets
 * this share of the newest; so many of its sigmas aside are a change. Noise reaches that once in a
 * minute or so. */
#define ASIDE_SHARE 0.25F
#define ASIDE_SIGMAS 3.5F
/* Less aside than this is noise in seven frames of eight. */
#define NOISE_SIGMAS 2.0F
/* Relative 1 sigma up to which what was measured counts more than what the panorama shows. */
#define MOST_STRENGTH_SIGMA 0.3F
/* 1 sigma of where a clipped lamp's light is, of its plateau's radius; measured on lamps of the
 * furnished room that clip in every exposure (tests/accuracy/live.py --troubles=ignored). */
#define PLATEAU_SHARE 0.2F
/* A clipped lamp may well be so many times stronger than what is seen of it; whether it clips may
 * change from exposure to exposure, what it is worth changes within HIDDEN_S. */
#define CLIPPED_HIDES 2.0F
#define HIDDEN_S 1.0F
/* A lamp becomes an area light, or an area light a lamp, beyond LP_COMPACT_DEG by this factor. */
#define STAYS_WIDE 1.4F
/* Of the strength of a small lamp while the camera turns: it falls on the pixels in another place
 * each time. On the panorama `interior` at 100 degrees a second. */
#define TURNING_NOISE 0.05F
/* Of the strength of a lamp seen through a film, until it is known how the lamp is polarized; and
 * the smallest share that a film passes by which a strength is told. */
#define FILM_STRENGTH_SIGMA 0.1F
#define LEAST_FILM_FACTOR 0.1F
/* Of what the panorama shows of a lamp, then and now: beyond this ratio it is another light. */
#define LEAST_RATIO 0.6F
/* A block of the picture of 1920 pixels: 1.5 degrees along and across. */
#define BLOCK_SR (1.5F * RAD * 1.5F * RAD)
/* A lower bound of at least this share of the largest comes from as short an exposure: the glow
 * moves the middle of what is clipped as much. */
#define LIKE_THE_LARGEST 0.7F
/* Exposures within this ratio are one setting. */
#define SHORTER 1.2F
/* A lamp within another is one only if it is so many times as bright, as a peak is that stands out
 * (light/detection.c). */
#define OUTSHINES 1.6F

static float square(float x)
{
	return x * x;
}

/* The chord: exact for small angles. */
static float angle_rad(const float a[3], const float b[3])
{
	const float chord = sqrtf(square(a[0] - b[0]) + square(a[1] - b[1]) + square(a[2] - b[2]));

	return 2.0F * asinf(fminf(chord / 2.0F, 1.0F));
}

static float gate_rad(const struct lp_lamp *lamp)
{
	const float radius = sqrtf(lamp->solid_angle_sr / (float)M_PI);

	return fmaxf(GATE_RAD, fmaxf(3.0F * lamp->direction_sigma_deg * RAD, 0.7F * radius));
}

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
					angle_rad(m->on_grid.direction, lamp->direction);
				if (apart < best && apart < gate_rad(lamp)) {
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

/* A free place; else that of the faintest lamp that is not seen; -1: all are seen. */
static int free_place(const struct lp_lamp_memory *memory)
{
	int faintest = -1;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (!m->id)
			return p;
		if (!m->seen &&
		    (faintest < 0 || m->lamp.irradiance[LP_LUMINANCE] <
					     memory->list[faintest].lamp.irradiance[LP_LUMINANCE]))
			faintest = p;
	}
	return faintest;
}

static void age(struct lp_remembered_lamp *m, float elapsed_s)
{
	m->direction_variance += (square(DIRECTION_WALK_RAD) + m->walk2) * elapsed_s;
	m->unplaced_s += elapsed_s;
	m->strength_variance += square(STRENGTH_WALK) * elapsed_s;
	m->missed = !m->seen && m->absent_s == 0.0F;
	m->absent_s = m->seen ? 0.0F : m->absent_s + elapsed_s;
}

static void blend(float *value, const float *measured, int count, float gain)
{
	for (int i = 0; i < count; i++)
		value[i] += gain * (measured[i] - value[i]);
}

static void normalise(float v[3])
{
	const float length = sqrtf(square(v[0]) + square(v[1]) + square(v[2]));

	for (int a = 0; length > 0.0F && a < 3; a++)
		v[a] /= length;
}

/* Gain of a measurement, 1 where it contradicts what was known. */
static float gain_of(float known_variance, float variance, float difference2)
{
	const float both = known_variance + variance;

	return !(both > 0.0F) || difference2 > square(CHANGE_SIGMAS) * both ? 1.0F
									    : known_variance / both;
}

/* A lamp that flickers is its mean, with the colour that it has now. */
static void take_mean(struct lp_remembered_lamp *m)
{
	const float share = m->flicker.mean / m->lamp.irradiance[LP_LUMINANCE];

	for (int c = 0; c < 4; c++)
		m->lamp.irradiance[c] *= share;
	m->strength_variance = square(m->flicker.sigma);
	m->measured = m->by_pixels = true;
	m->lamp.flags &= ~(uint32_t)LP_LIGHT_CLIPPED;
	m->lamp.flags |= lp_flicker_clips(&m->flicker) ? LP_LIGHT_CLIPPED : 0;
}

/* What a film at any angle may change of the lamp's strength; 0 without a film. */
static float known_dolp(const struct lp_remembered_lamp *m)
{
	const struct lp_polarization p = lp_stokes_polarization(&m->stokes);

	return p.known ? p.dolp : 0.0F;
}

/* The sighting as it would be without a film: what the film's angle tells of the lamp's
 * polarization is learned first. */
static struct lp_lamp_sighting without_film(struct lp_remembered_lamp *m,
					    const struct lp_lamp_sighting *s, float elapsed_s)
{
	struct lp_lamp_sighting result = *s;
	const float light = s->pixels.irradiance[LP_LUMINANCE];
	struct lp_stokes_reading reading = {.intensity = light,
					    .sigma = s->strength_sigma * light,
					    .misfit = s->film_misfit,
					    .rest_s = s->film_rest_s,
					    .axis = {s->film_axis[0], s->film_axis[1]}};
	float factor = 1.0F, sigma = FILM_STRENGTH_SIGMA;

	if (!s->through_film) { /* or at an angle that is not known */
		result.strength_sigma = hypotf(s->strength_sigma, known_dolp(m));
		return result;
	}
	(void)lp_stokes_correct(&m->stokes, &reading, elapsed_s);
	const struct lp_polarization p = lp_stokes_polarization(&m->stokes);

	if (p.known)
		lp_film_factor(&p, s->film_axis, &factor, &sigma);
	factor = fmaxf(factor, LEAST_FILM_FACTOR);
	for (int c = 0; c < 4; c++)
		result.pixels.irradiance[c] /= factor;
	result.strength_sigma = hypotf(s->strength_sigma, sigma / factor);
	return result;
}

/* Adds what was measured to the mean of differences; whether that is a change. */
static bool moves_aside(struct lp_remembered_lamp *m, const float seen[3], float variance)
{
	const float mean_variance = variance * ASIDE_SHARE / (2.0F - ASIDE_SHARE);
	float aside2 = 0.0F;

	for (int a = 0; a < 3; a++) {
		m->aside[a] += ASIDE_SHARE * (seen[a] - m->lamp.direction[a] - m->aside[a]);
		aside2 += square(m->aside[a]);
	}
	m->walk2 *= 1.0F - ASIDE_SHARE;
	m->lag = fmaxf(sqrtf(aside2) - NOISE_SIGMAS * sqrtf(mean_variance), 0.0F);
	if (aside2 <= square(ASIDE_SIGMAS) * mean_variance)
		return false;
	memset(m->aside, 0, sizeof(m->aside));
	m->lag = 0.0F;
	return true;
}

/* `known`: the lamp's direction is, by pixels like these. */
static void measure_direction(struct lp_remembered_lamp *m, const struct lp_lamp *seen,
			      const struct lp_memory_times *times, bool known)
{
	struct lp_lamp *lamp = &m->lamp;
	const float variance =
		square(seen->direction_sigma_deg * RAD) + square(times->rotation_sigma_rad);
	const float difference2 = square(angle_rad(lamp->direction, seen->direction));
	const bool moves =
		moves_aside(m, seen->direction, m->direction_variance + variance) || !known;
	const float gain = moves ? 1.0F : gain_of(m->direction_variance, variance, difference2);

	if (moves && known && m->unplaced_s > 0.0F)
		m->walk2 = difference2 / m->unplaced_s;
	m->unplaced_s = 0.0F;

	blend(lamp->direction, seen->direction, 3, gain);
	blend(lamp->centroid, seen->centroid, 3, gain);
	normalise(lamp->direction);
	normalise(lamp->centroid);
	m->direction_variance = gain * variance;
}

static void measure(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
		    const struct lp_memory_times *times)
{
	const struct lp_lamp *seen = &s->pixels;
	struct lp_lamp *lamp = &m->lamp;
	const float strength_variance = square(s->strength_sigma);
	const float held = lamp->irradiance[LP_LUMINANCE];
	float strength_gain = 1.0F;

	if (m->measured)
		strength_gain = gain_of(m->strength_variance, strength_variance,
					square(seen->irradiance[LP_LUMINANCE] / held - 1.0F));
	const struct lp_lamp before = *lamp;

	*lamp = *seen;
	memcpy(lamp->direction, before.direction, sizeof(lamp->direction));
	memcpy(lamp->centroid, before.centroid, sizeof(lamp->centroid));
	memcpy(lamp->irradiance, before.irradiance, sizeof(lamp->irradiance));
	lamp->solid_angle_sr = before.solid_angle_sr;
	measure_direction(m, seen, times, m->measured);
	blend(lamp->irradiance, seen->irradiance, 4, strength_gain);
	blend(&lamp->solid_angle_sr, &seen->solid_angle_sr, 1, strength_gain);
	m->strength_variance = strength_gain * strength_variance;
	m->measured = m->by_pixels = true;
	m->then_on_grid = s->on_grid.irradiance[LP_LUMINANCE];
}

/* How much brighter than its mean a lamp is at times: by twice its depth, a sine's 1.4 and more. */
static float swing(const struct lp_remembered_lamp *m)
{
	return m->flicker.flickers ? 1.0F + 2.0F * m->flicker.depth : 1.0F;
}

/* The panorama shows so much more or less of the lamp than it did that it must have changed. */
static bool has_changed(const struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s)
{
	const float now = s->on_grid.irradiance[LP_LUMINANCE], then = m->then_on_grid;
	const float least = LEAST_RATIO / swing(m);

	return now < least * then || then < least * now;
}

/* What a frame that clips the lamp, or none at all, leaves of what was known: what was measured, as
 * long as only lower bounds that agree with it come, or it is not too old; else the largest lower
 * bound. */
static bool stays(const struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s)
{
	const struct lp_lamp *seen = s->refined ? &s->pixels : &s->on_grid;
	const float sigma = m->measured ? sqrtf(m->strength_variance) : 0.0F;
	const float least = seen->irradiance[LP_LUMINANCE];
	const float most =
		m->lamp.irradiance[LP_LUMINANCE] * (1.0F + CHANGE_SIGMAS * sigma) * swing(m);
	const bool bound = s->refined && (seen->flags & LP_LIGHT_CLIPPED);

	if (!(m->then_on_grid > 0.0F) || has_changed(m, s))
		return false;
	if (!m->measured && s->refined) /* a bound, or what the panorama showed */
		return bound && least < m->lamp.irradiance[LP_LUMINANCE];
	if (!m->measured)
		return m->by_pixels && sqrtf(m->strength_variance) < MOST_STRENGTH_SIGMA;
	return bound ? least <= most : sigma < MOST_STRENGTH_SIGMA;
}

/* Where a lamp is that clips in every exposure is told by the shortest. While nothing moves its rim
 * errs alike in each, so that many say no more than one. */
static void follow_plateau(struct lp_remembered_lamp *m, const struct lp_lamp *seen,
			   const struct lp_memory_times *times)
{
	measure_direction(m, seen, times, true);
	m->direction_variance =
		fmaxf(m->direction_variance, square(seen->direction_sigma_deg * RAD));
}

static void keep_or_take(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
			 const struct lp_memory_times *times)
{
	const struct lp_lamp *seen = s->refined ? &s->pixels : &s->on_grid;

	if (stays(m, s)) {
		if (s->refined && !m->measured &&
		    seen->irradiance[LP_LUMINANCE] >
			    LIKE_THE_LARGEST * m->lamp.irradiance[LP_LUMINANCE]) {
			follow_plateau(m, seen, times);
			m->strength_variance = square(s->strength_sigma); /* said once more */
		}
		m->lamp.first = s->on_grid.first;
		m->lamp.count = s->on_grid.count;
		return;
	}
	m->measured = false;
	m->by_pixels = s->refined;
	m->lamp = *seen;
	if (m->clipped_scale > 0.0F) /* a few clipped pixels do not show in a panorama */
		m->lamp.flags |= LP_LIGHT_CLIPPED;
	m->direction_variance = square(seen->direction_sigma_deg * RAD);
	m->strength_variance = square(s->strength_sigma);
	m->then_on_grid = s->on_grid.irradiance[LP_LUMINANCE];
}

static float hidden(const struct lp_lamp *lamp)
{
	return lamp->flags & LP_LIGHT_CLIPPED ? CLIPPED_HIDES : 0.0F;
}

/* The shortest exposure whose pixels clip the lamp, until a shorter one shows it or tells nothing.
 */
static float clipped_scale(const struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s)
{
	if (s->refined)
		return s->pixels.flags & LP_LIGHT_CLIPPED ? fmaxf(m->clipped_scale, s->scale)
							  : 0.0F;
	return s->scale > SHORTER * m->clipped_scale ? 0.0F : m->clipped_scale;
}

/* Where in the plateau of a lamp that clips in every exposure its light is, nobody knows. 1 sigma,
 * radians. */
static float off_centre(const struct lp_remembered_lamp *m)
{
	const bool is_plateau = !m->measured && (m->lamp.flags & LP_LIGHT_CLIPPED);

	return is_plateau ? PLATEAU_SHARE * sqrtf(m->lamp.solid_angle_sr / (float)M_PI) : 0.0F;
}

/* 1 sigma, relative, of what frame after frame may find of a lamp that does not flicker. */
static float flicker_noise(const struct lp_lamp_sighting *s, const struct lp_memory_times *times)
{
	return hypotf(s->strength_sigma, times->rotation_sigma_rad > 0.0F ? TURNING_NOISE : 0.0F);
}

static void follow(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
		   const struct lp_memory_times *times)
{
	const bool is_bound = s->pixels.flags & LP_LIGHT_CLIPPED;

	m->on_grid = s->on_grid;
	m->clipped_scale = clipped_scale(m, s);
	const struct lp_lamp_sighting bare =
		is_bound || !s->refined ? *s : without_film(m, s, times->elapsed_s);

	if (s->refined && s->pixels.irradiance[LP_LUMINANCE] > 0.0F)
		lp_flicker_add(&m->flicker,
			       &(struct lp_lamp_strength){bare.pixels.irradiance[LP_LUMINANCE],
							  flicker_noise(&bare, times), s->scale,
							  is_bound});
	if (s->refined && !is_bound)
		measure(m, &bare, times);
	else
		keep_or_take(m, s, times);
	if (s->refined && m->flicker.flickers)
		take_mean(m);
	m->hidden += (hidden(&m->lamp) - m->hidden) * fminf(times->elapsed_s / HIDDEN_S, 1.0F);
	m->lamp.direction_sigma_deg =
		sqrtf(m->direction_variance + square(m->lag) + square(off_centre(m))) / RAD;
}

/* Mean luminance, of its disc. */
static float tone(const struct lp_lamp *lamp)
{
	return lamp->irradiance[LP_LUMINANCE] / fmaxf(lamp->solid_angle_sr, 1e-12F);
}

/* Radius of a disc that lies within it: of one that is longer than wide, half of its width. */
static float inner_radius_rad(const struct lp_lamp *lamp)
{
	const float radius = sqrtf(lamp->solid_angle_sr / (float)M_PI);
	const float half_width = lamp->half_angle_deg[1] * RAD;

	return half_width > 0.0F ? fminf(radius, half_width) : radius;
}

/* Whether a lamp is only a piece of another: it lies within the other and is no brighter. What a
 * misplaced frame left beside a lamp would be held as if it were one. */
static bool is_piece(const struct lp_lamp *lamp, const struct lp_remembered_lamp *of)
{
	return of->id && of->seen && lamp->solid_angle_sr <= of->lamp.solid_angle_sr &&
	       tone(lamp) < OUTSHINES * tone(&of->lamp) &&
	       angle_rad(lamp->direction, of->lamp.direction) < inner_radius_rad(&of->lamp);
}

static bool is_piece_of_any(const struct lp_lamp_memory *memory, const struct lp_lamp *lamp)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (&memory->list[p].lamp != lamp && is_piece(lamp, &memory->list[p]))
			return true;
	return false;
}

/* Of two pieces of the same size the newer one goes. */
static void drop_pieces(struct lp_lamp_memory *memory)
{
	for (int p = LP_MAX_LAMPS - 1; p >= 0; p--) {
		struct lp_remembered_lamp *m = &memory->list[p];

		if (m->id && m->seen && is_piece_of_any(memory, &m->lamp))
			m->id = 0;
	}
}

static bool enters(const struct lp_lamp_memory *memory, const struct lp_lamp_sighting *s)
{
	return s->enters && !is_piece_of_any(memory, s->refined ? &s->pixels : &s->on_grid);
}

void lp_lamp_memory_update(struct lp_lamp_memory *memory, const struct lp_lamp_sighting *sightings,
			   int count, const struct lp_memory_times *times)
{
	int place[LP_MAX_LAMPS];

	for (int p = 0; p < LP_MAX_LAMPS; p++)
		memory->list[p].seen = false;
	associate(memory, sightings, count, place);
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].id)
			age(&memory->list[p], times->elapsed_s);
	for (int k = 0; k < count; k++) {
		if (place[k] < 0 && enters(memory, &sightings[k])) {
			place[k] = free_place(memory);
			if (place[k] < 0)
				continue;
			if (++memory->last_id == 0) /* 0 means none */
				memory->last_id = 1;
			memory->list[place[k]] =
				(struct lp_remembered_lamp){.id = memory->last_id,
							    .lamp = sightings[k].on_grid,
							    .hidden = hidden(&sightings[k].on_grid),
							    .wide = sightings[k].width_deg >=
								    LP_COMPACT_DEG,
							    .image_probability = NAN,
							    .seen = true};
		}
		if (place[k] >= 0)
			follow(&memory->list[place[k]], &sightings[k], times);
	}
	drop_pieces(memory);
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		if (memory->list[p].absent_s > ABSENT_S)
			memory->list[p].id = 0;
}

/* The measured lamp nearest to a sighting; NULL: none within its gate. */
static const struct lp_remembered_lamp *nearest_measured(const struct lp_lamp_memory *memory,
							 const struct lp_lamp *lamp)
{
	const struct lp_remembered_lamp *found = NULL;
	float best = gate_rad(lamp);

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];
		const float apart = angle_rad(m->lamp.direction, lamp->direction);

		if (m->id && m->by_pixels && apart < best) {
			best = apart;
			found = m;
		}
	}
	return found;
}

int lp_lamp_memory_landmarks(const struct lp_lamp_memory *memory,
			     const struct lp_lamp_sighting *sightings, int count, float sigma_rad,
			     double pull[3], double information[3][3])
{
	int used = 0;

	memset(pull, 0, 3 * sizeof(*pull));
	memset(information, 0, 3 * sizeof(*information));
	for (int k = 0; k < count; k++) {
		const struct lp_lamp *seen = &sightings[k].pixels;
		const struct lp_remembered_lamp *m =
			sightings[k].refined ? nearest_measured(memory, seen) : NULL;
		const float glow = seen->flags & LP_LIGHT_CLIPPED ? GLOW_RAD : 0.0F;

		if (!m)
			continue;
		const float *d = seen->direction, *r = m->lamp.direction;
		const double variance = square(seen->direction_sigma_deg * RAD) + square(glow) +
					m->direction_variance;
		const float apart = angle_rad(d, r);

		if (square(apart) > square(CHANGE_SIGMAS) * (variance + square(sigma_rad)))
			continue;
		used++;
		for (int a = 0; a < 3; a++) {
			const int b = (a + 1) % 3, c = (a + 2) % 3;

			pull[a] += ((double)d[b] * r[c] - (double)d[c] * r[b]) / variance;
			for (int e = 0; e < 3; e++)
				information[a][e] += ((a == e) - (double)d[a] * d[e]) / variance;
		}
	}
	return used;
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
	const float gate = gate_rad(on_grid);

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];

		if (m->id && (on_grid->known_id
				      ? m->id == on_grid->known_id
				      : angle_rad(m->on_grid.direction, on_grid->direction) < gate))
			return m;
	}
	return NULL;
}

bool lp_lamp_may_be_hidden(const struct lp_remembered_lamp *lamp)
{
	return lamp->id && lamp->missed && (lamp->lamp.flags & LP_LIGHT_CLIPPED) &&
	       lamp->lamp.solid_angle_sr < BLOCK_SR;
}

void lp_lamp_memory_lose_cells(struct lp_lamp_memory *memory)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++)
		memory->list[p].seen = false;
}

void lp_lamp_memory_turn(struct lp_lamp_memory *memory, const struct lp_rotation *turn)
{
	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		struct lp_remembered_lamp *m = &memory->list[p];

		lp_stokes_turn(&m->stokes, lp_stokes_frame_turn(turn, m->lamp.direction));
		lp_rotate_direction(turn, m->lamp.direction);
		lp_rotate_direction(turn, m->lamp.centroid);
		lp_rotate_direction(turn, m->aside);
		lp_rotate_direction(turn, m->on_grid.direction);
		lp_rotate_direction(turn, m->on_grid.centroid);
		lp_rotate_direction(turn, m->lamp.axis);
		lp_rotate_direction(turn, m->on_grid.axis);
	}
}
