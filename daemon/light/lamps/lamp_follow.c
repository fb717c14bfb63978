/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/lamp_follow.h"

#include <math.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"

#define RAD ((float)M_PI / 180.0F)
/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* Random walks, per root second, of a lamp's direction (in the anchor frame) and strength. */
#define DIRECTION_WALK_RAD (0.02F * RAD)
#define STRENGTH_WALK 0.1F
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
 * change from exposure to exposure, what it is worth is a mean over HIDDEN_S, or over all the time
 * for which it has been known. */
#define CLIPPED_HIDES 2.0F
#define HIDDEN_S 1.0F
/* Of the strength of a small lamp while the camera turns: it falls on the pixels in another place
 * each time. On the panorama `interior` at 100 degrees a second. */
#define TURNING_NOISE 0.05F
/* Of the strength of a lamp seen through a film, until it is known how the lamp is polarized. */
#define FILM_STRENGTH_SIGMA 0.1F
/* Of what the panorama shows of a lamp, then and now: beyond this ratio it is another light. */
#define LEAST_RATIO 0.6F
/* A lower bound of at least this share of the largest comes from as short an exposure: the glow
 * moves the middle of what is clipped as much. */
#define LIKE_THE_LARGEST 0.7F
/* Exposures within this ratio are one setting. */
#define SHORTER 1.2F

/* Two sightings are one lamp when they are closer than this, or than its own radius and
 * uncertainty. */
#define GATE_RAD (4.0F * RAD)

static float square(float x)
{
	return x * x;
}

float lp_lamp_apart_rad(const float a[3], const float b[3])
{
	const float chord = sqrtf(square(a[0] - b[0]) + square(a[1] - b[1]) + square(a[2] - b[2]));

	return 2.0F * asinf(fminf(chord / 2.0F, 1.0F));
}

float lp_lamp_gate_rad(const struct lp_lamp *lamp)
{
	const float radius = sqrtf(lamp->solid_angle_sr / (float)M_PI);

	return fmaxf(GATE_RAD, fmaxf(3.0F * lamp->direction_sigma_deg * RAD, 0.7F * radius));
}

void lp_lamp_age(struct lp_remembered_lamp *m, float elapsed_s)
{
	m->direction_variance += (square(DIRECTION_WALK_RAD) + m->walk2) * elapsed_s;
	m->unplaced_s += elapsed_s;
	m->whole_sr *= expf(-elapsed_s / lp_existence_missed_s());
	m->known_s += elapsed_s;
	m->strength_variance += square(STRENGTH_WALK) * elapsed_s;
	m->missed = !m->seen && m->absent_s == 0.0F;
	m->absent_s = m->seen ? 0.0F : m->absent_s + elapsed_s;
}

/* A gain of 1 takes what was measured as it is: of a difference from a much stronger light nothing
 * would be left. */
static void blend(float *value, const float *measured, int count, float gain)
{
	for (int i = 0; i < count; i++)
		value[i] = gain < 1.0F ? value[i] + gain * (measured[i] - value[i]) : measured[i];
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

	return !(both > 0.0F) || difference2 > square(LP_LAMP_CHANGE_SIGMAS) * both
		       ? 1.0F
		       : known_variance / both;
}

/* A lamp that flickers is its mean, with the colour that it has now. */
static void take_mean(struct lp_remembered_lamp *m)
{
	const float now = m->lamp.irradiance[LP_LUMINANCE];
	const float share = now > 0.0F ? m->flicker.mean / now : 1.0F;

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

/* 1 sigma, relative, of what a film at an unknown angle, or none, passes of the lamp. */
static float unknown_angle_sigma(const struct lp_remembered_lamp *m,
				 const struct lp_film_pass *film)
{
	return hypotf(known_dolp(m), film->gain_sigma);
}

/* The sighting as it would be without a film: what the film's angle tells of the lamp's
 * polarization is learned first. *film_sigma: the part of its sigma that is the film's. */
static struct lp_lamp_sighting without_film(struct lp_remembered_lamp *m,
					    const struct lp_lamp_sighting *s, float elapsed_s,
					    float *film_sigma)
{
	struct lp_lamp_sighting result = *s;
	const float light = s->pixels.irradiance[LP_LUMINANCE];
	struct lp_stokes_reading reading = {.intensity = light,
					    .sigma = s->strength_sigma * light,
					    .misfit = s->film_misfit,
					    .rest_s = s->film_rest_s,
					    .axis = {s->film.axis[0], s->film.axis[1]}};
	float factor = 1.0F, sigma = FILM_STRENGTH_SIGMA;

	if (!s->film.polarizes) { /* or there is none */
		*film_sigma = unknown_angle_sigma(m, &s->film);
		result.strength_sigma = hypotf(s->strength_sigma, *film_sigma);
		return result;
	}
	(void)lp_stokes_correct(&m->stokes, &reading, elapsed_s);
	const struct lp_polarization p = lp_stokes_polarization(&m->stokes);

	if (p.known)
		lp_film_factor(&p, s->film.axis, &factor, &sigma);
	for (int c = 0; c < 4; c++)
		result.pixels.irradiance[c] /= factor;
	*film_sigma = sigma / factor;
	result.strength_sigma = hypotf(s->strength_sigma, *film_sigma);
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
	const float difference2 = square(lp_lamp_apart_rad(lamp->direction, seen->direction));
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

/* The film errs alike in all readings at one angle of it: their mean errs as much. */
static void follow_strength_sigma(struct lp_remembered_lamp *m, float gain, float variance,
				  float film_sigma)
{
	m->film_sigma += gain * (film_sigma - m->film_sigma);
	m->strength_variance = fmaxf(gain * variance, square(m->film_sigma));
}

static void measure(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
		    const struct lp_memory_times *times, float film_sigma)
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
	follow_strength_sigma(m, strength_gain, strength_variance, film_sigma);
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
	const float most = m->lamp.irradiance[LP_LUMINANCE] *
			   (1.0F + LP_LAMP_CHANGE_SIGMAS * sigma) * swing(m);
	const bool bound = s->refined && (seen->flags & LP_LIGHT_CLIPPED);

	if (!(m->then_on_grid > 0.0F) || has_changed(m, s))
		return false;
	if (!m->measured && s->refined) /* a bound, or what the panorama showed */
		return bound && least < m->lamp.irradiance[LP_LUMINANCE];
	const bool is_bound = m->lamp.flags & LP_LIGHT_CLIPPED;

	if (!m->measured && is_bound && least > m->lamp.irradiance[LP_LUMINANCE])
		return false; /* the panorama knows of more */
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

float lp_lamp_hidden(const struct lp_lamp *lamp)
{
	return lamp->flags & LP_LIGHT_CLIPPED ? CLIPPED_HIDES : 0.0F;
}

static void follow_hidden(struct lp_remembered_lamp *m, float elapsed_s)
{
	const float over_s = fminf(HIDDEN_S, m->known_s);
	const float share = elapsed_s < over_s ? elapsed_s / over_s : 1.0F;
	/* what the ring found in the frame before is known, not hidden */
	const float hidden = m->recovered_sigma > 0.0F ? 0.0F : lp_lamp_hidden(&m->lamp);

	m->hidden += share * (hidden - m->hidden);
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

void lp_lamp_follow(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
		    const struct lp_memory_times *times)
{
	const bool is_bound = s->pixels.flags & LP_LIGHT_CLIPPED;

	m->on_grid = s->on_grid;
	if (s->on_grid.solid_angle_sr >= m->whole_sr) {
		m->whole_sr = s->on_grid.solid_angle_sr;
		memcpy(m->whole, s->on_grid.direction, sizeof(m->whole));
	}
	m->clipped_scale = clipped_scale(m, s);
	float film_sigma = 0.0F;
	const struct lp_lamp_sighting bare =
		is_bound || !s->refined ? *s : without_film(m, s, times->elapsed_s, &film_sigma);

	if (s->refined && s->pixels.irradiance[LP_LUMINANCE] > 0.0F)
		lp_flicker_add(&m->flicker,
			       &(struct lp_lamp_strength){bare.pixels.irradiance[LP_LUMINANCE],
							  flicker_noise(&bare, times), s->scale,
							  is_bound});
	if (s->refined && !is_bound)
		measure(m, &bare, times, film_sigma);
	else
		keep_or_take(m, s, times);
	if (s->refined && m->flicker.flickers)
		take_mean(m);
	follow_hidden(m, times->elapsed_s);
	m->lamp.direction_sigma_deg =
		sqrtf(m->direction_variance + square(m->lag) + square(off_centre(m))) / RAD;
}
