/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/capture.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "drivers/source/v4l2/capture_parts.h"
#include "drivers/source/v4l2/hotplug.h"
#include "drivers/source/v4l2/reset.h"
#include "drivers/source/v4l2/stream.h"

#define RETRY_FIRST_NS (100 * LP_NS_PER_MS)
#define RETRY_LONGEST_NS LP_NS_PER_S
/* What is wrong with the camera at hand does not change by itself: look again rarely. */
#define RETRY_UNFIT_NS (10 * LP_NS_PER_S)
#define RESET_FIRST_NS (2 * LP_NS_PER_S) /* between resets of the port; doubles */
#define RESET_LONGEST_NS (60 * LP_NS_PER_S)
/* Just plugged in, a node may not have its group yet: udevd gives it a moment later. */
#define PATIENT_ATTEMPTS 4

/* ---------------------------------------------------------------- shared by loop and thread */

bool lp_v4l2_is_stopped(struct lp_v4l2_capture *capture)
{
	bool stop;

	pthread_mutex_lock(&capture->lock);
	stop = capture->stop;
	pthread_mutex_unlock(&capture->lock);
	return stop;
}

void lp_v4l2_clear(int event_fd)
{
	uint64_t count;

	while (read(event_fd, &count, sizeof(count)) > 0) {
	}
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
	};

	if (controls && controls->exposure_settable) {
		caps.exposure_settable = true;
		caps.exposure_min_us = (float)controls->exposure.minimum * 100.0F;
		caps.exposure_max_us = (float)controls->exposure.maximum * 100.0F;
		caps.exposure_step_us = (float)controls->exposure.step * 100.0F;
		caps.gain_min = caps.gain_max = 1;
	}
	if (controls) {
		caps.tells_processing = controls->tells_processing;
		caps.processing_on = controls->processing.on;
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

/* ---------------------------------------------------------------- the thread: finding, waiting */

/* Wait for a node to appear or to change, for `wait_ns` at most, or for the end. */
static void wait_for_change(struct lp_v4l2_capture *self, int64_t wait_ns)
{
	struct pollfd fds[] = {{.fd = self->wake_fd, .events = POLLIN},
			       {.fd = self->hotplug_fd, .events = POLLIN}};
	const int64_t end_ns = lp_clock_ns() + wait_ns;
	int64_t left_ns;

	while (!lp_v4l2_is_stopped(self) && (left_ns = end_ns - lp_clock_ns()) > 0) {
		(void)poll(fds, 2, (int)(left_ns / LP_NS_PER_MS) + 1);
		lp_v4l2_clear(self->wake_fd);
		if (self->hotplug_fd >= 0 && lp_v4l2_hotplug_read(self->hotplug_fd)) {
			self->attempts = 0;
			lp_backoff_reset(&self->retry);
			return;
		}
	}
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

/* Report why there is no node to use. */
static void report_absence(struct lp_v4l2_capture *self, const char *reason)
{
	const struct lp_v4l2_target *target = &self->target;
	char object[LP_V4L2_NAME_BYTES + 8];

	snprintf(object, sizeof(object), "v4l2: %s",
		 self->is_known	 ? self->known.path
		 : *target->text ? target->text
				 : "any");
	if (!self->is_known && target->kind == LP_V4L2_PATH && access(target->text, F_OK) == 0)
		lp_source_outbox_report(
			self->outbox, LP_SOURCE_DOWN, object, "find",
			"not a capture device — v4l2-ctl --list-devices shows what is");
	else
		lp_source_outbox_report(self->outbox, LP_SOURCE_WAITING, object, "find", "%s",
					reason);
}

/* The one of the first `count` nodes that is to be used; NULL: reported why there is none. */
static const struct lp_v4l2_node *choose(struct lp_v4l2_capture *self, int count)
{
	char reason[400];
	const int found =
		lp_v4l2_nodes_select(self->nodes, count, &self->target,
				     self->is_known ? &self->known : NULL, reason, sizeof(reason));

	if (found >= 0)
		return &self->nodes[found];
	report_absence(self, reason);
	return NULL;
}

/* Is this the passing refusal of a node that has only just appeared? */
static bool is_passing(const struct lp_v4l2_capture *self, int error)
{
	return self->attempts < PATIENT_ATTEMPTS &&
	       (error == -EACCES || error == -EPERM || error == -ENOENT);
}

/* The camera could not be opened. Returns how long to wait before the next attempt. */
static int64_t report_failure(struct lp_v4l2_capture *self, const struct lp_v4l2_session *session,
			      const struct lp_v4l2_fault *fault, int error)
{
	if (!is_passing(self, error))
		lp_source_outbox_report(self->outbox, fault->state, session->object, fault->stage,
					"%s", fault->reason);
	if (fault->state == LP_SOURCE_STALLED)
		reset_port(self, &session->node, session->object);
	return fault->state == LP_SOURCE_DOWN ? RETRY_UNFIT_NS : lp_backoff_next_ns(&self->retry);
}

static void use_camera(struct lp_v4l2_capture *self, struct lp_v4l2_session *session)
{
	enum lp_v4l2_outcome outcome;

	self->known = session->node;
	self->is_known = true;
	lp_processing_tell(&session->controls.processing,
			   self->settings.processing == LP_PROCESSING_KEEP, &self->processing_told,
			   session->object);
	set_caps(self, session);
	outcome = lp_v4l2_run(self, session);
	set_caps(self, NULL);
	if (outcome == LP_V4L2_UNPLUGGED)
		(void)choose(self, 0);
	else if (outcome == LP_V4L2_HUNG)
		lp_source_outbox_report(self->outbox, LP_SOURCE_STALLED, session->object, "stream",
					"no usable frames: opening the camera anew");
	lp_v4l2_session_close(session);
	if (outcome == LP_V4L2_HUNG)
		reset_port(self, &session->node, session->object);
}

/* One attempt at the camera, and its use if it succeeds. Returns how long to wait before the next.
 */
static int64_t attempt(struct lp_v4l2_capture *self)
{
	const struct lp_v4l2_node *node =
		choose(self, lp_v4l2_nodes_read("/sys", self->nodes, LP_V4L2_MAX_NODES));
	struct lp_v4l2_session session;
	struct lp_v4l2_fault fault;
	int ret;

	if (!node)
		return lp_backoff_next_ns(&self->retry);
	self->attempts++;
	ret = lp_v4l2_session_open(&session, node, &self->settings, &fault);
	if (ret < 0)
		return report_failure(self, &session, &fault, ret);
	use_camera(self, &session);
	return lp_backoff_next_ns(&self->retry);
}

static void *capture_main(void *argument)
{
	struct lp_v4l2_capture *self = argument;

	while (!lp_v4l2_is_stopped(self)) {
		const int64_t wait_ns = attempt(self);

		wait_for_change(self, wait_ns);
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
			 "%g: the scale of this camera's gain steps is unknown — set gain_unity in "
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
