/* SPDX-License-Identifier: Apache-2.0 */
/* While the camera streams: frames to the loop, exposures to the camera, and what to do about
 * silence. */
#include <errno.h>
#include <poll.h>

#include "base/clock.h"
#include "drivers/source/exposure_guess.h"
#include "drivers/source/v4l2/capture_parts.h"
#include "drivers/source/v4l2/stream.h"
#include "include/frame.h"

#define FIRST_FRAME_NS (5 * LP_NS_PER_S) /* cameras take their time to start */
#define STALL_PERIODS 4
#define UNPLUGGING_NS (300 * LP_NS_PER_MS)

/* One stream, from open to close. */
struct run {
	struct lp_v4l2_session *session;
	struct lp_exposure_guess guess;
	unsigned wish;	   /* the last wanted exposure that was commanded */
	int64_t silent_ns; /* since when there is no usable frame, or the last start */
	bool has_corrupt;  /* frames since then */
	bool has_frames;   /* usable ones, since the last start */
	bool restarted;	   /* because of silence, without success so far */
	int64_t gone_ns;   /* when a control was not answered; 0: all were */
};

static void command_exposure(struct lp_v4l2_capture *capture, struct run *run)
{
	struct lp_v4l2_controls *controls = &run->session->controls;
	float exposure_us, gain;
	unsigned wish;

	pthread_mutex_lock(&capture->lock);
	wish = capture->wish;
	exposure_us = capture->wanted_exposure_us;
	gain = capture->wanted_gain;
	pthread_mutex_unlock(&capture->lock);
	if (wish == run->wish)
		return;
	run->wish = wish;
	if (!controls->exposure_settable)
		return;
	(void)lp_v4l2_controls_set_exposure(controls, exposure_us, gain);
	if (controls->exposure_us != run->guess.exposure_us ||
	    controls->linear_gain != run->guess.gain)
		lp_exposure_guess_command(&run->guess, controls->exposure_us, controls->linear_gain,
					  lp_clock_ns());
}

static void deliver(struct lp_v4l2_capture *capture, struct run *run, struct lp_frame *frame)
{
	lp_frame_clock_stamp(&capture->clock, frame, frame->t_read_ns, run->session->object);
	lp_exposure_guess_frame(&run->guess, frame);
	if (frame->flags & LP_FRAME_CORRUPT) {
		run->has_corrupt = true;
	} else {
		run->silent_ns = frame->t_arrival_ns;
		run->has_corrupt = false;
		run->has_frames = true;
		run->restarted = false;
		lp_backoff_reset(&capture->reset);
		lp_backoff_reset(&capture->retry);
	}
	lp_source_outbox_send(capture->outbox, frame, run->session->object);
}

/* 0, or what the driver says: -ENODEV when the camera has gone. */
static int take_frames(struct lp_v4l2_capture *capture, struct run *run)
{
	struct lp_frame *frame;
	int ret;

	while ((ret = lp_v4l2_stream_dequeue(run->session->stream, &frame)) == 0)
		deliver(capture, run, frame);
	return ret == -EAGAIN ? 0 : ret;
}

/* How long the camera may be without usable frames before something is done. */
static int64_t patience_ns(const struct lp_v4l2_capture *capture, const struct run *run)
{
	const float rate_hz = lp_v4l2_stream_rate_hz(run->session->stream);
	int64_t limit_ns = (int64_t)((double)capture->settings.stall_ms * (double)LP_NS_PER_MS);

	if (rate_hz > 0 && (double)limit_ns < STALL_PERIODS * (double)LP_NS_PER_S / (double)rate_hz)
		limit_ns = (int64_t)(STALL_PERIODS * (double)LP_NS_PER_S / (double)rate_hz);
	if (!run->has_frames && !run->restarted && limit_ns < FIRST_FRAME_NS)
		limit_ns = FIRST_FRAME_NS;
	return limit_ns;
}

/* No usable frame for too long: restart the stream. False: that has not helped, or is refused. */
static bool wake_camera(struct lp_v4l2_capture *capture, struct run *run)
{
	const long long patience_ms = patience_ns(capture, run) / LP_NS_PER_MS;
	const bool corrupt = run->has_corrupt;

	run->silent_ns = lp_clock_ns();
	run->has_corrupt = false;
	if (lp_v4l2_stream_queued(run->session->stream) == 0)
		return true; /* no buffer to fill: the silence is ours */
	if (run->restarted)
		return false;
	lp_source_outbox_report(capture->outbox, LP_SOURCE_STALLED, run->session->object, "stream",
				"%s for %lld ms: restarting the stream",
				corrupt ? "only corrupt frames" : "no frame", patience_ms);
	run->restarted = true;
	run->has_frames = false;
	return lp_v4l2_stream_restart(run->session->stream) == 0;
}

/* 0; or why the camera can be asked nothing more: it hangs. One that is being unplugged does not
 * answer either, a moment before the stream says so. */
static int answer_of_controls(struct run *run)
{
	const int gone = run->session->controls.gone;

	if (gone == 0)
		return 0;
	if (run->gone_ns == 0)
		run->gone_ns = lp_clock_ns();
	return lp_clock_ns() - run->gone_ns > UNPLUGGING_NS ? gone : 0;
}

/* How long to wait for a frame. */
static int64_t wait_ns(const struct lp_v4l2_capture *capture, const struct run *run)
{
	const int64_t left_ns = run->silent_ns + patience_ns(capture, run) - lp_clock_ns();

	return run->gone_ns && left_ns > UNPLUGGING_NS ? UNPLUGGING_NS : left_ns;
}

enum lp_v4l2_outcome lp_v4l2_run(struct lp_v4l2_capture *capture, struct lp_v4l2_session *session)
{
	const struct lp_v4l2_controls *controls = &session->controls;
	struct run run = {.session = session, .silent_ns = lp_clock_ns()};
	struct pollfd fds[] = {
		{.fd = lp_v4l2_stream_fd(session->stream), .events = POLLIN},
		{.fd = capture->wake_fd, .events = POLLIN},
	};

	lp_exposure_guess_init(&run.guess, capture->settings.exposure_delay_frames);
	lp_exposure_guess_command(&run.guess, controls->exposure_us, controls->linear_gain,
				  lp_clock_ns());
	command_exposure(capture, &run);
	while (!lp_v4l2_is_stopped(capture)) {
		const int64_t left_ns = wait_ns(capture, &run);
		int ret;

		if (left_ns <= 0) {
			if (controls->gone < 0 || !wake_camera(capture, &run))
				return LP_V4L2_HUNG;
			continue;
		}
		(void)poll(fds, 2, (int)(left_ns / LP_NS_PER_MS) + 1);
		lp_v4l2_clear(capture->wake_fd);
		command_exposure(capture, &run);
		ret = take_frames(capture, &run);
		if (ret == 0)
			ret = answer_of_controls(&run);
		if (ret == -ENODEV)
			return LP_V4L2_UNPLUGGED;
		if (ret < 0 || (fds[0].revents & (POLLERR | POLLHUP)))
			return LP_V4L2_HUNG;
	}
	return LP_V4L2_STOPPED;
}
