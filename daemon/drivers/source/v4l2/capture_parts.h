/* SPDX-License-Identifier: Apache-2.0 */
/* The capture from the inside, for its two parts: capture.c (the loop's calls, finding and waiting)
 * and run.c (while the camera streams). */
#ifndef LP_SOURCE_V4L2_CAPTURE_PARTS_H
#define LP_SOURCE_V4L2_CAPTURE_PARTS_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/backoff.h"
#include "drivers/source/frame_clock.h"
#include "drivers/source/outbox.h"
#include "drivers/source/v4l2/capture.h"
#include "drivers/source/v4l2/nodes.h"
#include "drivers/source/v4l2/session.h"

struct lp_v4l2_capture {
	struct lp_v4l2_settings settings;
	struct lp_v4l2_target target;
	struct lp_source_outbox *outbox;
	int wake_fd;	/* eventfd: stop, or a new exposure */
	int hotplug_fd; /* -1: no events, only looking again and again */
	pthread_t thread;
	bool thread_runs;

	pthread_mutex_t lock; /* of what follows, up to the next comment */
	bool stop;
	bool open;
	struct lp_source_caps caps;
	float wanted_exposure_us, wanted_gain; /* NAN: nothing has been asked for */
	unsigned wish;			       /* raised by every new wanted exposure */

	/* The thread's own. */
	struct lp_v4l2_node nodes[LP_V4L2_MAX_NODES];
	struct lp_v4l2_node known; /* the camera in use, once there was one */
	bool is_known;
	int attempts; /* to open it since something was plugged in */
	struct lp_backoff retry, reset;
	int64_t next_reset_ns;
	struct lp_frame_clock clock;
	struct lp_processing_report processing_told; /* logged last */
};

/* Has the loop asked the thread to end? */
bool lp_v4l2_is_stopped(struct lp_v4l2_capture *capture);

/* Make the eventfd unreadable until it is written again. */
void lp_v4l2_clear(int event_fd);

enum lp_v4l2_outcome { LP_V4L2_STOPPED, LP_V4L2_UNPLUGGED, LP_V4L2_HUNG };

/* Hand on the frames of an open camera until it goes, hangs, or the thread shall end. */
enum lp_v4l2_outcome lp_v4l2_run(struct lp_v4l2_capture *capture, struct lp_v4l2_session *session);

#endif
