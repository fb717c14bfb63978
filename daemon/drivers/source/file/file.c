/* SPDX-License-Identifier: Apache-2.0 */
/*
 * file:PATH - pictures from a file or a folder, as a camera would deliver them. A thread of its own
 * reads and paces, because a large float picture takes longer to read than the loop may wait.
 */
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/param.h"
#include "base/pool.h"
#include "base/stop.h"
#include "base/uri.h"
#include "drivers/source/file/pose_file.h"
#include "drivers/source/file/reader.h"
#include "drivers/source/frames.h"
#include "drivers/source/outbox.h"
#include "include/source.h"

/* One being read, one read ahead, one waiting for the worker, and those it holds. */
#define FRAMES (LP_FRAMES_HELD + 3)
#define PATH_BYTES 1024

/* The query of the URI. `format` counts as enum lp_encoding. */
struct options {
	float rate_hz; /* 0: as fast as frames are taken */
	bool loop;
	int format;
	struct lp_size size_px; /* raw formats */
	struct lp_floats exposures_us, wheel_deg;
	float gain;
	char poses[PATH_BYTES];
	float pose_sigma_deg, pose_sigma_m;
};

static const char *const formats[] = {"auto", "mjpeg", "yuyv", "nv12", "grey", "pfm", "jpeg", NULL};

static const struct lp_param list[] = {
	{"rate", LP_PARAM_FLOAT, offsetof(struct options, rate_hz), .initial = "30", .max = 1000,
	 .help = "pictures a second; 0: as fast as the daemon can process them"},
	{"loop", LP_PARAM_BOOL, offsetof(struct options, loop), .initial = "1",
	 .help = "1: begin again after the last picture"},
	{"format", LP_PARAM_CHOICE, offsetof(struct options, format), .initial = "auto",
	 .choices = formats, .help = "auto: by name; jpeg: a photo; mjpeg: a stream of them"},
	{"size", LP_PARAM_SIZE, offsetof(struct options, size_px), .max = LP_PICTURE_MAX_SIDE_PX,
	 .help = "size of raw pictures (yuyv, nv12, grey), which do not contain it"},
	{"exposures_us", LP_PARAM_FLOATS, offsetof(struct options, exposures_us), .min = 0.001,
	 .max = 1e9, .help = "exposure of each picture, in turn; none: from Exif, else unknown"},
	{"wheel_deg", LP_PARAM_FLOATS, offsetof(struct options, wheel_deg), .max = 360,
	 .help = "angle of the polarizer in each picture, in turn; none: unknown"},
	{"gain", LP_PARAM_FLOAT, offsetof(struct options, gain), .min = 1e-6, .max = 1e6,
	 .help = "gain of all pictures, a linear factor; none: from Exif, else unknown"},
	{"poses", LP_PARAM_TEXT, offsetof(struct options, poses), .initial = "", .max = PATH_BYTES,
	 .help = "file of the camera's poses in TUM's or EuRoC's form, from the first\n"
		 "picture on: --orientation=frames; none: not known"},
	{"pose_sigma_deg", LP_PARAM_FLOAT, offsetof(struct options, pose_sigma_deg),
	 .initial = "0.3", .min = 0.001, .max = 90, .help = "1 sigma of their rotation"},
	{"pose_sigma_m", LP_PARAM_FLOAT, offsetof(struct options, pose_sigma_m), .initial = "0.01",
	 .max = 1000, .help = "1 sigma of their place along each axis; 0: they have no places"},
};
static const struct lp_params params = LP_PARAMS(list);

struct source_file {
	struct lp_source base;
	struct options options;
	char *path, *object; /* "file: PATH" */
	struct lp_file_reader *reader;
	struct lp_pose_file *poses; /* NULL: none */
	struct lp_pool *frames;
	struct lp_source_outbox *outbox;
	pthread_t thread;
	bool thread_runs;
	struct lp_stop stop;
};

static struct source_file *self_of(const struct lp_source *source)
{
	return (struct source_file *)source;
}

/* ---------------------------------------------------------------- the reading thread */

/* What the reading thread carries from picture to picture. */
struct progress {
	uint64_t sequence;
	int in_pass;		      /* pictures since the beginning of this pass */
	int usable_in_pass;	      /* without damage */
	int missing_in_pass;	      /* files that could not be read: poses have them */
	int64_t due_ns;		      /* of the next frame to deliver */
	struct lp_owned_frame *ahead; /* read, not delivered: it may turn out to be the last */
};

/* How the camera was turned, and where it was, in one of the pictures. */
static void stamp_pose(const struct source_file *self, int picture, struct lp_frame *frame)
{
	const double t_s = (double)picture / (double)self->options.rate_hz;

	if (!lp_pose_file_at(self->poses, t_s, frame->orientation, frame->position_m))
		return;
	frame->orientation_sigma_deg = self->options.pose_sigma_deg;
	frame->position_sigma_m = self->options.pose_sigma_m;
}

static void stamp(struct source_file *self, struct progress *progress, struct lp_frame *frame)
{
	const struct lp_floats *exposures = &self->options.exposures_us;
	const struct lp_floats *angles = &self->options.wheel_deg;

	frame->sequence = progress->sequence++;
	if (exposures->count > 0) {
		frame->gain = NAN; /* what is stated counts alone */
		frame->exposure_us = exposures->values[progress->in_pass % exposures->count];
	}
	if (!isnan(self->options.gain))
		frame->gain = self->options.gain;
	if (angles->count > 0) {
		frame->wheel_deg = angles->values[progress->in_pass % angles->count];
		frame->wheel_sigma_deg = LP_STATED_ANGLE_SIGMA_DEG;
	}
	if (self->poses)
		stamp_pose(self, progress->in_pass + progress->missing_in_pass, frame);
	progress->in_pass++;
	progress->usable_in_pass += !(frame->flags & LP_FRAME_CORRUPT);
}

/* Hand the frame read ahead to the loop, at its time. False: stop. */
static bool deliver(struct source_file *self, struct progress *progress)
{
	struct lp_frame *frame = &progress->ahead->frame;
	const int64_t now_ns = lp_clock_ns();

	if (self->options.rate_hz > 0) {
		if (progress->due_ns < now_ns) /* first one, or too late: no burst to catch up */
			progress->due_ns = now_ns;
		if (!lp_stop_wait_until(&self->stop, progress->due_ns))
			return false;
		progress->due_ns += (int64_t)((double)LP_NS_PER_S / self->options.rate_hz);
	}
	frame->t_arrival_ns = lp_clock_ns();
	frame->t_read_ns = frame->t_arrival_ns;
	progress->ahead = NULL;
	lp_source_outbox_send(self->outbox, frame, self->object);
	return true;
}

/*
 * Ends the stream. A `once` set of which a part failed is no set: it has no last frame. A loop ends
 * only when nothing can be read any more.
 */
static void finish(struct source_file *self, struct progress *progress, int failure)
{
	const bool ended =
		progress->ahead && !self->options.loop && !(failure < 0 && self->base.host.once);

	if (ended)
		progress->ahead->frame.flags |= LP_FRAME_LAST;
	if (progress->ahead && (ended || !self->base.host.once) && !deliver(self, progress))
		return;
	if (failure < 0 && self->base.host.once)
		lp_source_outbox_report(self->outbox, LP_SOURCE_DOWN, self->object, "read",
					"the set cannot be used (see above)");
	else if (ended && lp_source_outbox_last_state(self->outbox) == LP_SOURCE_STREAMING)
		lp_source_outbox_report(self->outbox, LP_SOURCE_ENDED, self->object, "read",
					"the last picture has been delivered");
	else
		lp_source_outbox_report(self->outbox, LP_SOURCE_DOWN, self->object, "read",
					"no usable picture (see above)");
}

/* Whoever numbers the files of a set numbers all of them. 0, or -EINVAL, logged. */
static int check_numbers(const struct source_file *self, int pictures)
{
	const struct {
		const char *name;
		size_t count;
	} given[] = {{"exposures_us", self->options.exposures_us.count},
		     {"wheel_deg", self->options.wheel_deg.count}};

	if (!self->base.host.once || lp_file_reader_files(self->reader) == 1)
		return 0;
	for (size_t i = 0; i < LP_COUNT(given); i++) {
		if (given[i].count == 0 || (size_t)pictures % given[i].count == 0)
			continue;
		lp_error(self->object, "read",
			 "%d pictures, but %zu numbers in %s: expected one for each", pictures,
			 given[i].count, given[i].name);
		return -EINVAL;
	}
	return 0;
}

static void begin_pass(struct source_file *self, struct progress *progress)
{
	if (progress->usable_in_pass == 0)
		lp_source_outbox_report(self->outbox, LP_SOURCE_STALLED, self->object, "read",
					"every picture is damaged");
	progress->in_pass = progress->usable_in_pass = progress->missing_in_pass = 0;
}

static void read_all(struct source_file *self, struct progress *progress)
{
	int failure = 0, ret;

	for (;;) {
		struct lp_owned_frame *frame = lp_owned_frame_take(self->frames, true);

		if (!frame)
			return;
		ret = lp_file_reader_next(self->reader, frame);
		if (ret != 1)
			lp_frame_release(&frame->frame);
		if (ret < 0) {
			failure = ret;
			progress->missing_in_pass++;
			continue;
		}
		if (ret == 0) {
			if (failure == 0)
				failure = check_numbers(self, progress->in_pass);
			if (!self->options.loop || progress->in_pass == 0)
				break;
			begin_pass(self, progress);
			continue;
		}
		stamp(self, progress, &frame->frame);
		if (progress->ahead && !deliver(self, progress)) {
			lp_frame_release(&frame->frame);
			return;
		}
		progress->ahead = frame;
	}
	finish(self, progress, failure);
}

static void *read_thread(void *argument)
{
	struct source_file *self = argument;
	struct progress progress = {0};

	read_all(self, &progress);
	if (progress.ahead)
		lp_frame_release(&progress.ahead->frame);
	return NULL;
}

/* ---------------------------------------------------------------- ops, on the loop thread */

static void file_destroy(struct lp_source *source)
{
	struct source_file *self = self_of(source);

	if (!source)
		return;
	lp_stop_ask(&self->stop);
	if (self->frames)
		lp_pool_close(self->frames);
	lp_source_outbox_close(self->outbox);
	if (self->thread_runs)
		pthread_join(self->thread, NULL);
	lp_source_outbox_destroy(self->outbox);
	lp_pool_destroy(self->frames);
	lp_file_reader_destroy(self->reader);
	lp_pose_file_destroy(self->poses);
	lp_stop_finish(&self->stop);
	free(self->object);
	free(self->path);
	free(self);
}

const struct lp_source_ops lp_source_file_ops;

static int file_create(const struct lp_uri *uri, const struct lp_source_host *host,
		       struct lp_source **source)
{
	struct source_file *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_file_ops, .host = *host};
	lp_stop_init(&self->stop);
	self->options.gain = NAN;
	ret = lp_uri_read(uri, &params, &self->options);
	if (ret < 0)
		goto err_destroy;
	if (!*uri->rest) {
		lp_error(uri->text, "parse", "no path — file:PATH, a picture file or a folder");
		ret = -EINVAL;
		goto err_destroy;
	}
	if (self->options.poses[0] && !(self->options.rate_hz > 0)) {
		lp_error(uri->text, "parse",
			 "poses needs a rate above 0: it tells when each picture was taken");
		ret = -EINVAL;
		goto err_destroy;
	}
	if (host->once) {
		if (self->options.poses[0])
			lp_warning(uri->text, "parse", "poses do not count with --once");
		self->options.poses[0] = '\0';
		self->options.loop = false;
		self->options.rate_hz = 0;
	}
	ret = -ENOMEM;
	self->path = strdup(uri->rest);
	self->frames = lp_owned_frames_create(FRAMES);
	self->outbox = lp_source_outbox_create();
	if (!self->path || !self->frames || !self->outbox ||
	    asprintf(&self->object, "file: %s", uri->rest) < 0)
		goto err_destroy;
	*source = &self->base;
	return 0;
err_destroy:
	file_destroy(&self->base);
	return ret;
}

static int file_start(struct lp_source *source)
{
	struct source_file *self = self_of(source);
	int ret = lp_file_reader_create(self->path, (enum lp_encoding)self->options.format,
					self->options.size_px.width, self->options.size_px.height,
					&self->reader);

	if (ret == 0 && self->options.poses[0])
		ret = lp_pose_file_read(self->options.poses, &self->poses);
	if (ret == 0)
		ret = lp_source_outbox_start(self->outbox, source);
	if (ret < 0)
		return ret;
	ret = -pthread_create(&self->thread, NULL, read_thread, self);
	if (ret < 0) {
		lp_error("file", "start", "no thread: %s", lp_strerror(ret));
		return ret;
	}
	self->thread_runs = true;
	return 0;
}

static void file_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	const struct options *options = &self_of(source)->options;

	*caps = (struct lp_source_caps){
		.reports_exposure = options->exposures_us.count > 0,
		.exposure_min_us = NAN,
		.exposure_max_us = NAN,
		.gain_min = NAN,
		.gain_max = NAN,
		.exposure_delay_frames = -1,
		.has_poses = options->poses[0] != '\0',
		.finite = !options->loop,
	};
}

const struct lp_source_ops lp_source_file_ops = {
	.info = {.scheme = "file",
		 .form = "PATH",
		 .help = "a JPEG photo, an MJPEG stream, raw YUYV/NV12/GREY, PFM, or a folder of "
			 "them",
		 .params = &params},
	.create = file_create,
	.start = file_start,
	.caps = file_caps,
	.destroy = file_destroy,
};
