/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Exposure brackets on cameras that take a command some frames later and do not say when. Set,
 * wait, verify by what the picture shows, accept: a frame counts only when its brightness, cell
 * by cell, is that of the exposure in effect or of one commanded since, and clearly not of the
 * others. How long a camera takes tells exposures only while it always takes as long. Chooses the
 * exposures itself: the longest resolves the dark half of the scene, the shortest clips almost
 * nothing, one when one suffices. Pure logic: no I/O, no pixels; owned by the worker.
 *
 *            the longest delay after the first command       MOST_MISSES commands without effect
 *   STARTING ------------------------------------> RUNNING ------------------------------> IGNORED
 *      ^                                              |                                       |
 *      |   more than MOST_STRANGE frames fit nothing  |        RETRY_FRAMES frames            |
 *      +----------------------------------------------+---------------------------------------+
 *
 * While RUNNING a command is under way, or none is:
 *
 *   could == 1 ----------plan says another exposure----> could == 2
 *        ^                                                   |   |
 *        |   a frame fits the commanded exposure, clearly    |   |  more than the longest delay
 *        +---------------------------------------------------+   |  without effect: another
 *                                                                +-> exposure is tried (a miss),
 *                                                                    and may come as well
 *
 * Where frames report their exposure (lp_bracket_reported) only RUNNING is reached, and no command
 * waits for the one before it: each frame commands the next exposure, so that all are seen within
 * as many frames. The limits are named in bracket.c.
 */
#ifndef LP_ESTIMATE_EXPOSURES_BRACKET_H
#define LP_ESTIMATE_EXPOSURES_BRACKET_H

#include <stdbool.h>

#include "include/source.h"
#include "vision/imager.h"

#define LP_MAX_PLANNED 4

struct lp_bracket_limits {
	float min_us, max_us; /* of exposure times gain */
	float step_us;	      /* commands are rounded to multiples of this; 0: any value */
	int exposure_count;   /* only those below can be set; 0: any within the limits */
	float exposures_us[LP_EXPOSURES_MAX]; /* ascending */
	int delay_frames;		      /* from command to effect; -1: unknown */
	float in_force_us;		      /* of the first frame; 0: not known */
};

/* What the panorama says of the scene; luminance. */
struct lp_bracket_scene {
	float median;	   /* radiance that half of the sphere stays below */
	float peak;	   /* highest of a cell */
	bool clipped;	   /* something saturates in the shortest exposure */
	bool changed;	   /* most of the light, with this frame */
	bool restless;	   /* the light changes from frame to frame, as of lamps that flicker */
	bool looks_around; /* the camera sees little at a time: lamps may come into view */
};

enum lp_bracket_state {
	LP_BRACKET_STARTING, /* exposure in effect not known yet: frames are left out */
	LP_BRACKET_RUNNING,
	LP_BRACKET_IGNORED, /* the camera does not follow: exposures are unknown */
};

/* Which exposures the scene needs (bracket_plan.c). */
struct lp_bracket_plan {
	float us[LP_MAX_PLANNED]; /* longest first */
	int count, at;		  /* us[at] is commanded; the shortest also when at == count */
	bool outdated;		  /* the light has become so bright that the plan does not serve */
	float shortest_us;	  /* adapted to the scene's peak */
	float clips_us, clips_peak; /* known to clip, while the peak is like this; 0: none */
	int frames_since;	    /* it was made */
	bool shortest_seen;	    /* us[count - 1], since then; where frames report theirs */
};

/* How long the camera takes from command to effect. */
struct lp_bracket_delay {
	int changes; /* seen to take effect */
	int least_frames, most_frames;
	int early_frames;  /* since when all frames fit the newest, though it is too soon; 0: not */
	int early_changes; /* in a row that came so */
	int untold;	   /* frames in a row whose exposure only the time tells */
};

/* Where frames report their exposure. */
struct lp_bracket_report {
	bool told, waits;     /* waits: each command for the one before it, all the same */
	float us;	      /* by the last frame */
	int frames_unchanged; /* in a row, that report the same */
};

/* Of a camera that does not follow. */
struct lp_bracket_ignored {
	int frames;	    /* since it was found not to follow, or tried again */
	float scale_before; /* at the last command to see whether it does */
};

struct lp_bracket {
	int most; /* exposures; 1..LP_MAX_PLANNED */
	struct lp_bracket_limits limits;
	enum lp_bracket_state state;

	struct lp_bracket_plan plan;
	struct lp_bracket_delay delay;
	struct lp_bracket_report report;
	struct lp_bracket_ignored ignored;

	float settled_us, commanded_us;
	/* What the next frame may have: the exposure in effect, and those commanded since, in their
	 * order. The newest is the one commanded last. */
	float could_us[LP_MAX_CANDIDATES];
	int could;
	bool assumed;		  /* frames that tell none of them are taken for the newest */
	int proved;		  /* changes that frames told since exposures were unknown */
	uint64_t sequence;	  /* of the last frame */
	int frames_since_command; /* those that were lost, too */
	int judged_since_command; /* on a busy machine commands are late, and frames are lost */
	int misses;		  /* commands in a row without effect */
	int strange;		  /* frames in a row that fit neither exposure */
	float fit_codes; /* by how much the last frame differed from what its exposure predicts */
};

/* What to do with the frame just judged, and with the camera. */
struct lp_bracket_decision {
	bool accept;
	float exposure_us; /* of the accepted frame; NAN: unknown */
	bool forget;	   /* what is known of the scene no longer fits: start anew */
	bool command;
	float command_us;
};

/* Of a source; where it does not say, what any camera of 30 frames a second can do. */
struct lp_bracket_limits lp_bracket_limits_of(const struct lp_source_caps *caps);

/* The nearest value that the camera can take. */
float lp_bracket_allowed(const struct lp_bracket_limits *limits, float exposure_us);

void lp_bracket_init(struct lp_bracket *bracket, int most, const struct lp_bracket_limits *limits);

/* Before the first frame: the first command. */
float lp_bracket_first_us(const struct lp_bracket *bracket);

/*
 * The light is `factor` times what it was when the plan was made, as the ring of light sensors
 * tells: move the plan along. True: command what is missing now, the shortest exposure in brighter
 * light, the longest in darker. Only where frames report their exposure: elsewhere a new command
 * would hide the light's change.
 */
bool lp_bracket_light_changed(struct lp_bracket *bracket, float factor, float *command_us);

/* What the frame of this number most likely has, before its picture has been looked at. */
float lp_bracket_expected_us(const struct lp_bracket *bracket, uint64_t sequence);

/* A frame has come, to be judged next. sequence: the source's count; frames that were lost before
 * this one count too, as a camera takes its time in frames of its own. */
void lp_bracket_frame(struct lp_bracket *bracket, uint64_t sequence);

/* Judge the frame just loaded. `matches`: how it matches bracket->could_us. */
struct lp_bracket_decision lp_bracket_judge(struct lp_bracket *bracket,
					    const struct lp_exposure_matches *matches);

/* Whether frames have told exposures. If not, they are what was commanded, for all that is known:
 * light may be off by any factor. */
bool lp_bracket_is_proved(const struct lp_bracket *bracket);

/* The same while IGNORED. scale: full scale to radiance of this frame, as found by what is known of
 * the light. From time to time two other exposures are commanded: a camera that follows again
 * shows their ratio by its scale. */
struct lp_bracket_decision lp_bracket_ignored(struct lp_bracket *bracket, float scale);

/* The same for a camera that reports each frame's exposure: nothing is left to verify. */
struct lp_bracket_decision lp_bracket_reported(struct lp_bracket *bracket, float exposure_us);

/* After an accepted frame has corrected the map: plan by the scene, and the next command if one is
 * due.
 */
bool lp_bracket_next(struct lp_bracket *bracket, const struct lp_bracket_scene *scene,
		     float *command_us);

#endif
