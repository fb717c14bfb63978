/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A source of frames: camera, files, simulator. One back end = one file
 * drivers/source/<scheme>/<scheme>.c with one `const struct lp_source_ops`, registered by one line
 * in app/backends.c. docs/maintainers/adding_a_backend.md leads through drivers/source/example/.
 *
 * Contract. create() only parses and allocates; start() opens the device. A device that is absent
 * is no error of start() when it may come (camera, simulator): it reports WAITING and tries again
 * with back-off. All ops and callbacks run on the loop thread and take less than 1 ms; what blocks
 * runs in a thread of the back end's own, which hands over through drivers/source/outbox.h.
 * Descriptors and timers are watched on host.loop (base/loop.h) from start() on. Results are 0 or
 * negative errno; the error has been logged where it was detected.
 *
 * Order of the callbacks, the same for all sources (tests/unit/test_source_contract.c):
 * 1. No op makes a callback: all come from the loop, after start().
 * 2. Frames come only while STREAMING. STREAMING is reported before the first frame, as soon as a
 *    usable one (without LP_FRAME_CORRUPT) is there; from then on caps() is complete.
 * 3. A corrupt frame in another state is not handed on but counted, by corrupt(). So a device that
 *    sends only corrupt frames is not STREAMING; after a while it is STALLED.
 * 4. After WAITING, STALLED or DOWN, STREAMING is reported again before the next frame. A source
 *    that waits for a device says why, and says so again when the reason has changed.
 * 5. No state is reported twice in a row with the same reason.
 * 6. A finite source ends with a frame that has LP_FRAME_LAST, and ENDED after it; nothing follows.
 *    One that has no usable frame ends with DOWN.
 */
#ifndef LP_SOURCE_H
#define LP_SOURCE_H

#include <stdbool.h>
#include <stdint.h>

#include "include/backend.h"

struct lp_camera_profile;
struct lp_frame;
struct lp_loop;
struct lp_uri;
struct lp_source;

enum lp_source_state {
	LP_SOURCE_DOWN = 1,
	LP_SOURCE_WAITING, /* device absent; trying again */
	LP_SOURCE_STREAMING,
	LP_SOURCE_STALLED, /* present, but without usable frames */
	LP_SOURCE_ENDED,   /* a finite source has given its last frame */
};

/* Callbacks into the application, all on the loop thread. */
struct lp_source_host {
	void *context;
	struct lp_loop *loop; /* outlives the source */
	/* Every picture exactly once, as fast as it is taken, then LP_FRAME_LAST and ENDED: a
	 * source that could repeat, pace or leave out does none of it. Cameras cannot, and just
	 * stream. */
	bool once;
	/* Takes over the reference to `frame`. */
	void (*frame)(void *context, struct lp_frame *frame);
	/* A corrupt frame has come that is not handed on, because the source is not STREAMING. */
	void (*corrupt)(void *context);
	/* `reason` names object, stage and next step; valid during the call. */
	void (*state)(void *context, enum lp_source_state state, const char *reason);
	/* The device has something wrong that does not stop its frames: a low battery, heat. `id`
	 * (static) as in docs/users/faults.md; `text` is valid during the call, NULL: it is over.
	 * NULL: nobody wants to know. */
	void (*fault)(void *context, const char *id, const char *text);
	/* What the camera file says to the driver; NULL: there is none. Borrowed during create().
	 */
	const struct lp_camera_profile *camera;
};

#define LP_EXPOSURES_MAX 64

/* What the source can do about exposure; NAN or 0 where it does not apply. */
struct lp_source_caps {
	bool exposure_settable;
	bool reports_exposure; /* each frame carries the exposure that it had: nothing is guessed */
	float exposure_min_us, exposure_max_us;
	float exposure_step_us; /* commands are rounded to multiples of this; 0: any value */
	int exposure_count;	/* only those below can be set; 0: any within the limits */
	float exposures_us[LP_EXPOSURES_MAX]; /* ascending */
	float gain_min, gain_max;	      /* both 1: it cannot be set */
	int exposure_delay_frames;	      /* frames from command to effect; -1: unknown */
	float in_force_us; /* exposure times gain that the first frame has for certain; 0: unknown
			    */
	/* What the camera does to its pictures that changes the light in them (processing.h), as
	 * far as it tells: LP_PROCESSING_BIT() of what is on. */
	bool tells_processing;
	uint32_t processing_on;
	bool has_poses; /* of the camera, recorded: its frames carry them */
	bool finite;	/* ends by itself, with LP_FRAME_LAST and ENDED */
};

struct lp_source_ops {
	struct lp_backend info;
	int (*create)(const struct lp_uri *uri, const struct lp_source_host *host,
		      struct lp_source **source);
	int (*start)(struct lp_source *source);
	void (*caps)(const struct lp_source *source, struct lp_source_caps *caps);
	/* Optional (NULL): command exposure; takes effect some frames later. */
	int (*set_exposure)(struct lp_source *source, float exposure_us, float gain);
	/* Optional (NULL): a camera for stills is to take a set now, or after the one under way. */
	void (*take_stills)(struct lp_source *source);
	/* Accepts NULL. Restores what start() changed on the device. Frames must be back by then.
	 */
	void (*destroy)(struct lp_source *source);
};

/* Base of every back end: embed it as the first member. */
struct lp_source {
	const struct lp_source_ops *ops;
	struct lp_source_host host;
};

#endif
