/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/exposures/bracket.h"

#include <math.h>
#include <string.h>

#include "base/log.h"
#include "estimate/exposures/bracket_plan.h"
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
/* The same of a camera that has followed: commands are late where a computer is busy. */
#define PATIENT_MISSES 12
/* Changes of exposure that frames must tell, before exposures are what was commanded. */
#define PROOFS 2
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
 * what it differs from the other exposure, and by LEAST_CODES less. */
#define FIT_CODES 12.0F
#define CLEARLY 0.5F
#define LEAST_CODES 0.1F
/* A new plan must differ by this, or the bracket would never rest. */
#define REPLAN_STOPS 0.7F
/* Before anything is known of the scene. */
#define FIRST_US 8000.0F
/* Two exposures that are the same but for rounding. */
#define SAME_STOPS 0.01F

static float allowed(const struct lp_bracket *b, float exposure_us)
{
	return lp_bracket_allowed(&b->limits, exposure_us);
}

/* What frames may have, from the k-th on. */
static void forget_before(struct lp_bracket *b, int k)
{
	b->could -= k;
	memmove(b->could_us, b->could_us + k, (size_t)b->could * sizeof(*b->could_us));
}

static void command(struct lp_bracket *b, float exposure_us)
{
	b->commanded_us = exposure_us;
	b->frames_since_command = b->judged_since_command = b->delay.early_frames = 0;
	b->assumed = false;
	if (b->could == LP_MAX_CANDIDATES)
		forget_before(b, 1);
	b->could_us[b->could++] = exposure_us;
}

static void start(struct lp_bracket *b, float exposure_us)
{
	b->state = LP_BRACKET_STARTING;
	b->settled_us = NAN;
	b->strange = b->proved = b->could = 0;
	b->plan.count = 1;
	b->plan.at = 0;
	b->plan.us[0] = exposure_us;
	command(b, exposure_us);
}

/* The first command is in force already: there is nothing to wait for. */
static bool is_in_force(const struct lp_bracket *b)
{
	return b->limits.in_force_us > 0.0F &&
	       lp_stops(b->limits.in_force_us, b->commanded_us) < SAME_STOPS;
}

void lp_bracket_init(struct lp_bracket *bracket, int most, const struct lp_bracket_limits *limits)
{
	memset(bracket, 0, sizeof(*bracket));
	bracket->most = most < 1 ? 1 : most > LP_MAX_PLANNED ? LP_MAX_PLANNED : most;
	bracket->limits = *limits;
	start(bracket, allowed(bracket, FIRST_US));
	bracket->plan.shortest_us = bracket->commanded_us;
	if (is_in_force(bracket)) {
		bracket->state = LP_BRACKET_RUNNING;
		bracket->settled_us = bracket->commanded_us;
	}
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

/* Does the frame fit the a-th exposure, and clearly not the b-th? */
static bool beats(const struct lp_exposure_matches *matches, int a, int b)
{
	const float own = matches->codes[a][b], other = matches->codes[b][a];

	/* false for NAN: nothing tells the two apart */
	return own < FIT_CODES && own < CLEARLY * other && own < other - LEAST_CODES;
}

/* What a frame says of the exposures that it may have. */
struct verdict {
	int oldest, newest; /* those that are left; oldest > newest: none */
	bool fits;	    /* they differ by no more than a moving scene may */
};

static struct verdict compare(const struct lp_bracket *b, const struct lp_exposure_matches *matches)
{
	struct verdict verdict = {.oldest = b->could, .newest = -1, .fits = true};

	for (int k = 0; k < b->could; k++) {
		bool is_beaten = false, fits = true;

		for (int j = 0; j < b->could; j++) {
			is_beaten |= j != k && beats(matches, j, k);
			fits &= j == k || !(matches->codes[k][j] >= FIT_CODES);
		}
		if (is_beaten)
			continue;
		verdict.oldest = verdict.oldest < k ? verdict.oldest : k;
		verdict.newest = k;
		verdict.fits &= fits;
	}
	return verdict;
}

static struct lp_bracket_decision take_effect(struct lp_bracket *b, int k)
{
	b->settled_us = b->could_us[k];
	forget_before(b, k);
	b->misses = b->strange = 0;
	return accept(b->settled_us);
}

static float distance_stops(const struct lp_bracket *b, float exposure_us)
{
	float least = INFINITY;

	for (int k = 0; k < b->could; k++)
		least = fminf(least, lp_stops(exposure_us, b->could_us[k]));
	return least;
}

/* One more exposure, two stops from the one commanded and off those that may come: whether the
 * picture answers it tells a camera that does not follow from light that changed just so. */
static float other_us(const struct lp_bracket *b)
{
	const float shorter = allowed(b, b->commanded_us / 4.0F);
	const float longer = allowed(b, b->commanded_us * 4.0F);

	return distance_stops(b, shorter) > distance_stops(b, longer) ? shorter : longer;
}

/* Past the longest delay nothing has taken effect: try another exposure, and after some tries give
 * the camera up. One that has followed may be late, as on a busy machine. */
static void miss(struct lp_bracket *b, struct lp_bracket_decision *decision)
{
	const int most = lp_bracket_is_proved(b) ? PATIENT_MISSES : MOST_MISSES;

	b->judged_since_command = 0;
	if (++b->misses < MOST_MISSES) {
		command(b, other_us(b));
		decision->command = true;
		decision->command_us = b->commanded_us;
	}
	if (b->misses < most)
		return;
	lp_warning(
		"camera", "exposure",
		"ignores exposure commands (%d without effect); exposures are unknown and brackets "
		"are off — is automatic exposure on, or does another program control the camera?",
		MOST_MISSES);
	b->state = LP_BRACKET_IGNORED;
	b->ignored.frames = 0;
	*decision =
		(struct lp_bracket_decision){.accept = true, .forget = true, .exposure_us = NAN};
}

/* The old exposure lasts: good while the command may still be on its way, suspect afterwards. */
static struct lp_bracket_decision still_old(struct lp_bracket *b)
{
	struct lp_bracket_decision decision = accept(b->settled_us);

	b->strange = 0;
	b->assumed = false;
	if (b->delay.changes && b->frames_since_command > b->delay.most_frames + 1)
		decision = (struct lp_bracket_decision){.exposure_us = NAN};
	if (b->judged_since_command > most_delay(b))
		miss(b, &decision);
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

/* How long this camera takes, as the newest command shows. Light may change just as the exposure
 * will a few frames later, but not time and again: then the camera has become faster, as it does
 * when a computer is no longer busy. */
static void learn_delay(struct lp_bracket *b)
{
	const int delay = b->frames_since_command;

	b->delay.early_changes = b->delay.early_frames ? b->delay.early_changes + 1 : 0;
	if (b->delay.early_changes >= TRUSTED_CHANGES)
		b->delay.least_frames = b->delay.early_frames;
	else if (!b->delay.changes || delay < b->delay.least_frames)
		b->delay.least_frames = delay;
	if (!b->delay.changes || delay > b->delay.most_frames)
		b->delay.most_frames = delay;
	b->delay.changes++;
}

/* The k-th has taken effect. */
static struct lp_bracket_decision change_seen(struct lp_bracket *b, int k)
{
	if (k == b->could - 1)
		learn_delay(b);
	b->proved++;
	b->assumed = false;
	return take_effect(b, k);
}

/* The light has changed, and how long this camera takes tells the exposure, if it always takes as
 * long: all light darker by a factor looks just like a shorter exposure. */
static struct lp_bracket_decision by_time(struct lp_bracket *b)
{
	const bool is_old = b->frames_since_command < b->delay.least_frames;

	if (b->could != 2 || b->delay.least_frames != b->delay.most_frames ||
	    ++b->delay.untold > MOST_UNTOLD)
		return fits_nothing(b);
	return is_old ? accept(b->settled_us) : take_effect(b, 1);
}

/* The frame fits the k-th exposure alone. */
static struct lp_bracket_decision told(struct lp_bracket *b, int k, float codes)
{
	const bool is_trusted = b->delay.changes >= TRUSTED_CHANGES;
	const bool is_early = is_trusted && b->frames_since_command < b->delay.least_frames;
	const bool is_due = is_trusted && b->frames_since_command >= b->delay.most_frames;

	if (k == 0 && is_due && codes > 2.0F * b->fit_codes + AS_WELL_CODES)
		return by_time(b);
	/* sooner than this camera has ever been: light that changed just so, or frames were lost
	 * and nobody knows */
	if (k > 0 && k == b->could - 1 && is_early) {
		if (!b->delay.early_frames)
			b->delay.early_frames = b->frames_since_command;
		return fits_nothing(b);
	}
	if (k == 0)
		b->delay.early_frames = 0;
	b->delay.untold = 0;
	b->fit_codes = codes;
	return k == 0 ? still_old(b) : change_seen(b, k);
}

static struct lp_bracket_decision judge_change(struct lp_bracket *b,
					       const struct lp_exposure_matches *matches)
{
	const bool is_trusted = b->delay.changes >= TRUSTED_CHANGES;
	const bool is_early = is_trusted && b->frames_since_command < b->delay.least_frames;
	const struct verdict verdict = compare(b, matches);
	const int k = verdict.oldest;

	if (k > verdict.newest || !verdict.fits)
		return is_trusted ? by_time(b) : fits_nothing(b);
	if (k == verdict.newest)
		return told(b, k, matches->codes[k][k ? 0 : 1]);
	if (b->could_us[k] == b->could_us[verdict.newest]) /* whichever of the two */
		return accept(b->could_us[k]);
	/* dark or saturated in several, so that they cannot be told: time must do, and it does no
	 * harm */
	if (b->assumed)
		return accept(b->settled_us);
	if (is_early)
		return by_time(b);
	if (b->judged_since_command <= most_delay(b))
		return (struct lp_bracket_decision){.exposure_us = NAN};
	b->assumed = true;
	b->settled_us = b->commanded_us;
	b->misses = b->strange = 0;
	return accept(b->settled_us);
}

bool lp_bracket_is_proved(const struct lp_bracket *bracket)
{
	return bracket->report.told || bracket->proved >= PROOFS;
}

/* Frames that the camera has taken since the last one that came, and this one. */
static int passed(const struct lp_bracket *b, uint64_t sequence)
{
	/* at the first frame, or where a source counts anew, nothing is known to be lost */
	const uint64_t frames = sequence - b->sequence;
	const bool is_known = b->sequence > 0 && frames > 0 && frames <= MOST_LOST;

	return is_known ? (int)frames : 1;
}

float lp_bracket_expected_us(const struct lp_bracket *bracket, uint64_t sequence)
{
	const int delay = bracket->frames_since_command + passed(bracket, sequence);
	const bool is_old = bracket->delay.changes && delay < bracket->delay.least_frames;

	return is_old && bracket->could > 1 ? bracket->settled_us : bracket->commanded_us;
}

void lp_bracket_frame(struct lp_bracket *bracket, uint64_t sequence)
{
	bracket->frames_since_command += passed(bracket, sequence);
	bracket->judged_since_command++;
	bracket->sequence = sequence;
}

struct lp_bracket_decision lp_bracket_judge(struct lp_bracket *bracket,
					    const struct lp_exposure_matches *matches)
{
	struct lp_bracket_decision decision = {.exposure_us = NAN};

	switch (bracket->state) {
	case LP_BRACKET_STARTING:
		if (bracket->judged_since_command <= most_delay(bracket))
			return decision;
		bracket->state = LP_BRACKET_RUNNING;
		lp_debug("camera", "bracket", "begins with %g us", (double)bracket->commanded_us);
		return take_effect(bracket, bracket->could - 1);
	case LP_BRACKET_RUNNING:
		return bracket->could == 1 ? accept(bracket->settled_us)
					   : judge_change(bracket, matches);
	case LP_BRACKET_IGNORED: /* lp_bracket_ignored() */
		break;
	}
	return accept(NAN);
}

/* Two stops from here, where there is room. */
static float elsewhere_us(const struct lp_bracket *b, float exposure_us)
{
	const float shorter = allowed(b, exposure_us / 4.0F);

	return lp_stops(shorter, exposure_us) > 1.0F ? shorter : allowed(b, exposure_us * 4.0F);
}

struct lp_bracket_decision lp_bracket_ignored(struct lp_bracket *bracket, float scale)
{
	const int second_at = RETRY_FRAMES + most_delay(bracket) + 1;
	struct lp_bracket_decision decision = accept(NAN);

	bracket->ignored.frames++;
	if (bracket->ignored.frames == RETRY_FRAMES || bracket->ignored.frames == second_at) {
		const float first_us = allowed(bracket, FIRST_US);

		bracket->ignored.scale_before = scale;
		bracket->settled_us = first_us;
		command(bracket, bracket->ignored.frames < second_at
					 ? first_us
					 : elsewhere_us(bracket, first_us));
		decision.command = true;
		decision.command_us = bracket->commanded_us;
	}
	if (bracket->ignored.frames <= second_at + most_delay(bracket))
		return decision;
	bracket->ignored.frames = 0;
	if (lp_stops(bracket->ignored.scale_before * bracket->settled_us,
		     scale * bracket->commanded_us) > REPLAN_STOPS)
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
	const bool changed = lp_stops(exposure_us, b->report.us) > REPLAN_STOPS;

	b->report.frames_unchanged =
		changed || b->plan.count == 1 ? 0 : b->report.frames_unchanged + 1;
	b->report.us = exposure_us;
	if (b->report.frames_unchanged > 2 * most_delay(b))
		b->report.waits = true;
}

struct lp_bracket_decision lp_bracket_reported(struct lp_bracket *bracket, float exposure_us)
{
	bracket->plan.frames_since++;
	if (bracket->state != LP_BRACKET_RUNNING)
		bracket->report.us = exposure_us;
	bracket->state = LP_BRACKET_RUNNING;
	bracket->report.told = true;
	bracket->plan.shortest_seen |=
		lp_stops(exposure_us, bracket->plan.us[bracket->plan.count - 1]) <
		0.5F * REPLAN_STOPS;
	watch_pace(bracket, exposure_us);
	/* the device may round: near enough is what was asked for; and it is not asked twice */
	if (lp_stops(exposure_us, bracket->commanded_us) < REPLAN_STOPS ||
	    bracket->frames_since_command > most_delay(bracket))
		bracket->settled_us = bracket->commanded_us;
	forget_before(bracket, bracket->could - 1);
	return accept(exposure_us);
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
	if (count != b->plan.count)
		return true;
	for (int k = 0; k < count; k++)
		if (lp_stops(plan_us[k], b->plan.us[k]) > REPLAN_STOPS)
			return true;
	return false;
}

/* Whether the scene as it is known tells what the plan in force does: its shortest exposure has
 * been seen, or does not come. */
static bool plan_is_seen(const struct lp_bracket *b)
{
	return b->plan.shortest_seen || b->plan.frames_since > most_delay(b) + b->plan.count;
}

/* Exposures of a round. Three frames at 30 per second are ten periods of 100 Hz: each exposure
 * would see the lamps in one phase for ever, so that the shortest comes twice where they may
 * flicker. */
static int round_length(const struct lp_bracket *b, const struct lp_bracket_scene *scene)
{
	const bool at_once = b->report.told && !b->report.waits;

	return b->plan.count + (at_once && scene->restless && b->plan.count % 3 == 0);
}

/* Where exposures are reported, until it is; else until frames tell it. */
static bool is_under_way(const struct lp_bracket *b)
{
	return b->report.told ? b->commanded_us != b->settled_us : b->could > 1 && !b->assumed;
}

bool lp_bracket_next(struct lp_bracket *bracket, const struct lp_bracket_scene *scene,
		     float *command_us)
{
	struct lp_bracket *b = bracket;
	float plan_us[LP_MAX_PLANNED];

	const bool at_once = b->report.told && !b->report.waits;

	/* much brighter: the rest of the round would clip, too */
	b->plan.outdated = !at_once && scene->clipped && (b->plan.outdated || scene->changed);
	if (b->state != LP_BRACKET_RUNNING || (!at_once && is_under_way(b)))
		return false;
	const bool is_complete = b->plan.at >= b->plan.count - 1 && (!at_once || plan_is_seen(b));

	if (is_complete || b->plan.outdated) {
		const int count = lp_bracket_plan(b, scene, plan_us);

		b->plan.shortest_seen = b->plan.outdated = false;
		b->plan.frames_since = 0;

		if (differs(b, plan_us, count)) {
			memcpy(b->plan.us, plan_us, (size_t)count * sizeof(*plan_us));
			b->plan.count = count;
			log_plan(plan_us, count);
			/* what still clips is what is missing: the others can wait */
			b->plan.at = scene->clipped ? count - 2 : -1;
		}
	}
	b->plan.at = (b->plan.at + 1) % round_length(b, scene);
	*command_us = b->plan.us[b->plan.at < b->plan.count ? b->plan.at : b->plan.count - 1];
	/* in the dark no step could be seen */
	if (!lp_bracket_is_proved(b) && scene->peak * b->settled_us * 1e-6F > LP_BRACKET_PEAK_LOW &&
	    lp_stops(*command_us, b->settled_us) < 1.0F)
		*command_us = elsewhere_us(b, b->settled_us); /* does it follow at all? */
	if (*command_us == (at_once ? b->commanded_us : b->settled_us))
		return false;
	command(b, *command_us);
	return true;
}

bool lp_bracket_light_changed(struct lp_bracket *bracket, float factor, float *command_us)
{
	struct lp_bracket *b = bracket;

	if (b->state != LP_BRACKET_RUNNING || !b->report.told || b->report.waits ||
	    !(factor > 0.0F) || lp_stops(factor, 1.0F) < REPLAN_STOPS)
		return false;
	for (int k = 0; k < b->plan.count; k++)
		b->plan.us[k] = allowed(b, b->plan.us[k] / factor);
	/* a peak is not known to have changed alike: in darker light what clips may be the same */
	if (factor > 1.0F)
		b->plan.shortest_us = allowed(b, b->plan.shortest_us / factor);
	b->plan.at = factor > 1.0F ? b->plan.count - 1 : 0;
	b->plan.shortest_seen = false;
	b->plan.frames_since = 0;
	if (b->plan.us[b->plan.at] == b->commanded_us)
		return false;
	command(b, b->plan.us[b->plan.at]);
	*command_us = b->commanded_us;
	return true;
}
