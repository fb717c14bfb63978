/* SPDX-License-Identifier: Apache-2.0 */
#include "app/bracket.h"

#include <math.h>
#include <string.h>

#include "base/log.h"
#include "include/source.h"

/* Where no reason is named, chosen by hand; docs/maintainers/constants.md says which tests notice
 * other values.
 */

/* Cameras take 1 to 4 frames for a change of exposure, and a frame or two may be lost on the way.
 */
#define MOST_DELAY_FRAMES 6
/* Commands without effect before a camera is said not to follow, and when it is tried again. */
#define MOST_MISSES 3
#define RETRY_FRAMES 300
/* After so many changes the shortest delay seen is taken for this camera's. */
#define TRUSTED_CHANGES 5
/* Changes of light in a row that only the time tells from changes of exposure: the time is wrong.
 */
#define MOST_UNTOLD 6
/* When a command should have taken effect, the old exposure must fit as well as it did: within
 * twice as many codes, and so many. */
#define AS_WELL_CODES 0.5F
/* More than so many frames at once are not lost: the source has begun anew. */
#define MOST_LOST 1000
/* Frames in a row that fit nothing: the scene has changed beyond recognition. */
#define MOST_STRANGE 8
/* A frame fits an exposure when it differs by no more codes than a moving scene may, and by half of
 * what it differs from the other exposure, and by LEAST_CODES less. Less than LEAST_COMPARED of the
 * cells are no evidence. */
#define FIT_CODES 12.0F
#define CLEARLY 0.5F
#define LEAST_CODES 0.1F
#define LEAST_COMPARED 0.01F
/* The longest exposure puts the median here, of full scale, as in the brackets of
 * docs/users/accuracy.md; the shortest the brightest cell's mean between these (pixels within it
 * are brighter). */
#define MEDIAN_AT 0.25F
#define PEAK_LOW 0.06F
#define PEAK_HIGH 0.25F
/* Range in stops that one exposure holds, and that lies between neighbours of a bracket, at most:
 * the brackets that docs/users/accuracy.md measures are four stops apart. */
#define STOPS_ALONE 4.0F
#define STOPS_APART 5.0F
/* A new plan must differ by this, or the bracket would never rest. */
#define REPLAN_STOPS 0.7F
/* Before anything is known of the scene. */
#define FIRST_US 8000.0F
/* Of a camera that does not say: up to what keeps 30 frames a second. */
#define LEAST_US 1.0F
#define MOST_US 33000.0F

static float stops(float a, float b)
{
	return fabsf(log2f(a / b));
}

static float or_else(float value, float otherwise)
{
	return isnan(value) ? otherwise : value;
}

struct lp_bracket_limits lp_bracket_limits_of(const struct lp_source_caps *caps)
{
	struct lp_bracket_limits limits = {.min_us = or_else(caps->exposure_min_us, LEAST_US),
					   .max_us = or_else(caps->exposure_max_us, MOST_US),
					   .step_us = or_else(caps->exposure_step_us, 0.0F),
					   .exposure_count = caps->exposure_count,
					   .delay_frames = caps->exposure_delay_frames};

	memcpy(limits.exposures_us, caps->exposures_us, sizeof(limits.exposures_us));
	return limits;
}

static float nearest_of(const struct lp_bracket_limits *limits, float exposure_us)
{
	float nearest_us = limits->exposures_us[0];

	for (int k = 1; k < limits->exposure_count; k++) {
		if (stops(limits->exposures_us[k], exposure_us) < stops(nearest_us, exposure_us))
			nearest_us = limits->exposures_us[k];
	}
	return nearest_us;
}

float lp_bracket_allowed(const struct lp_bracket_limits *limits, float exposure_us)
{
	const float step_us = limits->step_us;

	if (limits->exposure_count > 0)
		return nearest_of(limits, exposure_us);
	if (step_us > 0.0F)
		exposure_us = fmaxf(roundf(exposure_us / step_us), 1.0F) * step_us;
	return fminf(fmaxf(exposure_us, limits->min_us), limits->max_us);
}

static float allowed(const struct lp_bracket *b, float exposure_us)
{
	return lp_bracket_allowed(&b->limits, exposure_us);
}

static void command(struct lp_bracket *b, float exposure_us)
{
	b->commanded_us = exposure_us;
	b->frames_since_command = b->judged_since_command = 0;
}

static void start(struct lp_bracket *b, float exposure_us)
{
	b->state = LP_BRACKET_STARTING;
	b->settled_us = NAN;
	b->strange = 0;
	b->planned = 1;
	b->at = 0;
	b->plan_us[0] = exposure_us;
	command(b, exposure_us);
}

void lp_bracket_init(struct lp_bracket *bracket, int most, const struct lp_bracket_limits *limits)
{
	memset(bracket, 0, sizeof(*bracket));
	bracket->most = most < 1 ? 1 : most > LP_MAX_PLANNED ? LP_MAX_PLANNED : most;
	bracket->limits = *limits;
	start(bracket, allowed(bracket, FIRST_US));
	bracket->shortest_us = bracket->commanded_us;
}

float lp_bracket_first_us(const struct lp_bracket *bracket)
{
	return bracket->commanded_us;
}

static int most_delay(const struct lp_bracket *b)
{
	return b->limits.delay_frames >= 0 && b->limits.delay_frames + 2 > MOST_DELAY_FRAMES
		       ? b->limits.delay_frames + 2
		       : MOST_DELAY_FRAMES;
}

static struct lp_bracket_decision accept(float exposure_us)
{
	return (struct lp_bracket_decision){.accept = true, .exposure_us = exposure_us};
}

static bool evidence(const struct lp_exposure_match *match)
{
	return match->compared >= LEAST_COMPARED && !isnan(match->difference_codes);
}

/* Does the frame fit `this`, and clearly not `other`? Where there is nothing to compare with the
 * other exposure, fitting must do. */
static bool fits(const struct lp_exposure_match *this, const struct lp_exposure_match *other)
{
	return evidence(this) && this->difference_codes < FIT_CODES &&
	       (!evidence(other) ||
		(this->difference_codes < CLEARLY * other->difference_codes &&
		 this->difference_codes < other->difference_codes - LEAST_CODES));
}

static struct lp_bracket_decision take_effect(struct lp_bracket *b)
{
	b->settled_us = b->commanded_us;
	b->misses = b->strange = 0;
	return accept(b->settled_us);
}

/* A third exposure, two stops from the one commanded and off the one that seems to last: whether
 * the picture answers it tells a camera that does not follow from light that changed just so. */
static float other_us(const struct lp_bracket *b)
{
	const float shorter = allowed(b, b->commanded_us / 4.0F);
	const float longer = allowed(b, b->commanded_us * 4.0F);

	return stops(shorter, b->settled_us) > stops(longer, b->settled_us) ? shorter : longer;
}

/*
 * The old exposure lasts: good while the command may still be on its way, suspect afterwards. Past
 * the longest delay try another exposure, and after some tries give the camera up.
 */
static struct lp_bracket_decision still_old(struct lp_bracket *b)
{
	struct lp_bracket_decision decision = accept(b->settled_us);

	b->strange = 0;
	if (b->verified && b->frames_since_command > b->most_seen_frames + 1)
		decision = (struct lp_bracket_decision){.exposure_us = NAN};
	if (b->judged_since_command <= most_delay(b))
		return decision;
	if (++b->misses < MOST_MISSES) {
		command(b, other_us(b));
		decision.command = true;
		decision.command_us = b->commanded_us;
		return decision;
	}
	lp_warning(
		"camera", "exposure",
		"ignores exposure commands (%d without effect); exposures are unknown and brackets "
		"are off — is automatic exposure on, or does another program control the camera?",
		b->misses);
	b->state = LP_BRACKET_IGNORED;
	b->frames_ignored = 0;
	decision.accept = decision.forget = true;
	decision.exposure_us = NAN;
	return decision;
}

/* Lights went on or off, or the camera was moved: nothing known fits any more. */
static struct lp_bracket_decision fits_nothing(struct lp_bracket *b)
{
	struct lp_bracket_decision decision = {.exposure_us = NAN};

	if (++b->strange <= MOST_STRANGE)
		return decision;
	lp_info("camera", "exposure", "the whole scene has changed: the bracket starts again");
	start(b, b->commanded_us);
	decision.forget = decision.command = true;
	decision.command_us = b->commanded_us;
	return decision;
}

/* The command has taken effect, and shows how long this camera takes. */
static struct lp_bracket_decision change_seen(struct lp_bracket *b)
{
	const int delay = b->frames_since_command;

	b->least_seen_frames =
		b->verified && b->least_seen_frames < delay ? b->least_seen_frames : delay;
	b->most_seen_frames =
		b->verified && b->most_seen_frames > delay ? b->most_seen_frames : delay;
	b->verified = true;
	b->changes++;
	return take_effect(b);
}

/* The light has changed, and how long this camera takes tells the exposure, if it always takes as
 * long: all light darker by a factor looks just like a shorter exposure. */
static struct lp_bracket_decision by_time(struct lp_bracket *b)
{
	const bool is_old = b->frames_since_command < b->least_seen_frames;

	if (b->least_seen_frames != b->most_seen_frames || ++b->untold > MOST_UNTOLD)
		return fits_nothing(b);
	if (!is_old)
		b->settled_us = b->commanded_us;
	return accept(b->settled_us);
}

static struct lp_bracket_decision judge_change(struct lp_bracket *b,
					       const struct lp_exposure_match *settled,
					       const struct lp_exposure_match *commanded)
{
	const bool is_trusted = b->changes >= TRUSTED_CHANGES;
	const bool is_early = is_trusted && b->frames_since_command < b->least_seen_frames;
	const bool is_due = is_trusted && b->frames_since_command >= b->most_seen_frames;
	const float before_codes = b->fit_codes;

	if (fits(commanded, settled) && !is_early) {
		b->untold = 0;
		b->fit_codes = commanded->difference_codes;
		return change_seen(b);
	}
	if (fits(settled, commanded) &&
	    !(is_due && settled->difference_codes > 2.0F * before_codes + AS_WELL_CODES)) {
		b->untold = 0;
		b->fit_codes = settled->difference_codes;
		return still_old(b);
	}
	/* sooner than this camera has ever been: light that changed just so, or frames were lost
	 * and nobody knows */
	if (fits(commanded, settled))
		return fits_nothing(b);
	if (is_early || (is_due && fits(settled, commanded)))
		return by_time(b);
	/* dark or saturated in both, so that neither can be told: time must do, and it does no harm
	 */
	const bool alike = (!evidence(settled) || settled->difference_codes < FIT_CODES) &&
			   (!evidence(commanded) || commanded->difference_codes < FIT_CODES);

	if (alike && b->judged_since_command > most_delay(b))
		return take_effect(b);
	if (alike)
		return (struct lp_bracket_decision){.exposure_us = NAN};
	return is_trusted ? by_time(b) : fits_nothing(b);
}

void lp_bracket_frame(struct lp_bracket *bracket, uint64_t sequence)
{
	/* at the first frame, or where a source counts anew, nothing is known to be lost */
	const uint64_t passed = sequence - bracket->sequence;
	const bool is_known = bracket->sequence > 0 && passed > 0 && passed <= MOST_LOST;

	bracket->frames_since_command += is_known ? (int)passed : 1;
	bracket->judged_since_command++;
	bracket->sequence = sequence;
}

struct lp_bracket_decision lp_bracket_judge(struct lp_bracket *bracket,
					    const struct lp_exposure_match *settled,
					    const struct lp_exposure_match *commanded)
{
	struct lp_bracket_decision decision = {.exposure_us = NAN};

	switch (bracket->state) {
	case LP_BRACKET_STARTING:
		if (bracket->judged_since_command <= most_delay(bracket))
			return decision;
		bracket->state = LP_BRACKET_RUNNING;
		lp_debug("camera", "bracket", "begins with %g us", (double)bracket->commanded_us);
		return take_effect(bracket);
	case LP_BRACKET_RUNNING:
		return bracket->commanded_us == bracket->settled_us
			       ? accept(bracket->settled_us)
			       : judge_change(bracket, settled, commanded);
	case LP_BRACKET_IGNORED: /* lp_bracket_ignored() */
		break;
	}
	return accept(NAN);
}

/* Two stops from here, where there is room. */
static float elsewhere_us(const struct lp_bracket *b, float exposure_us)
{
	const float shorter = allowed(b, exposure_us / 4.0F);

	return stops(shorter, exposure_us) > 1.0F ? shorter : allowed(b, exposure_us * 4.0F);
}

struct lp_bracket_decision lp_bracket_ignored(struct lp_bracket *bracket, float scale)
{
	const int second_at = RETRY_FRAMES + most_delay(bracket) + 1;
	struct lp_bracket_decision decision = accept(NAN);

	bracket->frames_ignored++;
	if (bracket->frames_ignored == RETRY_FRAMES || bracket->frames_ignored == second_at) {
		const float first_us = allowed(bracket, FIRST_US);

		bracket->scale_before = scale;
		bracket->settled_us = first_us;
		command(bracket, bracket->frames_ignored < second_at
					 ? first_us
					 : elsewhere_us(bracket, first_us));
		decision.command = true;
		decision.command_us = bracket->commanded_us;
	}
	if (bracket->frames_ignored <= second_at + most_delay(bracket))
		return decision;
	bracket->frames_ignored = 0;
	if (stops(bracket->scale_before * bracket->settled_us, scale * bracket->commanded_us) >
	    REPLAN_STOPS)
		return decision;
	lp_info("camera", "exposure", "follows commands again");
	bracket->misses = 0;
	start(bracket, bracket->commanded_us);
	return (struct lp_bracket_decision){.exposure_us = NAN,
					    .forget = true,
					    .command = true,
					    .command_us = bracket->commanded_us};
}

/* A camera may begin its delay anew with each command, and then never do what it is told: do not
 * command again before a command has taken effect. */
static void watch_pace(struct lp_bracket *b, float exposure_us)
{
	const bool changed = stops(exposure_us, b->reported_us) > REPLAN_STOPS;

	b->frames_unchanged = changed || b->planned == 1 ? 0 : b->frames_unchanged + 1;
	b->reported_us = exposure_us;
	if (b->frames_unchanged > 2 * most_delay(b))
		b->waits = true;
}

struct lp_bracket_decision lp_bracket_reported(struct lp_bracket *bracket, float exposure_us)
{
	bracket->frames_since_plan++;
	if (bracket->state != LP_BRACKET_RUNNING)
		bracket->reported_us = exposure_us;
	bracket->state = LP_BRACKET_RUNNING;
	bracket->verified = true;
	bracket->reports = true;
	bracket->shortest_seen |=
		stops(exposure_us, bracket->plan_us[bracket->planned - 1]) < 0.5F * REPLAN_STOPS;
	watch_pace(bracket, exposure_us);
	/* the device may round: near enough is what was asked for; and it is not asked twice */
	if (stops(exposure_us, bracket->commanded_us) < REPLAN_STOPS ||
	    bracket->frames_since_command > most_delay(bracket))
		bracket->settled_us = bracket->commanded_us;
	return accept(exposure_us);
}

/* The shortest exposure follows the peak. A lamp smaller than a cell clips while the cell's mean is
 * still low: what clipped is not tried again as long as the peak is what it was then. */
static void adapt_shortest(struct lp_bracket *b, const struct lp_bracket_scene *scene)
{
	if (scene->clipped) {
		b->clips_us = b->shortest_us;
		b->clips_peak = 0.0F;
		b->shortest_us /= 4.0F;
		return;
	}
	b->clips_peak = fmaxf(b->clips_peak, scene->peak);
	if (scene->peak < 0.5F * b->clips_peak)
		b->clips_us = b->clips_peak = 0.0F;
	if (scene->peak > 0.0F && scene->peak * b->shortest_us * 1e-6F < PEAK_LOW) {
		const float longer_us =
			fminf(b->shortest_us * 2.0F, PEAK_HIGH * 1e6F / scene->peak);

		if (b->clips_us <= 0.0F || longer_us < 0.99F * b->clips_us)
			b->shortest_us = longer_us;
	}
}

/* Exposures for the scene, longest first. */
static int plan(struct lp_bracket *b, const struct lp_bracket_scene *scene,
		float plan_us[LP_MAX_PLANNED])
{
	const float longest = allowed(b, scene->median > 0.0F ? MEDIAN_AT * 1e6F / scene->median
							      : b->limits.max_us);
	int count;

	adapt_shortest(b, scene);
	b->shortest_us = fminf(allowed(b, b->shortest_us), longest);

	const float range = log2f(longest / b->shortest_us);

	count = range <= STOPS_ALONE ? 1 : 1 + (int)ceilf(range / STOPS_APART - 0.25F);
	count = count < 1 ? 1 : count > b->most ? b->most : count;
	if (count == 1) {
		plan_us[0] = b->shortest_us;
		return 1;
	}
	for (int k = 0; k < count; k++)
		plan_us[k] = allowed(b, longest * exp2f(-range * (float)k / (float)(count - 1)));
	return count;
}

static void log_plan(const float plan_us[LP_MAX_PLANNED], int count)
{
	float us[LP_MAX_PLANNED] = {0};

	memcpy(us, plan_us, (size_t)count * sizeof(*us));
	lp_debug("camera", "bracket", "%d exposures: %g %g %g %g us", count, (double)us[0],
		 (double)us[1], (double)us[2], (double)us[3]);
}

static bool differs(const struct lp_bracket *b, const float plan_us[LP_MAX_PLANNED], int count)
{
	if (count != b->planned)
		return true;
	for (int k = 0; k < count; k++)
		if (stops(plan_us[k], b->plan_us[k]) > REPLAN_STOPS)
			return true;
	return false;
}

/* Whether the scene as it is known tells what the plan in force does: its shortest exposure has
 * been seen, or does not come. */
static bool plan_is_seen(const struct lp_bracket *b)
{
	return b->shortest_seen || b->frames_since_plan > most_delay(b) + b->planned;
}

/* Exposures of a round. Three frames at 30 per second are ten periods of 100 Hz: each exposure
 * would see the lamps in one phase for ever, so that the shortest comes twice where they may
 * flicker. */
static int round_length(const struct lp_bracket *b, const struct lp_bracket_scene *scene)
{
	const bool at_once = b->reports && !b->waits;

	return b->planned + (at_once && scene->restless && b->planned % 3 == 0);
}

bool lp_bracket_next(struct lp_bracket *bracket, const struct lp_bracket_scene *scene,
		     float *command_us)
{
	struct lp_bracket *b = bracket;
	float plan_us[LP_MAX_PLANNED];

	const bool at_once = b->reports && !b->waits;

	if (b->state != LP_BRACKET_RUNNING || (!at_once && b->commanded_us != b->settled_us))
		return false;
	if (b->at >= b->planned - 1 && (!at_once || plan_is_seen(b))) { /* the round is complete */
		const int count = plan(b, scene, plan_us);

		b->shortest_seen = false;
		b->frames_since_plan = 0;

		if (differs(b, plan_us, count)) {
			memcpy(b->plan_us, plan_us, (size_t)count * sizeof(*plan_us));
			b->planned = count;
			log_plan(plan_us, count);
			/* what still clips is what is missing: the others can wait */
			b->at = scene->clipped ? count - 2 : -1;
		}
	}
	b->at = (b->at + 1) % round_length(b, scene);
	*command_us = b->plan_us[b->at < b->planned ? b->at : b->planned - 1];
	/* in the dark no step could be seen */
	if (!b->verified && scene->peak * b->settled_us * 1e-6F > PEAK_LOW &&
	    stops(*command_us, b->settled_us) < 1.0F)
		*command_us = elsewhere_us(b, b->settled_us); /* does it follow at all? */
	if (*command_us == (at_once ? b->commanded_us : b->settled_us))
		return false;
	command(b, *command_us);
	return true;
}

bool lp_bracket_light_changed(struct lp_bracket *bracket, float factor, float *command_us)
{
	struct lp_bracket *b = bracket;

	if (b->state != LP_BRACKET_RUNNING || !b->reports || b->waits || !(factor > 0.0F) ||
	    stops(factor, 1.0F) < REPLAN_STOPS)
		return false;
	for (int k = 0; k < b->planned; k++)
		b->plan_us[k] = allowed(b, b->plan_us[k] / factor);
	/* a peak is not known to have changed alike: in darker light what clips may be the same */
	if (factor > 1.0F)
		b->shortest_us = allowed(b, b->shortest_us / factor);
	b->at = factor > 1.0F ? b->planned - 1 : 0;
	b->shortest_seen = false;
	b->frames_since_plan = 0;
	if (b->plan_us[b->at] == b->commanded_us)
		return false;
	command(b, b->plan_us[b->at]);
	*command_us = b->commanded_us;
	return true;
}
