/* SPDX-License-Identifier: Apache-2.0 */
/* While the camera streams: frames to the loop, exposures to the camera, and what to do when the
 * live preview ends, falls silent, or is not given. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/pool.h"
#include "drivers/source/exposure_guess.h"
#include "drivers/source/formats.h"
#include "drivers/source/frames.h"
#include "drivers/source/osc/capture_parts.h"
#include "drivers/source/osc/multipart.h"
#include "include/frame.h"

#define FIRST_FRAME_NS (6 * LP_NS_PER_S) /* cameras take their time to start */
#define HEALTH_NS (10 * LP_NS_PER_S)	 /* how often the camera's health is asked for */
#define BUSY_NS (200 * LP_NS_PER_MS)	 /* after which a busy camera is asked again */
#define BUSY_PATIENCE_NS (5 * LP_NS_PER_S)
#define TURN_NS (200 * LP_NS_PER_MS)
#define GROW_BYTES ((size_t)64 << 10)
/* The battery is low below this, and no more above that. */
#define BATTERY_LOW 0.15F
#define BATTERY_ENOUGH 0.2F

enum command { COMMAND_NONE, COMMAND_EXPOSURE, COMMAND_HEALTH };

/* One live preview, from its request to its end. */
struct run {
	struct lp_osc_capture *capture;
	struct lp_osc_camera *camera;
	struct lp_multipart multipart;
	struct lp_exposure_guess guess;
	struct lp_owned_frame *filling; /* NULL: none */
	int64_t filling_ns;		/* when its first bytes came */
	enum command command;		/* under way */
	unsigned wish;			/* the last wanted exposure that was commanded */
	float commanded_us, commanded_gain;
	int64_t not_before_ns;	 /* the camera is busy until then */
	int64_t health_ns;	 /* when its health is to be asked for */
	int64_t begun_ns;	 /* when it was asked for the first time */
	int64_t silent_ns;	 /* since when there is no usable frame, or the start */
	bool has_corrupt;	 /* frames since then */
	bool has_frames;	 /* usable ones */
	bool has_shown_capture;	 /* the camera has been told to leave its other screen */
	struct lp_size other_px; /* that the pictures have instead of the chosen one; 0x0: not */
};

/* ---------------------------------------------------------------- pictures */

static uint8_t *reserve(void *context, size_t size_bytes)
{
	struct run *run = context;
	const size_t rounded = (size_bytes + GROW_BYTES - 1) / GROW_BYTES * GROW_BYTES;

	if (!run->filling) {
		run->filling = lp_owned_frame_take(run->capture->frames, false);
		run->filling_ns = lp_clock_ns();
	}
	if (run->filling && lp_owned_frame_reserve(run->filling, rounded) < 0) {
		lp_frame_release(&run->filling->frame);
		run->filling = NULL;
	}
	if (!run->filling) { /* all are at work: a gap in the numbers, which the host counts */
		run->capture->sequence++;
		return NULL;
	}
	return run->filling->buffer;
}

static bool look_at(const uint8_t *data, size_t size_bytes, struct lp_picture *picture)
{
	return lp_picture_next(LP_ENCODING_JPEG, 0, 0, data, size_bytes, true, picture) == 1 &&
	       !picture->corrupt && picture->skip_bytes == 0 &&
	       picture->encoded_bytes == size_bytes;
}

static bool is_whole(void *context, const uint8_t *data, size_t size_bytes)
{
	struct lp_picture picture;

	(void)context;
	return look_at(data, size_bytes, &picture);
}

static void fill_frame(struct run *run, struct lp_frame *frame, size_t size_bytes)
{
	const struct lp_offer_choice *choice = &run->camera->choice;
	struct lp_picture picture;
	const bool whole = look_at(frame->data, size_bytes, &picture);

	frame->format = LP_FORMAT_MJPEG;
	frame->width_px = choice->width_px;
	frame->height_px = choice->height_px;
	frame->size_bytes = size_bytes;
	frame->sequence = run->capture->sequence++;
	frame->t_read_ns = run->filling_ns;
	frame->t_arrival_ns = lp_clock_ns();
	if (!whole)
		frame->flags = LP_FRAME_CORRUPT;
	else if (picture.width_px != choice->width_px || picture.height_px != choice->height_px)
		run->other_px = (struct lp_size){picture.width_px, picture.height_px};
}

static void on_part(void *context, size_t size_bytes)
{
	struct run *run = context;
	struct lp_frame *frame = &run->filling->frame;

	run->filling = NULL;
	fill_frame(run, frame, size_bytes);
	lp_exposure_guess_frame(&run->guess, frame);
	if (run->other_px.width) {
		lp_frame_release(frame);
		return;
	}
	if (frame->flags & LP_FRAME_CORRUPT) {
		run->has_corrupt = true;
	} else {
		run->silent_ns = frame->t_arrival_ns;
		run->has_corrupt = false;
		run->has_frames = true;
		lp_backoff_reset(&run->capture->retry);
	}
	lp_source_outbox_send(run->capture->outbox, frame, run->camera->object);
}

static bool on_begin(void *context, const char *content_type)
{
	struct run *run = context;
	const struct lp_multipart_sink sink = {run, reserve, is_whole, on_part};

	return lp_multipart_init(&run->multipart, content_type, &sink) == 0;
}

static void on_data(void *context, const uint8_t *data, size_t size_bytes)
{
	lp_multipart_feed(&((struct run *)context)->multipart, data, size_bytes);
}

static int request_stream(struct run *run)
{
	static const char body[] = "{\"name\":\"camera.getLivePreview\"}";
	const struct lp_osc_stream_sink sink = {run, on_begin, on_data};

	run->silent_ns = lp_clock_ns();
	return lp_osc_http_stream(run->capture->http, "/osc/commands/execute", body, &sink);
}

/* ---------------------------------------------------------------- commands beside the stream */

static bool take_wish(struct run *run)
{
	struct lp_osc_capture *capture = run->capture;
	bool is_new;

	pthread_mutex_lock(&capture->lock);
	is_new = capture->wish != run->wish;
	run->wish = capture->wish;
	if (is_new) {
		run->commanded_us = capture->wanted_exposure_us;
		run->commanded_gain = capture->wanted_gain;
	}
	pthread_mutex_unlock(&capture->lock);
	return is_new && run->camera->exposure_settable && !isnan(run->commanded_us);
}

static void send_exposure(struct run *run)
{
	char *body;

	lp_osc_exposures_snap(&run->camera->range, &run->commanded_us, &run->commanded_gain);
	if (run->commanded_us == run->camera->exposure_us &&
	    run->commanded_gain == run->camera->gain)
		return;
	body = lp_osc_camera_exposure_body(run->camera, run->commanded_us, run->commanded_gain);
	if (body && lp_osc_http_begin(run->capture->http, "/osc/commands/execute", body) == 0) {
		run->command = COMMAND_EXPOSURE;
		/* It may take effect before its answer is here. */
		lp_exposure_guess_command(&run->guess, run->commanded_us, run->commanded_gain,
					  lp_clock_ns());
	}
	free(body);
}

static void begin_command(struct run *run)
{
	const int64_t now_ns = lp_clock_ns();

	if (run->command != COMMAND_NONE || now_ns < run->not_before_ns || !run->has_frames)
		return;
	if (take_wish(run)) {
		send_exposure(run);
	} else if (now_ns >= run->health_ns &&
		   lp_osc_http_begin(run->capture->http, "/osc/state", "") == 0) {
		run->command = COMMAND_HEALTH;
		run->health_ns = now_ns + HEALTH_NS;
	}
}

/* The newest wish is to be sent again. */
static void retry_exposure(struct run *run)
{
	run->wish--;
	run->not_before_ns = lp_clock_ns() + BUSY_NS;
}

static void end_exposure(struct run *run, int error, const struct lp_osc_reply *reply)
{
	struct lp_osc_fault fault;
	int ret = error;

	if (ret == 0)
		ret = lp_osc_reply_check(reply, "camera.setOptions",
					 *run->camera->settings->login.user, NULL, &fault);
	if (ret == 0) {
		run->camera->exposure_us = run->commanded_us;
		run->camera->gain = run->commanded_gain;
		lp_exposure_guess_late(&run->guess, lp_clock_ns());
		return;
	}
	if (ret == -EAGAIN || error < 0) { /* the camera is busy, or the network slow */
		retry_exposure(run);
		return;
	}
	lp_warning(run->camera->object, "exposure", "%g us: %s", (double)run->commanded_us,
		   fault.reason);
}

static void report_battery(struct lp_osc_capture *capture, const struct lp_osc_health *health)
{
	const float limit = capture->has_battery_fault ? BATTERY_ENOUGH : BATTERY_LOW;
	const bool is_low = health->battery < limit && !health->is_charging;

	if (is_low == capture->has_battery_fault ||
	    (isnan(health->battery) && !health->is_charging)) /* it does not tell now */
		return;
	capture->has_battery_fault = is_low;
	if (is_low)
		lp_source_outbox_fault(capture->outbox, "camera-battery", capture->camera.object,
				       "battery at %.0f %% — connect its power",
				       (double)health->battery * 100);
	else
		lp_source_outbox_fault(capture->outbox, "camera-battery", NULL, NULL);
}

static void report_heat(struct lp_osc_capture *capture, const struct lp_osc_health *health)
{
	const bool is_hot = strstr(health->error, "HIGH_TEMPERATURE") != NULL;

	if (is_hot == capture->has_heat_fault)
		return;
	capture->has_heat_fault = is_hot;
	if (is_hot)
		lp_source_outbox_fault(capture->outbox, "camera-hot", capture->camera.object,
				       "%s, board at %.0f °C — let it cool, or give it air",
				       health->error, (double)health->temperature_c);
	else
		lp_source_outbox_fault(capture->outbox, "camera-hot", NULL, NULL);
}

static void end_health(struct run *run, int error, const struct lp_osc_reply *reply)
{
	struct lp_osc_health health;

	if (error < 0 || !lp_osc_health_read(reply, &health))
		return;
	lp_debug(run->camera->object, "state", "battery %.0f %%%s, board %.0f °C %s",
		 (double)health.battery * 100, health.is_charging ? " (charging)" : "",
		 (double)health.temperature_c, health.error);
	report_battery(run->capture, &health);
	report_heat(run->capture, &health);
}

static void end_command(struct run *run)
{
	const enum command command = run->command;
	struct lp_osc_reply reply;
	int ret;

	if (command == COMMAND_NONE)
		return;
	ret = lp_osc_http_end(run->capture->http, &reply);
	if (ret == -EINPROGRESS)
		return;
	run->command = COMMAND_NONE;
	if (command == COMMAND_EXPOSURE)
		end_exposure(run, ret, &reply);
	else
		end_health(run, ret, &reply);
}

/* ---------------------------------------------------------------- the end of a stream */

/* The camera gives no live preview. 0: it is asked again; else why not, with the fault. */
static int answer_refusal(struct run *run, struct lp_osc_fault *fault)
{
	static const char stage[] = "camera.getLivePreview";
	struct lp_osc_reply reply;
	int ret;

	lp_osc_http_stream_reply(run->capture->http, &reply);
	ret = lp_osc_reply_check(&reply, stage, *run->camera->settings->login.user, NULL, fault);
	if (ret == 0) /* JSON without an error, or another kind of stream */
		return lp_osc_fail(
			fault, -EPROTO, LP_SOURCE_DOWN, stage,
			"the answer is no multipart stream — update the camera's firmware");
	if (ret == -EPERM && !run->has_shown_capture) {
		struct lp_osc_fault ignored;

		run->has_shown_capture = true;
		if (lp_osc_camera_show_capture(run->camera, &ignored) == 0)
			return request_stream(run);
	}
	if (ret == -EAGAIN && lp_clock_ns() - run->begun_ns < BUSY_PATIENCE_NS) {
		lp_osc_http_turn(run->capture->http, (int)(BUSY_NS / LP_NS_PER_MS));
		return request_stream(run);
	}
	return ret;
}

static int64_t patience_ns(const struct run *run)
{
	const int64_t limit_ns =
		(int64_t)((double)run->camera->settings->stall_ms * (double)LP_NS_PER_MS);

	return run->has_frames || limit_ns > FIRST_FRAME_NS ? limit_ns : FIRST_FRAME_NS;
}

/* 0: it goes on. Else why it ends, in `*fault`. */
static int check_stream(struct run *run, struct lp_osc_fault *fault)
{
	const struct lp_offer_choice *choice = &run->camera->choice;

	switch (lp_osc_http_stream_state(run->capture->http)) {
	case LP_OSC_STREAM_REFUSED:
		return answer_refusal(run, fault);
	case LP_OSC_STREAM_ENDED:
		return lp_osc_fail(fault, -EPIPE, LP_SOURCE_STALLED, "stream",
				   "ended by the camera (a button, a picture, a change of mode): "
				   "starting it again");
	case LP_OSC_STREAM_BROKEN:
		return lp_osc_network_fault(-EIO, "stream", fault);
	default:
		break;
	}
	if (run->other_px.width)
		return lp_osc_fail(fault, -EPIPE, LP_SOURCE_STALLED, "stream",
				   "pictures of %ux%u came instead of %ux%u: starting it again",
				   run->other_px.width, run->other_px.height, choice->width_px,
				   choice->height_px);
	if (lp_clock_ns() - run->silent_ns < patience_ns(run))
		return 0;
	return lp_osc_fail(fault, -ETIMEDOUT, LP_SOURCE_STALLED, "stream",
			   "%s for %lld ms: starting it again",
			   run->has_corrupt ? "only corrupt frames" : "no frame",
			   (long long)(patience_ns(run) / LP_NS_PER_MS));
}

static void finish(struct run *run)
{
	struct lp_osc_reply reply;

	/* The next command must not find this one's answer. */
	while (run->command != COMMAND_NONE &&
	       lp_osc_http_end(run->capture->http, &reply) == -EINPROGRESS)
		lp_osc_http_turn(run->capture->http, (int)(TURN_NS / LP_NS_PER_MS));
	lp_osc_http_stream_close(run->capture->http);
	if (run->filling)
		lp_frame_release(&run->filling->frame);
}

static void begin_guess(struct run *run)
{
	const int delay = run->camera->settings->exposure_delay_frames;

	lp_exposure_guess_init(&run->guess, delay);
	if (delay < 0)
		run->guess.longest_frames = LP_OSC_LONGEST_DELAY_FRAMES;
	lp_exposure_guess_command(&run->guess, run->camera->exposure_us, run->camera->gain,
				  lp_clock_ns());
	run->guess.pending = false; /* set a second ago, before this live preview was asked for */
}

int64_t lp_osc_run(struct lp_osc_capture *capture)
{
	struct run run = {.capture = capture,
			  .camera = &capture->camera,
			  .begun_ns = lp_clock_ns()};
	struct lp_osc_fault fault = {.state = 0};
	int ret;

	begin_guess(&run);
	ret = request_stream(&run);
	while (ret == 0 && !lp_osc_is_stopped(capture)) {
		begin_command(&run);
		lp_osc_http_turn(capture->http, (int)(TURN_NS / LP_NS_PER_MS));
		end_command(&run);
		ret = check_stream(&run, &fault);
	}
	finish(&run);
	if (ret == 0 || ret == -ECANCELED)
		return 0;
	if (fault.state == 0)
		(void)lp_osc_fail(&fault, ret, LP_SOURCE_STALLED, "stream", "%s", lp_strerror(ret));
	return lp_osc_report(capture, &fault);
}
