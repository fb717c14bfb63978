/* SPDX-License-Identifier: Apache-2.0 */
/*
 * example: - a grey pattern that moves, made here. It is the model for a new source that has a
 * thread of its own (docs/maintainers/adding_a_backend.md): copy it, and read the device where
 * make_picture() stands.
 */
#include <errno.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/param.h"
#include "base/pool.h"
#include "base/stop.h"
#include "base/uri.h"
#include "drivers/source/frames.h"
#include "drivers/source/outbox.h"
#include "include/source.h"

#define OBJECT "example"
#define FRAMES (LP_FRAMES_HELD + 3) /* waiting for the worker, on their way, being filled */
#define STALL_NS LP_NS_PER_S

/* The query of the URI. */
struct options {
	float rate_hz;
	struct lp_size size_px;
	int corrupt_first; /* so many frames are marked corrupt */
};

static const struct lp_param list[] = {
	{"rate", LP_PARAM_FLOAT, offsetof(struct options, rate_hz), .initial = "30", .min = 0.1,
	 .max = 1000, .help = "frames a second"},
	{"size", LP_PARAM_SIZE, offsetof(struct options, size_px), .initial = "320x160",
	 .max = 4096, .help = "size of the pattern"},
	{"corrupt_first", LP_PARAM_INT, offsetof(struct options, corrupt_first), .initial = "0",
	 .max = 1000000, .help = "number of frames at the start that are marked corrupt"},
};
static const struct lp_params params = LP_PARAMS(list);

struct source_example {
	struct lp_source base;
	struct options options;
	struct lp_pool *frames;
	struct lp_source_outbox *outbox;
	struct lp_stop stop;
	pthread_t thread;
	bool thread_runs;
};

static struct source_example *self_of(const struct lp_source *source)
{
	return (struct source_example *)source;
}

/* ---------------------------------------------------------------- the source's own thread */

/* 0 or -ENOMEM. */
static int make_picture(const struct source_example *self, struct lp_owned_frame *owned,
			uint64_t sequence)
{
	const struct lp_size *size = &self->options.size_px;
	struct lp_frame *frame = &owned->frame;
	const int ret = lp_owned_frame_reserve(owned, (size_t)size->width * size->height);

	if (ret < 0)
		return ret;
	frame->format = LP_FORMAT_GREY;
	frame->width_px = frame->stride_bytes = size->width;
	frame->height_px = size->height;
	frame->size_bytes = (size_t)size->width * size->height;
	for (size_t i = 0; i < frame->size_bytes; i++)
		owned->buffer[i] = (uint8_t)(64 + (i + sequence) % 128);
	frame->sequence = sequence;
	frame->t_read_ns = frame->t_arrival_ns = lp_clock_ns();
	frame->flags = sequence < (uint64_t)self->options.corrupt_first ? LP_FRAME_CORRUPT : 0;
	return 0;
}

static void *run(void *argument)
{
	struct source_example *self = argument;
	const int64_t period_ns = (int64_t)((double)LP_NS_PER_S / (double)self->options.rate_hz);
	int64_t due_ns = lp_clock_ns(), usable_ns = due_ns;

	for (uint64_t sequence = 0; lp_stop_wait_until(&self->stop, due_ns); sequence++) {
		struct lp_owned_frame *owned = lp_owned_frame_take(self->frames, false);

		due_ns += period_ns;
		if (!owned)
			continue; /* all are at work: a gap in the numbers, which the host counts */
		if (make_picture(self, owned, sequence) < 0)
			owned->frame.flags |= LP_FRAME_CORRUPT;
		if (!(owned->frame.flags & LP_FRAME_CORRUPT))
			usable_ns = lp_clock_ns();
		lp_source_outbox_send(self->outbox, &owned->frame, OBJECT);
		if (lp_clock_ns() - usable_ns > STALL_NS)
			lp_source_outbox_report(self->outbox, LP_SOURCE_STALLED, OBJECT, "read",
						"only corrupt frames for a second");
	}
	return NULL;
}

/* ---------------------------------------------------------------- ops, on the loop thread */

static void example_destroy(struct lp_source *source)
{
	struct source_example *self = self_of(source);

	if (!self)
		return;
	lp_stop_ask(&self->stop);
	lp_source_outbox_close(self->outbox);
	if (self->thread_runs)
		pthread_join(self->thread, NULL);
	lp_source_outbox_destroy(self->outbox);
	lp_pool_destroy(self->frames);
	lp_stop_finish(&self->stop);
	free(self);
}

const struct lp_source_ops lp_source_example_ops;

static int example_create(const struct lp_uri *uri, const struct lp_source_host *host,
			  struct lp_source **source)
{
	struct source_example *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_example_ops, .host = *host};
	lp_stop_init(&self->stop);
	self->frames = lp_owned_frames_create(FRAMES);
	self->outbox = lp_source_outbox_create();
	ret = lp_uri_read(uri, &params, &self->options);
	if (ret == 0 && (!self->frames || !self->outbox)) {
		lp_error(OBJECT, "create", "out of memory or descriptors");
		ret = -ENOMEM;
	}
	if (ret < 0) {
		example_destroy(&self->base);
		return ret;
	}
	*source = &self->base;
	return 0;
}

static int example_start(struct lp_source *source)
{
	struct source_example *self = self_of(source);
	int ret = lp_source_outbox_start(self->outbox, source);

	if (ret == 0)
		ret = -pthread_create(&self->thread, NULL, run, self);
	if (ret < 0)
		lp_error(OBJECT, "start", "%s", lp_strerror(ret));
	self->thread_runs = ret == 0;
	return ret;
}

static void example_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	(void)source;
	*caps = (struct lp_source_caps){.exposure_min_us = NAN,
					.exposure_max_us = NAN,
					.gain_min = NAN,
					.gain_max = NAN,
					.exposure_delay_frames = -1};
}

const struct lp_source_ops lp_source_example_ops = {
	.info = {.scheme = "example",
		 .form = "",
		 .help = "a moving grey pattern; the example for new sources",
		 .params = &params},
	.create = example_create,
	.start = example_start,
	.caps = example_caps,
	.destroy = example_destroy,
};
