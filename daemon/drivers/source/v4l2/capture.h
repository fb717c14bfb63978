/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The thread that drives one camera: finds it, opens it, streams, waits for it when it is gone,
 * wakes it when it is silent. Calls to a camera take milliseconds, or seconds when it hangs; the
 * loop never waits.
 */
#ifndef LP_SOURCE_V4L2_CAPTURE_H
#define LP_SOURCE_V4L2_CAPTURE_H

#include "drivers/source/v4l2/settings.h"
#include "include/source.h"

struct lp_v4l2_capture;

/* 0 or -errno. Loop thread, as all calls here. */
int lp_v4l2_capture_create(const struct lp_v4l2_settings *settings,
			   const struct lp_v4l2_target *target, struct lp_v4l2_capture **capture);

/* Frames and states go to the host of `source`, which must outlive the capture. */
int lp_v4l2_capture_start(struct lp_v4l2_capture *capture, struct lp_source *source);

/* As known at present: fully once the camera has been opened. */
void lp_v4l2_capture_caps(struct lp_v4l2_capture *capture, struct lp_source_caps *caps);

/* Given to the camera by the thread, now and whenever it is opened again. -EOPNOTSUPP, -EINVAL: the
 * camera that is open cannot; logged. */
int lp_v4l2_capture_set_exposure(struct lp_v4l2_capture *capture, float exposure_us, float gain);

/* Accepts NULL. Puts the camera's controls back. All frames must be back. */
void lp_v4l2_capture_destroy(struct lp_v4l2_capture *capture);

#endif
