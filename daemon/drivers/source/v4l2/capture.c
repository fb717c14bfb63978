/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/capture.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "drivers/source/v4l2/hotplug.h"
#include "drivers/source/v4l2/nodes.h"
#include "drivers/source/outbox.h"
#include "drivers/source/v4l2/reset.h"
#include "drivers/source/v4l2/session.h"
#include "drivers/source/v4l2/stream.h"
#include "drivers/source/exposure_guess.h"
#include "include/frame.h"

#define RETRY_FIRST_NS (100 * LP_NS_PER_MS)
#define RETRY_LONGEST_NS LP_NS_PER_S
#define FIRST_FRAME_NS (5 * LP_NS_PER_S) /* cameras take their time to start */
#define RESET_FIRST_NS (2 * LP_NS_PER_S) /* between resets of the port; doubles */
#define RESET_LONGEST_NS (60 * LP_NS_PER_S)
#define STALL_PERIODS 4
/* Just plugged in, a node may not have its group yet: udevd gives it a moment later. */
#define PATIENT_ATTEMPTS 4

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
	bool gain_settable;
	float wanted_exposure_us, wanted_gain; /* NAN: nothing has been asked for */
	unsigned wish;			       /* raised by every new wanted exposure */

	/* The thread's own. */
	struct lp_v4l2_node nodes[LP_V4L2_MAX_NODES];
	struct lp_v4l2_node known; /* the camera in use, once there was one */
	bool is_known;
	enum lp_source_state told; /* last state told */
	int attempts;		   /* to open it since it was plugged in */
	struct lp_backoff retry, reset;
	int64_t next_reset_ns;
};

/* ---------------------------------------------------------------- towards the loop */

__attribute__((format(printf, 6, 7))) static void
tell(struct lp_v4l2_capture *self, enum lp_log_level level, enum lp_source_state state,
     const char *object, const char *stage, const char *format, ...)
{
	char reason[400];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(reason, sizeof(reason), format, arguments);
	va_end(arguments);
	lp_log(level, object, stage, "%s", reason);
	self->told = state;
	lp_source_outbox_tell(self->outbox, state, object, stage, reason);
}

static bool is_stopped(struct lp_v4l2_capture *self)
{
	bool stop;

	pthread_mutex_lock(&self->lock);
	stop = self->stop;
	pthread_mutex_unlock(&self->lock);
	return stop;
}

static void set_caps(struct lp_v4l2_capture *self, const struct lp_v4l2_session *session)
{
	const struct lp_v4l2_controls *controls = session ? &session->controls : NULL;
	struct lp_source_caps caps = {
		.exposure_min_us = NAN,
		.exposure_max_us = NAN,
		.gain_min = NAN,
		.gain_max = NAN,
		.exposure_delay_frames = self->settings.exposure_delay_frames,
		.frame_rate_hz = session ? lp_v4l2_stream_rate_hz(session->stream) : 0,
	};

	if (controls && controls->exposure_settable) {
		caps.exposure_settable = true;
		caps.exposure_min_us = (float)controls->exposure.minimum * 100.0F;
		caps.exposure_max_us = (float)controls->exposure.maximum * 100.0F;
		caps.exposure_step_us = (float)controls->exposure.step * 100.0F;
		caps.gain_min = caps.gain_max = 1;
	}
	if (controls && controls->gain_settable && controls->gain_unity > 0) {
		caps.gain_min = (float)controls->gain.minimum / controls->gain_unity;
		caps.gain_max = (float)controls->gain.maximum / controls->gain_unity;
	}
	pthread_mutex_lock(&self->lock);
	self->caps = caps;
	self->open = session != NULL;
	pthread_mutex_unlock(&self->lock);
}

/* ---------------------------------------------------------------- while the camera streams */

/* One stream, from open to close. */
struct run {
	struct lp_v4l2_session session;
	struct lp_exposure_guess guess;
	unsigned wish;	   /* the last wanted exposure that was commanded */
	int64_t silent_ns; /* since when: the last frame, or the last start */
	bool has_frames;   /* since the last start */
	bool restarted;	   /* because of silence, without success so far */
};

enum outcome { STOPPED, UNPLUGGED, HUNG };

static void command_exposure(struct lp_v4l2_capture *self, struct run *run)
{
	struct lp_v4l2_controls *controls = &run->session.controls;
	float exposure_us, gain;
	unsigned wish;

	pthread_mutex_lock(&self->lock);
	wish = self->wish;
	exposure_us = self->wanted_exposure_us;
	gain = self->wanted_gain;
	pthread_mutex_unlock(&self->lock);
	if (wish == run->wish)
		return;
	run->wish = wish;
	if (!controls->exposure_settable)
		return;
	(void)lp_v4l2_controls_set_exposure(controls, lp_v4l2_stream_fd(run->session.stream),
					    exposure_us, gain);
	if (controls->exposure_us != run->guess.exposure_us ||
	    controls->linear_gain != run->guess.gain)
		lp_exposure_guess_command(&run->guess, controls->exposure_us, controls->linear_gain,
					  lp_clock_ns());
}

static void deliver(struct lp_v4l2_capture *self, struct run *run, struct lp_frame *frame)
{
	lp_exposure_guess_frame(&run->guess, frame);
	run->silent_ns = frame->t_arrival_ns;
	if (!(frame->flags & LP_FRAME_CORRUPT)) {
		run->has_frames = true;
		run->restarted = false;
		lp_backoff_reset(&self->reset);
		lp_backoff_reset(&self->retry);
		if (self->told != LP_SOURCE_STREAMING)
			tell(self, LP_LOG_INFO, LP_SOURCE_STREAMING, run->session.object, "stream",
			     "frames arrive");
	}
	lp_source_outbox_send(self->outbox, frame);
}

/* 0, or what the driver says: -ENODEV when the camera has gone. */
static int take_frames(struct lp_v4l2_capture *self, struct run *run)
{
	struct lp_frame *frame;
	int ret;

	while ((ret = lp_v4l2_stream_take(run->session.stream, &frame)) == 0)
		deliver(self, run, frame);
	return ret == -EAGAIN ? 0 : ret;
}

/* How long the camera may be silent before something is done. */
static int64_t patience_ns(const struct lp_v4l2_capture *self, const struct run *run)
{
	const float rate_hz = lp_v4l2_stream_rate_hz(run->session.stream);
	int64_t limit_ns = (int64_t)((double)self->settings.stall_ms * (double)LP_NS_PER_MS);

	if (rate_hz > 0 && (double)limit_ns < STALL_PERIODS * (double)LP_NS_PER_S / (double)rate_hz)
		limit_ns = (int64_t)(STALL_PERIODS * (double)LP_NS_PER_S / (double)rate_hz);
	if (!run->has_frames && !run->restarted && limit_ns < FIRST_FRAME_NS)
		limit_ns = FIRST_FRAME_NS;
	return limit_ns;
}

/* The camera has been silent for too long. False: it does not even take a restart. */
static bool wake_camera(struct lp_v4l2_capture *self, struct run *run)
{
	const int64_t silence_ms = (lp_clock_ns() - run->silent_ns) / LP_NS_PER_MS;

	run->silent_ns = lp_clock_ns();
	if (lp_v4l2_stream_queued(run->session.stream) == 0)
		return true; /* no buffer to fill: the silence is ours */
	if (run->restarted)
		return false;
	tell(self, LP_LOG_WARNING, LP_SOURCE_STALLED, run->session.object, "stream",
	     "no frame for %lld ms: restarting the stream", (long long)silence_ms);
	run->restarted = true;
	run->has_frames = false;
	return lp_v4l2_stream_restart(run->session.stream) == 0;
}

static void clear(int fd)
{
	uint64_t count;

	while (read(fd, &count, sizeof(count)) > 0) {
	}
}

static enum outcome stream(struct lp_v4l2_capture *self, struct run *run)
{
	struct pollfd fds[] = {
		{.fd = lp_v4l2_stream_fd(run->session.stream), .events = POLLIN},
		{.fd = self->wake_fd, .events = POLLIN},
	};
	int ret = 0;

	while (!is_stopped(self)) {
		const int64_t left_ns = run->silent_ns + patience_ns(self, run) - lp_clock_ns();

		if (left_ns <= 0) {
			if (!wake_camera(self, run))
				return HUNG;
			continue;
		}
		(void)poll(fds, 2, (int)(left_ns / LP_NS_PER_MS) + 1);
		clear(self->wake_fd);
		command_exposure(self, run);
		ret = take_frames(self, run);
		if (ret == -ENODEV)
			return UNPLUGGED;
		if (ret < 0 || (fds[0].revents & (POLLERR | POLLHUP)))
			return HUNG;
	}
	return STOPPED;
}

/* ---------------------------------------------------------------- while it does not */

/* Wait for a new node, for `wait_ns` (-1: only that), or for the end. */
static void wait_for_change(struct lp_v4l2_capture *self, int64_t wait_ns)
{
	struct pollfd fds[] = {{.fd = self->wake_fd, .events = POLLIN},
			       {.fd = self->hotplug_fd, .events = POLLIN}};
	const int64_t end_ns = lp_clock_ns() + wait_ns;
	int64_t left_ns;

	while (!is_stopped(self)) {
		left_ns = wait_ns < 0 ? -1 : end_ns - lp_clock_ns();
		if (wait_ns >= 0 && left_ns <= 0)
			return;
		(void)poll(fds, 2, wait_ns < 0 ? -1 : (int)(left_ns / LP_NS_PER_MS) + 1);
		clear(self->wake_fd);
		if (self->hotplug_fd >= 0 && lp_v4l2_hotplug_read(self->hotplug_fd)) {
			self->attempts = 0;
			lp_backoff_reset(&self->retry);
			return;
		}
	}
}

static void back_off(struct lp_v4l2_capture *self, enum lp_source_state state)
{
	/* What is wrong with the camera at hand does not change by itself. */
	if (state == LP_SOURCE_DOWN && self->hotplug_fd >= 0) {
		wait_for_change(self, -1);
		return;
	}
	wait_for_change(self, lp_backoff_next_ns(&self->retry));
}

/* Reset the port of a camera that hangs, at growing intervals. */
static void reset_port(struct lp_v4l2_capture *self, const struct lp_v4l2_node *node,
		       const char *object)
{
	int ret;

	if (!self->settings.reset || !node->usb || lp_clock_ns() < self->next_reset_ns)
		return;
	ret = lp_v4l2_reset_port(node);
	self->next_reset_ns = lp_clock_ns() + lp_backoff_next_ns(&self->reset);
	if (ret == 0)
		lp_warning(object, "reset", "the camera hung: its USB port %s has been reset",
			   node->port);
	else if (ret == -EACCES)
		lp_warning(object, "reset",
			   "the camera hangs, and its USB port may not be reset — install "
			   "packaging/udev/70-lightprobe.rules, or replug the camera");
	else
		lp_warning(object, "reset", "the camera hangs; resetting its USB port: %s",
			   lp_strerror(ret));
}

/* The node to use; NULL: told why not. */
static const struct lp_v4l2_node *find(struct lp_v4l2_capture *self)
{
	const int count = lp_v4l2_nodes_read("/sys", self->nodes, LP_V4L2_MAX_NODES);
	enum lp_source_state state = LP_SOURCE_WAITING;
	char object[LP_V4L2_NAME_BYTES + 8], reason[400];
	const int found =
		lp_v4l2_nodes_select(self->nodes, count, &self->target,
				     self->is_known ? &self->known : NULL, reason, sizeof(reason));

	if (found >= 0)
		return &self->nodes[found];
	if (self->told == LP_SOURCE_WAITING)
		return NULL;
	snprintf(object, sizeof(object), "v4l2: %s",
		 *self->target.text ? self->target.text : "any");
	if (self->target.kind == LP_V4L2_PATH && !self->is_known &&
	    access(self->target.text, F_OK) == 0)
		state = LP_SOURCE_DOWN;
	tell(self, LP_LOG_WARNING, state, object, "find", "%s",
	     state == LP_SOURCE_DOWN
		     ? "not a capture device — v4l2-ctl --list-devices shows what is"
		     : reason);
	return NULL;
}

/* Is this the passing refusal of a node that has only just appeared? */
static bool is_passing(const struct lp_v4l2_capture *self, int error)
{
	return self->attempts < PATIENT_ATTEMPTS &&
	       (error == -EACCES || error == -EPERM || error == -ENOENT);
}

static int open_camera(struct lp_v4l2_capture *self, struct run *run)
{
	const struct lp_v4l2_node *node = find(self);
	struct lp_v4l2_fault fault;
	int ret;

	if (!node)
		return -ENODEV;
	self->attempts++;
	*run = (struct run){0};
	ret = lp_v4l2_session_open(&run->session, node, &self->settings, &fault);
	if (ret < 0) {
		if (!is_passing(self, ret))
			tell(self, LP_LOG_ERROR, fault.state, run->session.object, fault.stage,
			     "%s", fault.reason);
		if (fault.state == LP_SOURCE_STALLED)
			reset_port(self, node, run->session.object);
		return ret;
	}
	self->known = *node;
	self->is_known = true;
	lp_exposure_guess_init(&run->guess, self->settings.exposure_delay_frames);
	lp_exposure_guess_command(&run->guess, run->session.controls.exposure_us,
				  run->session.controls.linear_gain, lp_clock_ns());
	run->silent_ns = lp_clock_ns();
	return 0;
}

static void use_camera(struct lp_v4l2_capture *self, struct run *run)
{
	enum outcome outcome;

	set_caps(self, &run->session);
	command_exposure(self, run);
	outcome = stream(self, run);
	set_caps(self, NULL);
	if (outcome == UNPLUGGED)
		tell(self, LP_LOG_WARNING, LP_SOURCE_WAITING, run->session.object, "stream",
		     "unplugged: waiting for it to come back");
	lp_v4l2_session_close(&run->session);
	if (outcome == HUNG) {
		tell(self, LP_LOG_WARNING, LP_SOURCE_STALLED, run->session.object, "stream",
		     "no frames: opening the camera anew");
		reset_port(self, &run->session.node, run->session.object);
	}
}

static void *capture_main(void *argument)
{
	struct lp_v4l2_capture *self = argument;
	struct run run;

	while (!is_stopped(self)) {
		if (open_camera(self, &run) == 0)
			use_camera(self, &run);
		if (!is_stopped(self))
			back_off(self, self->told);
	}
	return NULL;
}

/* ---------------------------------------------------------------- on the loop thread */

static void wake(struct lp_v4l2_capture *self)
{
	const uint64_t one = 1;

	(void)!write(self->wake_fd, &one, sizeof(one));
}

int lp_v4l2_capture_create(const struct lp_v4l2_settings *settings,
			   const struct lp_v4l2_target *target, struct lp_v4l2_capture **capture)
{
	struct lp_v4l2_capture *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self)
		return ret;
	self->settings = *settings;
	self->target = *target;
	self->wanted_exposure_us = self->wanted_gain = NAN;
	self->retry =
		(struct lp_backoff){.first_ns = RETRY_FIRST_NS, .longest_ns = RETRY_LONGEST_NS};
	self->reset =
		(struct lp_backoff){.first_ns = RESET_FIRST_NS, .longest_ns = RESET_LONGEST_NS};
	pthread_mutex_init(&self->lock, NULL);
	self->hotplug_fd = lp_v4l2_hotplug_open();
	self->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (self->wake_fd < 0)
		ret = -errno;
	self->outbox = lp_source_outbox_create();
	if (self->wake_fd < 0 || !self->outbox) {
		lp_v4l2_capture_destroy(self);
		return ret;
	}
	set_caps(self, NULL);
	*capture = self;
	return 0;
}

int lp_v4l2_capture_start(struct lp_v4l2_capture *capture, struct lp_source *source)
{
	int ret = lp_source_outbox_start(capture->outbox, source);

	if (ret == 0)
		ret = -pthread_create(&capture->thread, NULL, capture_main, capture);
	if (ret < 0)
		lp_error("v4l2", "start", "%s", lp_strerror(ret));
	capture->thread_runs = ret == 0;
	return ret;
}

void lp_v4l2_capture_caps(struct lp_v4l2_capture *capture, struct lp_source_caps *caps)
{
	pthread_mutex_lock(&capture->lock);
	*caps = capture->caps;
	pthread_mutex_unlock(&capture->lock);
}

int lp_v4l2_capture_set_exposure(struct lp_v4l2_capture *capture, float exposure_us, float gain)
{
	const bool gain_known = capture->settings.gain_unity > 0;
	bool refused;

	if (gain != 1 && !gain_known) {
		lp_error("v4l2", "gain",
			 "%g: what this camera's gain steps mean is not known — set gain_unity in "
			 "its camera file",
			 (double)gain);
		return -EINVAL;
	}
	pthread_mutex_lock(&capture->lock);
	refused = capture->open && !capture->caps.exposure_settable;
	if (!refused) {
		capture->wanted_exposure_us = exposure_us;
		capture->wanted_gain = gain;
		capture->wish++;
	}
	pthread_mutex_unlock(&capture->lock);
	if (refused) {
		lp_error("v4l2", "exposure", "this camera's exposure cannot be set");
		return -EOPNOTSUPP;
	}
	wake(capture);
	return 0;
}

void lp_v4l2_capture_destroy(struct lp_v4l2_capture *capture)
{
	if (!capture)
		return;
	pthread_mutex_lock(&capture->lock);
	capture->stop = true;
	pthread_mutex_unlock(&capture->lock);
	lp_source_outbox_close(capture->outbox);
	if (capture->thread_runs) {
		wake(capture);
		pthread_join(capture->thread, NULL);
	}
	lp_source_outbox_destroy(capture->outbox);
	if (capture->hotplug_fd >= 0)
		close(capture->hotplug_fd);
	if (capture->wake_fd >= 0)
		close(capture->wake_fd);
	pthread_mutex_destroy(&capture->lock);
	free(capture);
}
