/* SPDX-License-Identifier: Apache-2.0 */
/* The capture from the inside, for its two parts: capture.c (the loop's calls, connecting) and
 * run.c (while the camera streams). */
#ifndef LP_SOURCE_OSC_CAPTURE_PARTS_H
#define LP_SOURCE_OSC_CAPTURE_PARTS_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/backoff.h"
#include "drivers/source/osc/camera.h"
#include "drivers/source/osc/capture.h"
#include "drivers/source/outbox.h"

struct lp_pool;

/* Frames from a command to the first that obeys, at most, where it is not known: RICOH says nothing
 * of it, and what camera and network hold back comes on top. With 12, brackets took a late exposure
 * for the next one, with light 17 % wrong (tests/bench/which_camera.py on a machine that was too
 * slow); with 30 they never did. The first estimate comes so much later. */
#define LP_OSC_LONGEST_DELAY_FRAMES 30

struct lp_osc_capture {
	struct lp_osc_settings settings;
	struct lp_source_outbox *outbox;
	struct lp_osc_http *http;
	struct lp_pool *frames;
	pthread_t thread;
	bool thread_runs;

	pthread_mutex_t lock; /* of what follows, up to the next comment */
	bool stop;
	bool open;
	struct lp_source_caps caps;
	float wanted_exposure_us, wanted_gain; /* NAN: nothing has been asked for */
	unsigned wish;			       /* raised by every new wanted exposure */

	/* The thread's own. */
	struct lp_osc_camera camera;
	struct lp_backoff retry;
	uint64_t sequence; /* of the next frame */
	bool has_battery_fault, has_heat_fault;
};

/* Has the loop asked the thread to end? */
bool lp_osc_is_stopped(struct lp_osc_capture *capture);

/* Hand on the frames of an open camera until its live preview ends or the thread shall end; reports
 * why it ended. Returns how long to wait before the next attempt. */
int64_t lp_osc_run(struct lp_osc_capture *capture);

/* Report a fault. Returns how long to wait before the next attempt. */
int64_t lp_osc_report(struct lp_osc_capture *capture, const struct lp_osc_fault *fault);

#endif
