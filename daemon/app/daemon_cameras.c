/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's cameras: one source of frames each, all into one worker. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "app/backends.h"
#include "app/daemon_parts.h"
#include "app/options/fixed_exposure.h"
#include "app/rig.h"
#include "app/run/service.h"
#include "base/log.h"
#include "include/processing.h"

/* ---------------------------------------------------------------- what comes from them */

/* By how much the shortest time between two frames grows with each further one. */
#define PERIOD_FORGOTTEN 1.02F

/* The shortest time between two of the last frames: where one is lost it is longer. */
static void note_period(struct lp_daemon_camera *camera, struct lp_frame *frame)
{
	const float passed_us = 1e-3F * (float)(frame->t_read_ns - camera->t_read_ns);

	if (camera->t_read_ns && passed_us > 0.0F && !frame->clock_fault)
		camera->period_us = fminf(camera->period_us * PERIOD_FORGOTTEN, passed_us);
	camera->t_read_ns = frame->clock_fault ? 0 : frame->t_read_ns;
	frame->period_us = isfinite(camera->period_us) ? camera->period_us : NAN;
}

/* The driver has looked at the clock, and has logged what is wrong with it. */
static void tell_clock(struct lp_daemon_camera *camera, const char *fault)
{
	char text[sizeof(((struct lp_fault *)NULL)->text)];

	if (camera->clock_fault == fault)
		return;
	camera->clock_fault = fault;
	(void)snprintf(text, sizeof(text), "%s: clock: %s: the time of arrival counts instead",
		       camera->uri, fault ? fault : "");
	lp_health_camera_fault(&camera->daemon->health, "camera-clock", camera->index,
			       fault ? text : NULL);
}

static void on_frame(void *context, struct lp_frame *frame)
{
	struct lp_daemon_camera *camera = context;
	struct lp_daemon *daemon = camera->daemon;

	daemon->health.report.frames_received++;
	/* A smaller number is that of a camera that has come back. */
	if (camera->has_frames && frame->sequence > camera->next_sequence)
		daemon->frames_lost += frame->sequence - camera->next_sequence;
	camera->next_sequence = frame->sequence + 1;
	camera->has_frames = true;
	frame->camera = (uint8_t)camera->index;
	if (isnan(frame->row_time_us))
		frame->row_time_us = 1e3F * camera->file->read_out_ms / (float)frame->height_px;
	note_period(camera, frame);
	tell_clock(camera, frame->clock_fault);
	lp_instruments_frame(daemon->instruments, frame);
}

static void on_corrupt_frame(void *context)
{
	struct lp_daemon_camera *camera = context;

	camera->daemon->health.report.frames_received++;
	camera->daemon->frames_corrupt++;
	camera->next_sequence++; /* it is no gap */
}

/* Whoever has it has logged it. */
static void on_fault(void *context, const char *id, const char *text)
{
	struct lp_daemon_camera *camera = context;

	lp_health_camera_fault(&camera->daemon->health, id, camera->index, text);
}

/* What is wrong with the source, for health messages. */
static void set_fault(struct lp_daemon_camera *camera, const char *reason)
{
	const enum lp_source_state state = camera->state;

	on_fault(camera, "source-waiting", state == LP_SOURCE_WAITING ? reason : NULL);
	on_fault(camera, "source-stalled", state == LP_SOURCE_STALLED ? reason : NULL);
	on_fault(camera, "source-down", state == LP_SOURCE_DOWN ? reason : NULL);
}

/* A fixed exposure if one is asked for; else the worker makes brackets, where the camera can. */
static void begin_exposures(struct lp_daemon_camera *camera)
{
	const struct lp_options *options = camera->daemon->options;
	const struct lp_source_caps *caps = &camera->caps;
	const struct lp_camera_control control = {.camera = camera->index,
						  .settable = caps->exposure_settable &&
							      camera->source->ops->set_exposure &&
							      options->exposure_us <= 0,
						  .reports_exposure = caps->reports_exposure,
						  .limits = lp_bracket_limits_of(caps)};

	if (options->exposure_us > 0)
		lp_fixed_exposure_command(camera->source, caps, options->exposure_us, options->gain,
					  camera->uri);
	lp_worker_control(camera->daemon->worker, &control);
}

/* STREAMING as long as one of them does; else as the first one. */
static enum lp_source_state state_of_all(const struct lp_daemon *daemon)
{
	for (int k = 0; k < daemon->camera_count; k++)
		if (daemon->cameras[k].state == LP_SOURCE_STREAMING)
			return LP_SOURCE_STREAMING;
	return daemon->cameras[0].state;
}

/* The others go on without it. */
static void lose(struct lp_daemon_camera *camera)
{
	const struct lp_camera_control lost = {.camera = camera->index, .lost = true};

	if (camera->daemon->camera_count > 1 && camera->has_streamed &&
	    !camera->daemon->options->once)
		lp_worker_control(camera->daemon->worker, &lost);
}

/* Names of what is in the set, for messages; "nothing" for none. */
static const char *names_of(uint32_t processing, char *text, size_t size_bytes)
{
	(void)snprintf(text, size_bytes, processing ? "" : "nothing");
	for (int kind = 0; kind < LP_PROCESSING_KINDS; kind++) {
		const size_t length = strlen(text);

		if (processing & LP_PROCESSING_BIT(kind))
			(void)snprintf(text + length, size_bytes - length, "%s%s",
				       length ? ", " : "", lp_processing_name(kind));
	}
	return text;
}

/* The camera file was measured with other processing than the camera does now. */
static void compare_processing(struct lp_daemon_camera *camera)
{
	const struct lp_camera_file *file = camera->file;
	const uint32_t on = camera->caps.processing_on;
	char then[160], now[160], reason[440], text[sizeof(reason) + 300];
	const bool differs =
		file->tells_processing && camera->caps.tells_processing && file->processing != on;

	if (differs) {
		(void)snprintf(reason, sizeof(reason),
			       "the camera file's response was measured with %s on, now it is %s "
			       "— set processing=keep, or lightprobe calibrate response",
			       names_of(file->processing, then, sizeof(then)),
			       names_of(on, now, sizeof(now)));
		(void)snprintf(text, sizeof(text), "%s: processing: %s", camera->uri, reason);
		lp_warning(camera->uri, "processing", "%s", reason);
	}
	on_fault(camera, "camera-processing", differs ? text : NULL);
}

/* What any camera does to its pictures; of one that is away, what it did. */
static void tell_processing(struct lp_daemon_camera *camera)
{
	struct lp_daemon *daemon = camera->daemon;
	uint32_t on = 0;

	compare_processing(camera);
	for (int k = 0; k < daemon->camera_count; k++)
		on |= daemon->cameras[k].caps.processing_on;
	lp_hub_processing(daemon->hub, on);
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	static const char *const names[] = {"unknown",	 "down",    "waiting",
					    "streaming", "stalled", "ended"};
	struct lp_daemon_camera *camera = context;
	struct lp_daemon *daemon = camera->daemon;
	char status[256];

	if (state == LP_SOURCE_STREAMING && camera->has_streamed &&
	    camera->state != LP_SOURCE_STALLED)
		daemon->health.report.source_reconnects++;
	camera->has_streamed |= state == LP_SOURCE_STREAMING;
	camera->state = state;
	daemon->health.report.source_state = state_of_all(daemon);
	set_fault(camera, reason);
	(void)snprintf(status, sizeof(status), "source %s %s", names[state], reason);
	lp_service_status(status);
	if (state == LP_SOURCE_STREAMING) {
		camera->source->ops->caps(camera->source, &camera->caps);
		tell_processing(camera);
		begin_exposures(camera);
	} else {
		lose(camera);
	}
	if (state == LP_SOURCE_DOWN && daemon->options->once)
		lp_daemon_begin_ending(daemon, LP_EXIT_FAILURE);
}

int lp_daemon_on_stills(void *context, const char **reason)
{
	struct lp_daemon *daemon = context;
	int able = 0, asked = 0;

	for (int k = 0; k < daemon->camera_count; k++) {
		const struct lp_daemon_camera *camera = &daemon->cameras[k];

		if (!camera->source->ops->take_stills)
			continue;
		able++;
		if (camera->state != LP_SOURCE_STREAMING)
			continue;
		camera->source->ops->take_stills(camera->source);
		asked++;
	}
	*reason = able ? "no camera for stills is ready — health says what it waits for"
		       : "this probe has no camera for stills — start lightprobed with a second "
			 "--source=ptp:";
	return asked ? asked : able ? -EAGAIN : -ENODEV;
}

/* ---------------------------------------------------------------- life */

/* What can be wrong with several of them. */
static int check(const struct lp_options *options)
{
	const struct lp_camera_texts *sources = &options->source;

	if (sources->count && options->camera.count > sources->count) {
		lp_error(options->camera.texts[sources->count], "--camera",
			 "%d camera files for %d sources — name one for each --source, in the same "
			 "order",
			 options->camera.count, sources->count);
		return -EINVAL;
	}
	if (sources->count < 2)
		return 0;
	if (options->camera.count != sources->count) {
		lp_error(sources->texts[options->camera.count], "--camera",
			 "%d sources, but %d camera files — name one for each --source, in the "
			 "same order: it says where in the box the camera looks",
			 sources->count, options->camera.count);
		return -EINVAL;
	}
	for (int k = 1; k < sources->count; k++)
		for (int other = 0; other < k; other++)
			if (strcmp(sources->texts[k], sources->texts[other]) == 0) {
				lp_error(
					sources->texts[k], "--source",
					"is named twice — each --source is a camera of its own: "
					"name two of the same kind by path, port or serial number");
				return -EINVAL;
			}
	if (*options->rotator || options->polarizer.mode != LP_POLARIZER_OFF) {
		lp_error("lightprobed", "--rotator",
			 "a polarizer needs one camera — leave out --rotator and --polarizer, or "
			 "all but one --source");
		return -EINVAL;
	}
	return 0;
}

static int open_camera(struct lp_daemon_camera *camera)
{
	const struct lp_options *options = camera->daemon->options;
	struct lp_camera_profile profile;
	const struct lp_source_host host = {.context = camera,
					    .loop = camera->daemon->loop,
					    .once = options->once,
					    .frame = on_frame,
					    .corrupt = on_corrupt_frame,
					    .state = on_state,
					    .fault = on_fault,
					    .camera = &profile};
	int ret = lp_camera_file_read(lp_options_camera(options, camera->index), &camera->file);

	if (ret < 0)
		return ret;
	profile = lp_camera_file_profile(camera->file);
	ret = lp_source_open(camera->uri, &host, &camera->source);
	if (ret < 0)
		return ret;
	camera->source->ops->caps(camera->source, &camera->caps);
	if (options->exposure_us > 0 && !camera->source->ops->set_exposure) {
		lp_error(camera->uri, "--exposure-us", "the exposure of this source cannot be set");
		return -EINVAL;
	}
	if (camera->caps.has_poses &&
	    lp_options_pipeline(options).orientation != LP_ORIENTATION_FRAMES)
		lp_warning(camera->uri, "--orientation",
			   "its recorded poses are not used — add --orientation=frames");
	return 0;
}

static int check_rig(const struct lp_daemon *daemon)
{
	const struct lp_camera_file *files[LP_MAX_CAMERAS];

	for (int k = 0; k < daemon->camera_count; k++)
		files[k] = daemon->cameras[k].file;
	return lp_rig_check(files, daemon->camera_count);
}

int lp_daemon_create_cameras(struct lp_daemon *daemon)
{
	const struct lp_options *options = daemon->options;
	int ret = check(options);

	if (ret == 0 && !options->source.count && (!*options->ring || options->once)) {
		lp_error("lightprobed", "--source",
			 "no source is given — name a camera with --source=URI, or a ring of light "
			 "sensors alone with --ring=URI; lightprobed --help lists the kinds");
		return -EINVAL;
	}
	if (ret == 0 && !options->source.count) /* its photometry serves the ring, too */
		ret = lp_camera_file_read(lp_options_camera(options, 0), &daemon->cameras[0].file);
	for (int k = 0; k < options->source.count && ret == 0; k++) {
		struct lp_daemon_camera *camera = &daemon->cameras[daemon->camera_count++];

		*camera = (struct lp_daemon_camera){.daemon = daemon,
						    .index = k,
						    .period_us = INFINITY,
						    .uri = options->source.texts[k]};
		ret = open_camera(camera);
	}
	return ret < 0 ? ret : check_rig(daemon);
}

int lp_daemon_start_cameras(struct lp_daemon *daemon)
{
	int ret = 0;

	for (int k = 0; k < daemon->camera_count && ret == 0; k++) {
		struct lp_source *source = daemon->cameras[k].source;

		ret = source->ops->start(source);
	}
	return ret;
}

void lp_daemon_destroy_sources(struct lp_daemon *daemon)
{
	for (int k = 0; k < daemon->camera_count; k++) {
		struct lp_source *source = daemon->cameras[k].source;

		if (source)
			source->ops->destroy(source);
	}
}

void lp_daemon_destroy_camera_files(struct lp_daemon *daemon)
{
	for (int k = 0; k < LP_MAX_CAMERAS; k++)
		lp_camera_file_destroy(daemon->cameras[k].file);
}
