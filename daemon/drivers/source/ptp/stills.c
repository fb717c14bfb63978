/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/stills.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/pool.h"
#include "base/stop.h"
#include "drivers/source/formats.h"
#include "drivers/source/frames.h"
#include "drivers/source/outbox.h"
#include "drivers/source/photo.h"
#include "drivers/source/ptp/camera.h"

#define FRAMES (LP_FRAMES_HELD + LP_PTP_MOST_EXPOSURES) /* at work, and a set that waits */
#define RETRY_FIRST_NS (200 * LP_NS_PER_MS)
#define RETRY_LONGEST_NS (4 * LP_NS_PER_S)
#define RETRY_UNFIT_NS (10 * LP_NS_PER_S)
#define EVENT_MS 100
#define BUSY_US 100000
#define BUSY_PATIENCE_NS (20 * LP_NS_PER_S)
/* A still is developed, stitched and written before it is announced. */
#define STILL_PATIENCE_NS (15 * LP_NS_PER_S)
/* What a camera takes to end a set, when told to. */
#define CUT_PATIENCE_NS (5 * LP_NS_PER_S)
/* Exif rounds: 1/3 of a stop is the next value of the camera. */
#define SAME_STOPS 0.15F

struct lp_ptp_stills {
	struct lp_ptp_settings settings;
	struct lp_source_outbox *outbox;
	struct lp_pool *frames;
	struct lp_stop stop;
	pthread_t thread;
	bool thread_runs;
	atomic_bool is_asked; /* for a set before its time */

	/* The thread's own. */
	struct lp_ptp_camera camera;
	struct lp_backoff retry;
	uint64_t sequence; /* of the next frame */
	bool warned;	   /* of exposures that are not those asked for */
};

/* One multi-bracket. */
struct set {
	struct lp_ptp_stills *stills;
	int64_t begun_ns; /* when the camera took the command */
	int64_t moved_ns; /* when it last showed that it goes on */
	int taken;	  /* stills announced */
	int usable;
	bool is_complete;  /* the camera says so */
	bool is_cut_short; /* told to stop: what still comes is not wanted */
};

/* ---------------------------------------------------------------- one still */

static uint8_t *reserve(void *context, size_t size_bytes)
{
	struct lp_owned_frame *owned = context;

	return lp_owned_frame_reserve(owned, size_bytes) == 0 ? owned->buffer : NULL;
}

/* When the exposure of the still began, as well as that is known: the camera takes one after the
 * other. */
static int64_t start_ns(const struct set *set)
{
	const struct lp_ptp_camera *camera = &set->stills->camera;
	int64_t t_ns = set->begun_ns;

	for (int i = 0; i < set->taken && i < camera->exposure_count; i++)
		t_ns += (int64_t)((double)camera->exposures_us[i] * LP_NS_PER_US);
	return t_ns;
}

/* What the picture says of its exposure counts; else what the camera was told. */
static void fill_exposure(struct set *set, struct lp_frame *frame)
{
	struct lp_ptp_stills *self = set->stills;
	const struct lp_ptp_camera *camera = &self->camera;
	const struct lp_photo photo = lp_photo_read(frame->data, frame->size_bytes);
	const int k = set->taken < camera->exposure_count ? set->taken : camera->exposure_count - 1;
	const float asked_us = camera->exposures_us[k];

	frame->crop = photo.crop;
	frame->exposure_us = isnan(photo.exposure_us) ? asked_us : photo.exposure_us;
	frame->gain = photo.iso ? (float)photo.iso / (float)camera->iso : 1.0F;
	frame->t_read_ns += (int64_t)((double)frame->exposure_us * LP_NS_PER_US);
	if (frame->t_read_ns > frame->t_arrival_ns)
		frame->t_read_ns = frame->t_arrival_ns;
	if (!self->warned &&
	    fabsf(log2f(frame->exposure_us * frame->gain / asked_us)) > SAME_STOPS) {
		self->warned = true;
		lp_warning(camera->object, "exposure",
			   "%g us at gain %g instead of %g us: what the picture says counts",
			   (double)frame->exposure_us, (double)frame->gain, (double)asked_us);
	}
}

static void fill_frame(struct set *set, struct lp_frame *frame, size_t size_bytes)
{
	struct lp_picture picture;

	frame->format = LP_FORMAT_MJPEG;
	frame->size_bytes = size_bytes;
	frame->sequence = set->stills->sequence++;
	frame->t_read_ns = start_ns(set);
	frame->t_arrival_ns = lp_clock_ns();
	frame->flags = LP_FRAME_STILL;
	if (lp_picture_next(LP_ENCODING_JPEG, 0, 0, frame->data, size_bytes, true, &picture) != 1 ||
	    picture.corrupt || picture.skip_bytes) {
		frame->flags |= LP_FRAME_CORRUPT;
		return;
	}
	/* a preview or a movie's data may follow the picture */
	frame->size_bytes = picture.encoded_bytes;
	frame->width_px = picture.width_px;
	frame->height_px = picture.height_px;
	fill_exposure(set, frame);
}

/* Wait for a camera that is busy, and ask again; false: there is no use, or no need. */
static bool wait_while_busy(struct set *set, int ret, int64_t since_ns, struct lp_ptp_fault *fault)
{
	const bool goes_on = lp_stop_wait_until(&set->stills->stop, 0);
	const int64_t patience_ns = goes_on ? BUSY_PATIENCE_NS : CUT_PATIENCE_NS;

	if (ret != -EAGAIN)
		return false;
	if (lp_clock_ns() - since_ns > patience_ns) {
		(void)lp_ptp_fail(fault, ret, LP_SOURCE_STALLED, "stills",
				  "the camera has been busy for %lld s: beginning again",
				  (long long)(patience_ns / LP_NS_PER_S));
		return false;
	}
	usleep(BUSY_US);
	return true;
}

static int fetch(struct set *set, uint32_t object, struct lp_ptp_fault *fault)
{
	struct lp_ptp_stills *self = set->stills;
	struct lp_owned_frame *owned = lp_owned_frame_take(self->frames, false);
	struct lp_ptp_sink sink = {.context = owned, .reserve = reserve};
	const int64_t since_ns = lp_clock_ns();
	int ret;

	if (!owned) { /* all are at work: a gap in the numbers, which the host counts */
		self->sequence++;
		return 0;
	}
	do
		ret = lp_ptp_camera_fetch(&self->camera, object, &sink, fault);
	while (wait_while_busy(set, ret, since_ns, fault));
	if (ret < 0) {
		lp_frame_release(&owned->frame);
		return ret;
	}
	fill_frame(set, &owned->frame, sink.size_bytes);
	set->usable += !(owned->frame.flags & LP_FRAME_CORRUPT);
	lp_debug(self->camera.object, "still", "%ux%u, %zu bytes, %g us", owned->frame.width_px,
		 owned->frame.height_px, sink.size_bytes, (double)owned->frame.exposure_us);
	lp_source_outbox_send(self->outbox, &owned->frame, self->camera.object);
	return 0;
}

static int take(struct set *set, uint32_t object, struct lp_ptp_fault *fault)
{
	struct lp_ptp_stills *self = set->stills;
	int64_t since_ns = lp_clock_ns();
	int ret;

	do
		ret = lp_ptp_camera_look(&self->camera, object, fault);
	while (wait_while_busy(set, ret, since_ns, fault));
	if (ret <= 0) /* a folder, or another file */
		return ret;
	ret = set->is_cut_short ? 0 : fetch(set, object, fault);
	set->taken++;
	since_ns = lp_clock_ns();
	while (ret == 0 && !self->settings.keep) {
		ret = lp_ptp_camera_delete(&self->camera, object, fault);
		if (!wait_while_busy(set, ret, since_ns, fault))
			break;
		ret = 0;
	}
	set->moved_ns = lp_clock_ns();
	return ret;
}

/* ---------------------------------------------------------------- one set */

static int on_event(struct set *set, const struct lp_ptp_event *event, struct lp_ptp_fault *fault)
{
	switch (event->code) {
	case LP_PTP_OBJECT_ADDED:
		return take(set, event->parameter, fault);
	case LP_PTP_CAPTURE_COMPLETE:
		set->is_complete = true;
		set->moved_ns = lp_clock_ns();
		return 0;
	case LP_PTP_EVENT_STORE_FULL:
		return lp_ptp_fail(fault, -ENOSPC, LP_SOURCE_STALLED, "stills",
				   "its storage is full — delete pictures in it");
	default:
		return 0;
	}
}

static int64_t patience_ns(const struct set *set)
{
	const struct lp_ptp_camera *camera = &set->stills->camera;
	double exposed_us = 0.0;

	for (int i = 0; i < camera->exposure_count; i++)
		exposed_us += (double)camera->exposures_us[i];
	if (set->is_cut_short)
		return CUT_PATIENCE_NS;
	return STILL_PATIENCE_NS + (set->is_complete ? 0 : (int64_t)(exposed_us * LP_NS_PER_US));
}

static int begin_set(struct set *set, struct lp_ptp_fault *fault)
{
	const int64_t since_ns = lp_clock_ns();
	int ret;

	do
		ret = lp_ptp_camera_shoot(&set->stills->camera, fault);
	while (wait_while_busy(set, ret, since_ns, fault));
	set->begun_ns = set->moved_ns = lp_clock_ns();
	return ret;
}

/* Nothing of it shall stay behind in the camera. */
static void cut_short(struct set *set)
{
	struct lp_ptp_camera *camera = &set->stills->camera;

	set->is_cut_short = true;
	camera->session.stop = NULL;
	set->moved_ns = lp_clock_ns();
	lp_ptp_camera_terminate(camera);
}

/* The next event of the set. 0; -errno with `*fault`. */
static int go_on(struct set *set, struct lp_ptp_fault *fault)
{
	struct lp_ptp_camera *camera = &set->stills->camera;
	struct lp_ptp_event event;
	int ret = lp_ptp_event(&camera->session, EVENT_MS, &event);

	if (ret == -ECANCELED) {
		cut_short(set);
		return 0;
	}
	if (ret < 0)
		return lp_ptp_camera_fail(camera, ret, "stills", fault);
	if (ret > 0)
		ret = on_event(set, &event, fault);
	if (ret < 0 || lp_clock_ns() - set->moved_ns <= patience_ns(set))
		return ret < 0 ? ret : 0;
	return lp_ptp_fail(fault, -EIO, LP_SOURCE_STALLED, "stills",
			   "%d of %d came: beginning again", set->taken, camera->exposure_count);
}

static int take_set(struct lp_ptp_stills *self, struct lp_ptp_fault *fault)
{
	const int wanted = self->camera.exposure_count;
	struct set set = {.stills = self};
	int ret = begin_set(&set, fault);

	while (ret == 0 && !(set.is_complete && (set.is_cut_short || set.taken >= wanted)))
		ret = go_on(&set, fault);
	if (set.is_cut_short)
		return -ECANCELED;
	if (ret == 0 && set.usable == 0)
		lp_source_outbox_report(self->outbox, LP_SOURCE_STALLED, self->camera.object,
					"stills", "only corrupt stills");
	return ret;
}

/* ---------------------------------------------------------------- the thread */

static int64_t report(struct lp_ptp_stills *self, const struct lp_ptp_fault *fault)
{
	lp_source_outbox_report(self->outbox, fault->state, self->camera.object, fault->stage, "%s",
				fault->reason);
	return fault->state == LP_SOURCE_DOWN ? RETRY_UNFIT_NS : lp_backoff_next_ns(&self->retry);
}

/* Until the next set is due or asked for; sees that the camera is unplugged meanwhile. */
static int idle_until(struct lp_ptp_stills *self, int64_t due_ns, struct lp_ptp_fault *fault)
{
	while (lp_clock_ns() < due_ns && !atomic_load(&self->is_asked)) {
		struct lp_ptp_event event;
		const int ret = lp_ptp_event(&self->camera.session, EVENT_MS, &event);

		if (ret < 0)
			return lp_ptp_camera_fail(&self->camera, ret, "wait", fault);
	}
	return lp_stop_wait_until(&self->stop, 0) ? 0 : -ECANCELED;
}

static int run(struct lp_ptp_stills *self, struct lp_ptp_fault *fault)
{
	const int64_t period_ns = (int64_t)((double)self->settings.every_s * (double)LP_NS_PER_S);
	int ret = 0;

	while (ret == 0) {
		const int64_t begun_ns = lp_clock_ns();

		atomic_store(&self->is_asked, false); /* this is the one */
		ret = take_set(self, fault);
		if (ret < 0)
			return ret;
		lp_backoff_reset(&self->retry);
		ret = idle_until(self, period_ns ? begun_ns + period_ns : INT64_MAX, fault);
	}
	return ret;
}

/* One attempt at the camera, and its use if it succeeds. Returns how long to wait before the next.
 */
static int64_t attempt(struct lp_ptp_stills *self)
{
	struct lp_ptp_port *port;
	struct lp_ptp_fault fault;
	int ret = lp_ptp_usb_open(&self->settings, &port, &fault);

	if (ret < 0)
		return report(self, &fault);
	ret = lp_ptp_camera_open(&self->camera, port, &self->stop, &fault);
	if (ret == 0)
		ret = run(self, &fault);
	/* A camera that is only silent may have heard; one that comes back keeps what is saved. */
	lp_ptp_camera_close(&self->camera, ret == -ECANCELED || fault.state == LP_SOURCE_DOWN ||
						   ret == -EREMOTEIO || ret == -EAGAIN);
	port->ops->close(port);
	return ret == -ECANCELED ? 0 : report(self, &fault);
}

static void *stills_main(void *argument)
{
	struct lp_ptp_stills *self = argument;
	int64_t due_ns = 0;

	lp_ptp_camera_init(&self->camera, &self->settings);
	while (lp_stop_wait_until(&self->stop, due_ns))
		due_ns = attempt(self) + lp_clock_ns();
	return NULL;
}

/* ---------------------------------------------------------------- on the loop thread */

int lp_ptp_stills_create(const struct lp_ptp_settings *settings, struct lp_ptp_stills **stills)
{
	struct lp_ptp_stills *self = calloc(1, sizeof(*self));

	if (!self)
		return -ENOMEM;
	self->settings = *settings;
	self->retry =
		(struct lp_backoff){.first_ns = RETRY_FIRST_NS, .longest_ns = RETRY_LONGEST_NS};
	lp_stop_init(&self->stop);
	self->outbox = lp_source_outbox_create();
	self->frames = lp_owned_frames_create(FRAMES);
	if (!self->outbox || !self->frames) {
		lp_error("ptp", "create", "out of memory or descriptors");
		lp_ptp_stills_destroy(self);
		return -ENOMEM;
	}
	*stills = self;
	return 0;
}

int lp_ptp_stills_start(struct lp_ptp_stills *stills, struct lp_source *source)
{
	int ret = lp_source_outbox_start(stills->outbox, source);

	if (ret == 0)
		ret = -pthread_create(&stills->thread, NULL, stills_main, stills);
	if (ret < 0)
		lp_error("ptp", "start", "%s", lp_strerror(ret));
	stills->thread_runs = ret == 0;
	return ret;
}

void lp_ptp_stills_take(struct lp_ptp_stills *stills)
{
	atomic_store(&stills->is_asked, true);
}

void lp_ptp_stills_destroy(struct lp_ptp_stills *stills)
{
	if (!stills)
		return;
	lp_stop_ask(&stills->stop);
	lp_source_outbox_close(stills->outbox);
	if (stills->thread_runs)
		pthread_join(stills->thread, NULL);
	lp_source_outbox_destroy(stills->outbox);
	lp_pool_destroy(stills->frames);
	lp_stop_finish(&stills->stop);
	free(stills);
}
