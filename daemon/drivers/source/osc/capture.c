/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/capture.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/pool.h"
#include "drivers/source/frames.h"
#include "drivers/source/osc/capture_parts.h"

#define FRAMES (LP_FRAMES_HELD + 4) /* waiting for the worker, on their way, being filled */
#define RETRY_FIRST_NS (200 * LP_NS_PER_MS)
#define RETRY_LONGEST_NS (2 * LP_NS_PER_S)
/* What is wrong with this camera does not change by itself: look again rarely. */
#define RETRY_UNFIT_NS (10 * LP_NS_PER_S)
#define RESTORE_NS (4 * LP_NS_PER_S)

/* ---------------------------------------------------------------- shared by loop and thread */

bool lp_osc_is_stopped(struct lp_osc_capture *capture)
{
	bool stop;

	pthread_mutex_lock(&capture->lock);
	stop = capture->stop;
	pthread_mutex_unlock(&capture->lock);
	return stop;
}

static void set_caps(struct lp_osc_capture *self, const struct lp_osc_camera *camera)
{
	const int delay = self->settings.exposure_delay_frames;
	struct lp_source_caps caps = {
		.exposure_min_us = NAN,
		.exposure_max_us = NAN,
		.gain_min = NAN,
		.gain_max = NAN,
		.exposure_delay_frames = delay >= 0 ? delay : LP_OSC_LONGEST_DELAY_FRAMES,
	};

	if (camera) {
		caps.tells_processing = true;
		caps.processing_on = camera->processing.on;
	}
	if (camera && camera->exposure_settable) {
		const struct lp_osc_exposures *range = &camera->range;
		const float base_iso = (float)range->base_iso;

		caps.exposure_settable = true;
		/* Set a second before the live preview begins (AFTER_OPTIONS_NS). */
		caps.in_force_us = camera->exposure_us * camera->gain;
		caps.exposure_count = range->exposure_count;
		memcpy(caps.exposures_us, range->exposures_us, sizeof(caps.exposures_us));
		caps.exposure_min_us = caps.exposures_us[0];
		caps.exposure_max_us = caps.exposures_us[caps.exposure_count - 1];
		caps.gain_min = (float)range->isos[0] / base_iso;
		caps.gain_max = (float)range->isos[range->iso_count - 1] / base_iso;
	}
	pthread_mutex_lock(&self->lock);
	self->caps = caps;
	self->open = camera != NULL;
	pthread_mutex_unlock(&self->lock);
}

/* ---------------------------------------------------------------- the thread: connecting */

int64_t lp_osc_report(struct lp_osc_capture *capture, const struct lp_osc_fault *fault)
{
	lp_source_outbox_report(capture->outbox, fault->state, capture->camera.object, fault->stage,
				"%s", fault->reason);
	return fault->state == LP_SOURCE_DOWN ? RETRY_UNFIT_NS
					      : lp_backoff_next_ns(&capture->retry);
}

/* One attempt at the camera, and its use if it succeeds. Returns how long to wait before the next.
 */
static int64_t attempt(struct lp_osc_capture *self)
{
	struct lp_osc_fault fault;
	const int ret = lp_osc_camera_open(&self->camera, &fault);
	int64_t wait_ns;

	if (ret == -ECANCELED)
		return 0;
	if (ret < 0)
		return lp_osc_report(self, &fault);
	set_caps(self, &self->camera);
	wait_ns = lp_osc_run(self);
	lp_osc_http_stream_close(self->http);
	set_caps(self, NULL);
	return wait_ns;
}

static void wait(struct lp_osc_capture *self, int64_t wait_ns)
{
	const int64_t end_ns = lp_clock_ns() + wait_ns;
	int64_t left_ns;

	while (!lp_osc_is_stopped(self) && (left_ns = end_ns - lp_clock_ns()) > 0)
		lp_osc_http_turn(self->http, (int)(left_ns / LP_NS_PER_MS) + 1);
}

static void *capture_main(void *argument)
{
	struct lp_osc_capture *self = argument;

	lp_osc_camera_init(&self->camera, &self->settings, self->http);
	while (!lp_osc_is_stopped(self))
		wait(self, attempt(self));
	lp_osc_camera_restore(&self->camera, RESTORE_NS);
	lp_osc_camera_finish(&self->camera);
	return NULL;
}

/* ---------------------------------------------------------------- on the loop thread */

int lp_osc_capture_create(const struct lp_osc_settings *settings, struct lp_osc_capture **capture)
{
	struct lp_osc_capture *self = calloc(1, sizeof(*self));
	char base[300];

	if (!self)
		return -ENOMEM;
	self->settings = *settings;
	self->wanted_exposure_us = self->wanted_gain = NAN;
	self->retry =
		(struct lp_backoff){.first_ns = RETRY_FIRST_NS, .longest_ns = RETRY_LONGEST_NS};
	pthread_mutex_init(&self->lock, NULL);
	(void)snprintf(base, sizeof(base), "http://%s:%d", settings->host, settings->port);
	self->http = lp_osc_http_create(base, &settings->login);
	self->outbox = lp_source_outbox_create();
	self->frames = lp_owned_frames_create(FRAMES);
	if (!self->http || !self->outbox || !self->frames) {
		lp_error("osc", "create", "out of memory or descriptors");
		lp_osc_capture_destroy(self);
		return -ENOMEM;
	}
	set_caps(self, NULL);
	*capture = self;
	return 0;
}

int lp_osc_capture_start(struct lp_osc_capture *capture, struct lp_source *source)
{
	int ret = lp_source_outbox_start(capture->outbox, source);

	if (ret == 0)
		ret = -pthread_create(&capture->thread, NULL, capture_main, capture);
	if (ret < 0)
		lp_error("osc", "start", "%s", lp_strerror(ret));
	capture->thread_runs = ret == 0;
	return ret;
}

void lp_osc_capture_caps(struct lp_osc_capture *capture, struct lp_source_caps *caps)
{
	pthread_mutex_lock(&capture->lock);
	*caps = capture->caps;
	pthread_mutex_unlock(&capture->lock);
}

int lp_osc_capture_set_exposure(struct lp_osc_capture *capture, float exposure_us, float gain)
{
	bool refused;

	pthread_mutex_lock(&capture->lock);
	refused = capture->open && !capture->caps.exposure_settable;
	if (!refused) {
		capture->wanted_exposure_us = exposure_us;
		capture->wanted_gain = gain;
		capture->wish++;
	}
	pthread_mutex_unlock(&capture->lock);
	if (refused) {
		lp_error("osc", "exposure", "this camera's exposure cannot be set");
		return -EOPNOTSUPP;
	}
	lp_osc_http_wake(capture->http);
	return 0;
}

void lp_osc_capture_destroy(struct lp_osc_capture *capture)
{
	if (!capture)
		return;
	pthread_mutex_lock(&capture->lock);
	capture->stop = true;
	pthread_mutex_unlock(&capture->lock);
	lp_source_outbox_close(capture->outbox);
	if (capture->http)
		lp_osc_http_cancel(capture->http);
	if (capture->thread_runs)
		pthread_join(capture->thread, NULL);
	lp_source_outbox_destroy(capture->outbox);
	lp_osc_http_destroy(capture->http);
	lp_pool_destroy(capture->frames);
	pthread_mutex_destroy(&capture->lock);
	explicit_bzero(&capture->settings.login, sizeof(capture->settings.login));
	free(capture);
}
