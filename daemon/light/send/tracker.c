/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/tracker.h"

#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "light/place/parallax.h"
#include "light/send/model.h"

/* Chosen by hand; docs/maintainers/constants.md says which tests notice other values. */

/* Below this share of its full strength a lamp that fades is gone. */
#define LEAST_SHARE 0.02F

static float luminance(const struct lp_light *light)
{
	return lp_luminance(light->irradiance);
}

/* The track of each lamp that has one. */
static void associate(struct lp_tracker *tracker, const struct lp_light_estimate *raw,
		      struct lp_track *of_light[LP_MAX_LIGHTS])
{
	for (int k = 0; k < raw->light_count; k++)
		for (int t = 0; t < LP_MAX_TRACKS; t++)
			if (tracker->track[t].light.id == raw->lights[k].id) {
				of_light[k] = &tracker->track[t];
				of_light[k]->seen = true;
			}
}

/* A free track; else the faintest that is not seen. */
static struct lp_track *new_track(struct lp_tracker *tracker)
{
	struct lp_track *faintest = NULL;

	for (int t = 0; t < LP_MAX_TRACKS; t++) {
		struct lp_track *track = &tracker->track[t];

		if (!track->light.id)
			return track;
		if (!track->seen &&
		    (!faintest || luminance(&track->light) < luminance(&faintest->light)))
			faintest = track;
	}
	return faintest; /* never NULL: half of the tracks cannot be seen at once */
}

static void start_track(const struct lp_tracker *tracker, struct lp_track *track,
			const struct lp_light *light)
{
	*track = (struct lp_track){.light = *light, .seen = true};
	if (tracker->started)
		memset(track->light.irradiance, 0, sizeof(track->light.irradiance));
}

static float follow(float from, float to, float alpha)
{
	/* unknown stays unknown, and a first value is taken as it is */
	return isnan(from) || isnan(to) ? to : to + (1.0F - alpha) * (from - to);
}

static void follow_sh(float sh[LP_MAX_SH_COUNT][3], const float target[LP_MAX_SH_COUNT][3],
		      float alpha)
{
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			sh[i][c] = follow(sh[i][c], target[i][c], alpha);
}

/* An axis and its opposite are the same. */
static void follow_axis(float axis[3], const float target[3], float alpha)
{
	const float same = axis[0] * target[0] + axis[1] * target[1] + axis[2] * target[2] < 0.0F
				   ? -1.0F
				   : 1.0F;
	float length = 0.0F;

	for (int a = 0; a < 3; a++) {
		axis[a] = follow(axis[a], same * target[a], alpha);
		length += axis[a] * axis[a];
	}
	for (int a = 0; length > 0.0F && a < 3; a++)
		axis[a] /= sqrtf(length);
}

static float chord_deg(const float a[3], const float b[3])
{
	const float chord = hypotf(hypotf(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);

	return chord * 180.0F / (float)M_PI;
}

static void follow_direction(float direction[3], const float target[3], float alpha)
{
	float length = 0.0F;

	for (int a = 0; a < 3; a++) {
		direction[a] = follow(direction[a], target[a], alpha);
		length += direction[a] * direction[a];
	}
	length = sqrtf(length);
	for (int a = 0; a < 3; a++)
		direction[a] = length > 0.0F ? direction[a] / length : target[a];
}

/* The lamp is what the newest estimate says of it, but for what is smoothed. */
static void follow_light(struct lp_track *track, const struct lp_light *target, float alpha)
{
	const struct lp_light before = track->light;
	struct lp_light *l = &track->light;

	*l = *target;
	memcpy(l->direction, before.direction, sizeof(l->direction));
	follow_direction(l->direction, target->direction, alpha);
	memcpy(l->axis, before.axis, sizeof(l->axis));
	follow_axis(l->axis, target->axis, alpha);
	for (int c = 0; c < 3; c++)
		l->irradiance[c] = follow(before.irradiance[c], target->irradiance[c], alpha);
	for (int a = 0; a < 2; a++)
		l->half_angle_deg[a] =
			follow(before.half_angle_deg[a], target->half_angle_deg[a], alpha);
	l->angular_radius_deg =
		follow(before.angular_radius_deg, target->angular_radius_deg, alpha);
	l->distance_m = follow(before.distance_m, target->distance_m, alpha);
	/* What is smoothed lags behind, and says by how much. */
	l->direction_sigma_deg =
		hypotf(target->direction_sigma_deg, chord_deg(l->direction, target->direction));
	l->distance_sigma =
		hypotf(target->distance_sigma, l->distance_m / target->distance_m - 1.0F);
	l->irradiance_sigma =
		hypotf(target->irradiance_sigma, luminance(target) / luminance(l) - 1.0F);
}

static void fade(struct lp_track *track, float alpha)
{
	for (int c = 0; c < 3; c++)
		track->light.irradiance[c] *= 1.0F - alpha;
	track->light.flags |= LP_LIGHT_HELD;
	if (!(luminance(&track->light) > LEAST_SHARE * track->full))
		track->light.id = 0;
}

static bool is_wide(const struct lp_light *light)
{
	return light->flags & LP_LIGHT_EXTENDED;
}

/* Lamps, then area lights, each strongest first. */
static bool precedes(const struct lp_light *a, const struct lp_light *b)
{
	return is_wide(a) != is_wide(b) ? is_wide(b) : lp_light_rank(a) > lp_light_rank(b);
}

/* By their full strength: one that fades keeps its place until it is gone. */
static bool stays_before(const struct lp_track *a, const struct lp_track *b)
{
	return is_wide(&a->light) != is_wide(&b->light)
		       ? is_wide(&b->light)
		       : a->full * (1.0F + a->light.hidden) > b->full * (1.0F + b->light.hidden);
}

/* Tracks that still shine, as many as an estimate holds; returns how many. */
static int choose_tracks(const struct lp_tracker *tracker,
			 const struct lp_track *chosen[LP_MAX_LIGHTS])
{
	int count = 0;

	for (int t = 0; t < LP_MAX_TRACKS; t++) {
		const struct lp_track *track = &tracker->track[t];
		int at;

		if (!track->light.id || luminance(&track->light) <= 0.0F)
			continue;
		for (at = count; at > 0 && stays_before(track, chosen[at - 1]); at--)
			if (at < LP_MAX_LIGHTS)
				chosen[at] = chosen[at - 1];
		if (at < LP_MAX_LIGHTS)
			chosen[at] = track;
		if (count < LP_MAX_LIGHTS)
			count++;
	}
	return count;
}

static void list_tracks(const struct lp_tracker *tracker, struct lp_light_estimate *smoothed)
{
	const struct lp_track *chosen[LP_MAX_LIGHTS];

	smoothed->light_count = choose_tracks(tracker, chosen);
	smoothed->area_count = 0;
	for (int k = 0; k < smoothed->light_count; k++) {
		const struct lp_light *light = &chosen[k]->light;
		int at = k;

		for (; at > 0 && precedes(light, &smoothed->lights[at - 1]); at--)
			smoothed->lights[at] = smoothed->lights[at - 1];
		smoothed->lights[at] = *light;
		smoothed->area_count += is_wide(light);
	}
}

void lp_tracker_update(struct lp_tracker *tracker, const struct lp_light_estimate *raw,
		       struct lp_light_estimate *smoothed)
{
	const int64_t now_ns = raw->t_capture_ns;
	const double elapsed_ms = fmax((double)(now_ns - tracker->t_last_ns) / 1e6, 0.0);
	const float alpha = tracker->started && tracker->time_constant_ms > 0.0F
				    ? (float)-expm1(-elapsed_ms / tracker->time_constant_ms)
				    : 1.0F;
	struct lp_track *of_light[LP_MAX_LIGHTS] = {NULL};

	for (int t = 0; t < LP_MAX_TRACKS; t++)
		tracker->track[t].seen = false;
	associate(tracker, raw, of_light);
	for (int k = 0; k < raw->light_count; k++) {
		if (!of_light[k]) {
			of_light[k] = new_track(tracker);
			start_track(tracker, of_light[k], &raw->lights[k]);
		}
		of_light[k]->full = luminance(&raw->lights[k]);
	}
	for (int k = 0; k < raw->light_count; k++)
		follow_light(of_light[k], &raw->lights[k], alpha);
	for (int t = 0; t < LP_MAX_TRACKS; t++)
		if (tracker->track[t].light.id && !tracker->track[t].seen)
			fade(&tracker->track[t], alpha);
	follow_sh(tracker->sh_total, raw->sh_total, alpha);
	tracker->started = true;
	tracker->t_last_ns = now_ns;

	*smoothed = *raw;
	memcpy(smoothed->sh_total, tracker->sh_total, sizeof(smoothed->sh_total));
	list_tracks(tracker, smoothed);
}

static const struct lp_light *light_of(const struct lp_light_estimate *estimate, uint32_t id)
{
	for (int k = 0; k < estimate->light_count; k++)
		if (estimate->lights[k].id == id)
			return &estimate->lights[k];
	return NULL;
}

static void jump_track(struct lp_track *track, const struct lp_light *before,
		       const struct lp_light *after)
{
	for (int c = 0; c < 3; c++)
		track->light.irradiance[c] =
			fmaxf(track->light.irradiance[c] + (after ? after->irradiance[c] : 0.0F) -
				      (before ? before->irradiance[c] : 0.0F),
			      0.0F);
}

void lp_tracker_jump(struct lp_tracker *tracker, const struct lp_light_estimate *before,
		     const struct lp_light_estimate *after)
{
	struct lp_track *of_light[LP_MAX_LIGHTS] = {NULL};

	for (int t = 0; t < LP_MAX_TRACKS; t++)
		tracker->track[t].seen = false;
	associate(tracker, after, of_light);
	for (int k = 0; k < after->light_count; k++)
		if (!of_light[k]) {
			struct lp_track *const track = new_track(tracker);

			start_track(tracker, track, &after->lights[k]);
			track->full = luminance(&after->lights[k]);
		}
	for (int t = 0; t < LP_MAX_TRACKS; t++) {
		struct lp_track *const track = &tracker->track[t];

		if (track->light.id)
			jump_track(track, light_of(before, track->light.id),
				   light_of(after, track->light.id));
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			tracker->sh_total[i][c] += after->sh_total[i][c] - before->sh_total[i][c];
}

/* Adds the lights whose distance is known to the whole, or with -1 takes them out of it. */
static void add_near_lights(struct lp_tracker *tracker, double sign)
{
	double sh[LP_MAX_SH_COUNT][3] = {{0.0}};

	for (int t = 0; t < LP_MAX_TRACKS; t++) {
		const struct lp_light *light = &tracker->track[t].light;

		if (light->id && light->distance_m > 0.0F)
			lp_sh_add_lamp(LP_MAX_SH_ORDER, light->direction, light->irradiance, 0.0,
				       sign, sh);
	}
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			tracker->sh_total[i][c] += (float)sh[i][c];
}

void lp_tracker_go(struct lp_tracker *tracker, const double way_m[3])
{
	add_near_lights(tracker, -1.0);
	for (int t = 0; t < LP_MAX_TRACKS; t++) {
		struct lp_light *light = &tracker->track[t].light;

		if (!light->id || !(light->distance_m > 0.0F))
			continue;
		const float nearer =
			(float)lp_nearer(way_m, 1.0 / (double)light->distance_m, light->direction);

		light->distance_m /= nearer;
		light->angular_radius_deg *= nearer;
		tracker->track[t].full *= nearer * nearer;
		for (int c = 0; c < 3; c++)
			light->irradiance[c] *= nearer * nearer;
	}
	add_near_lights(tracker, 1.0);
}

void lp_tracker_turn(struct lp_tracker *tracker, const struct lp_rotation *turn)
{
	lp_sh_rotate(turn, LP_MAX_SH_ORDER, tracker->sh_total);
	for (int t = 0; t < LP_MAX_TRACKS; t++)
		lp_model_turn_light(&tracker->track[t].light, turn);
}
