/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The buffers of one open camera, mapped from the driver: a frame's picture is the driver's memory,
 * nothing is copied. A buffer is queued at the driver, dequeued as a frame, and queued again when
 * the frame is released. When the camera is unplugged, memory and descriptor stay until the last
 * frame is released.
 */
#ifndef LP_SOURCE_V4L2_STREAM_H
#define LP_SOURCE_V4L2_STREAM_H

#include <stdint.h>

#include "drivers/source/v4l2/offers.h"
#include "include/frame.h"

struct lp_v4l2_stream;

/*
 * Set format and rate, map buffers and start. Takes over `fd` (open, O_NONBLOCK) in every case.
 * -errno, and the call that failed in `*stage`; -EPROTO: the driver contradicts itself, `*stage`
 * says how.
 */
int lp_v4l2_stream_start(int fd, const struct lp_offer_choice *choice,
			 struct lp_v4l2_stream **stream, const char **stage);

int lp_v4l2_stream_fd(const struct lp_v4l2_stream *stream);

/*
 * Dequeue the oldest finished frame, for the caller to release. What the driver says is filled in:
 * picture, sequence (goes on over restarts), LP_FRAME_CORRUPT, t_arrival_ns, and in t_read_ns the
 * driver's time stamp (0: it gives none); exposure and gain are NAN. -EAGAIN: none. -ENODEV:
 * unplugged.
 */
int lp_v4l2_stream_dequeue(struct lp_v4l2_stream *stream, struct lp_frame **frame);

/* Stop and start: what cures a silent camera at first. Frames need not be back. */
int lp_v4l2_stream_restart(struct lp_v4l2_stream *stream);

/* Buffers that are queued: with none, the camera's silence is ours. */
int lp_v4l2_stream_queued(struct lp_v4l2_stream *stream);

/* Rate that the driver has agreed to; 0: it does not say. */
float lp_v4l2_stream_rate_hz(const struct lp_v4l2_stream *stream);

/* Accepts NULL. Stops; the rest goes when the last frame is back. */
void lp_v4l2_stream_stop(struct lp_v4l2_stream *stream);

#endif
