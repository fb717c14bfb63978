/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sim:PATH?... — frames from the simulator over its Unix socket (proto/sim.md). A camera in every
 * respect: it may be absent, go away, fall silent, come back, and be told its exposure.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/pool.h"
#include "base/uri.h"
#include "drivers/source/frame_clock.h"
#include "drivers/source/frames.h"
#include "drivers/source/report.h"
#include "drivers/source/sim/header.h"
#include "include/source.h"

#define FRAMES (LP_FRAMES_HELD + 3)    /* waiting for the worker, being filled, and one in hand */
#define READ_BYTES ((size_t)512 << 10) /* of one dispatch: well below a millisecond */
#define FIRST_BACKOFF_NS (100 * LP_NS_PER_MS)
#define LONGEST_BACKOFF_NS (2 * LP_NS_PER_S)
#define STALL_NS (2 * LP_NS_PER_S)

struct source_sim {
	struct lp_source base;
	struct sockaddr_un address;
	char object[sizeof(((struct sockaddr_un *)NULL)->sun_path) + 8];
	char *hello;
	struct lp_pool *frames;
	struct lp_watch link;  /* fd -1: not connected */
	struct lp_timer retry; /* next attempt to connect */
	struct lp_timer stall; /* no frame for too long */
	struct lp_backoff backoff;
	struct lp_source_report report;
	bool reports_exposure;
	float exposure_min_us, exposure_max_us, exposure_step_us; /* of the newest frame's header */
	bool exposure_fixed;
	bool has_corrupt; /* since the last usable frame */
	struct lp_frame_clock clock;

	/* What is being read: a header, what the header is longer than ours, a payload. */
	uint8_t header_data[LP_SIM_HEADER_KNOWN_BYTES];
	struct lp_sim_header header;
	uint64_t got_bytes;	      /* of header, its rest and payload together */
	struct lp_owned_frame *frame; /* NULL: the payload is read and forgotten */

	/* What is being written: one line; then the newest exposure command, if one waits. */
	char *line;
	size_t line_bytes, line_sent;
	bool exposure_waits;
	float exposure_us, gain;
};

static struct source_sim *self_of(const struct lp_source *source)
{
	return (struct source_sim *)source;
}

static void report(struct source_sim *self, enum lp_source_state state, const char *stage,
		   const char *reason)
{
	const struct lp_source_host *host = &self->base.host;

	if (lp_source_report_state(&self->report, state, self->object, stage, reason))
		host->state(host->context, state, self->report.last_reason);
}

static bool is_streaming(const struct source_sim *self)
{
	return self->report.last_state == LP_SOURCE_STREAMING;
}

/* ---------------------------------------------------------------- connection */

static void forget_frame(struct source_sim *self)
{
	if (self->frame)
		lp_frame_release(&self->frame->frame);
	self->frame = NULL;
	self->got_bytes = 0;
}

static void disconnect(struct source_sim *self)
{
	const int fd = self->link.fd;

	if (fd < 0)
		return;
	lp_watch_stop(&self->link);
	close(fd);
	forget_frame(self);
	self->line_bytes = self->line_sent = 0;
	self->exposure_waits = false;
	self->has_corrupt = false;
	lp_timer_stop(&self->stall);
}

/* The link is of no more use: say why, and try again later. */
static void lose_link(struct source_sim *self, const char *stage, const char *reason)
{
	disconnect(self);
	lp_timer_set(&self->retry, lp_backoff_next_ns(&self->backoff), 0);
	report(self, LP_SOURCE_WAITING, stage, reason);
}

/* ---------------------------------------------------------------- commands */

/* Write what waits, as far as the socket takes it. A broken link shows when it is read. */
static void write_lines(struct source_sim *self)
{
	for (;;) {
		ssize_t sent;

		if (self->line_sent == self->line_bytes) {
			if (!self->exposure_waits)
				break;
			self->exposure_waits = false;
			self->line_sent = 0;
			self->line_bytes =
				(size_t)snprintf(self->line, LP_URI_MAX_BYTES,
						 "exposure %.9g %.9g\n", (double)self->exposure_us,
						 (double)self->gain);
		}
		sent = send(self->link.fd, self->line + self->line_sent,
			    self->line_bytes - self->line_sent, MSG_NOSIGNAL);
		if (sent < 0)
			break;
		self->line_sent += (size_t)sent;
	}
	lp_watch_change(&self->link, self->line_sent < self->line_bytes ? LP_READABLE | LP_WRITABLE
									: LP_READABLE);
}

static int sim_set_exposure(struct lp_source *source, float exposure_us, float gain)
{
	struct source_sim *self = self_of(source);

	if (self->link.fd < 0)
		return -ENOTCONN;
	self->exposure_us = exposure_us;
	self->gain = gain;
	self->exposure_waits = true;
	write_lines(self);
	return 0;
}

/* ---------------------------------------------------------------- frames */

/* When the reading began: at the end of the exposure. The other end may be any program, and its
 * numbers anything. */
static int64_t stamp_ns(const struct lp_sim_header *header)
{
	const int64_t exposure_ns = isnan(header->exposure_us) /* then it is the end that is told */
					    ? 0
					    : (int64_t)((double)header->exposure_us * LP_NS_PER_US);
	int64_t end_ns;

	return __builtin_add_overflow(header->t_start_ns, exposure_ns, &end_ns) ? INT64_MAX
										: end_ns;
}

static void fill_frame(struct source_sim *self, struct lp_frame *frame)
{
	const struct lp_sim_header *header = &self->header;

	frame->format = header->format;
	frame->width_px = header->width_px;
	frame->height_px = header->height_px;
	frame->stride_bytes = header->stride_bytes;
	frame->size_bytes = header->payload_bytes;
	frame->sequence = header->sequence;
	frame->t_arrival_ns = lp_clock_ns();
	frame->exposure_us = header->exposure_us;
	frame->gain = header->gain;
	memcpy(frame->orientation, header->orientation, sizeof(frame->orientation));
	frame->orientation_sigma_deg = header->orientation_sigma_deg;
	for (int a = 0; a < 3; a++)
		frame->position_m[a] = (double)header->position_m[a];
	frame->position_sigma_m = header->position_sigma_m;
	frame->row_time_us = header->row_time_us;
	frame->flags = header->flags;
	lp_frame_clock_stamp(&self->clock, frame, stamp_ns(header), self->object);
}

/* The first usable frame reports STREAMING; corrupt ones before it are counted only. */
static void hand_on(struct source_sim *self, struct lp_frame *frame)
{
	const struct lp_source_host *host = &self->base.host;

	if (frame->flags & LP_FRAME_CORRUPT) {
		self->has_corrupt = true;
		lp_error(self->object, "read",
			 "a frame is marked corrupt, or its size is impossible; it is not used");
		if (!is_streaming(self)) {
			lp_frame_release(frame);
			host->corrupt(host->context);
			return;
		}
	} else {
		self->has_corrupt = false;
		self->reports_exposure = !isnan(frame->exposure_us);
		self->exposure_min_us = self->header.exposure_min_us;
		self->exposure_max_us = self->header.exposure_max_us;
		self->exposure_fixed = self->header.exposure_fixed;
		self->exposure_step_us = self->header.exposure_step_us;
		lp_timer_set(&self->stall, STALL_NS, STALL_NS);
		report(self, LP_SOURCE_STREAMING, "read", "frames arrive");
	}
	host->frame(host->context, frame);
}

static void deliver(struct source_sim *self)
{
	struct lp_frame *frame = self->frame ? &self->frame->frame : NULL;

	self->frame = NULL;
	self->got_bytes = 0;
	lp_backoff_reset(&self->backoff);
	if (!frame) {
		lp_timer_set(&self->stall, STALL_NS, STALL_NS); /* the loss is ours */
		return;
	}
	fill_frame(self, frame);
	hand_on(self, frame);
}

/* The part is there that tells how long the header is. False: it makes no sense. */
static bool begin_header(struct source_sim *self)
{
	const char *fault;

	if (lp_sim_header_is_busy(self->header_data)) {
		lose_link(self, "connect",
			  "busy — another lightprobed has this simulator. Trying again");
		return false;
	}
	fault = lp_sim_header_parse(self->header_data, &self->header);
	if (fault) {
		char reason[120];

		(void)snprintf(reason, sizeof(reason), "%s — is the simulator of another version?",
			       fault);
		lose_link(self, "header", reason);
	}
	return fault == NULL;
}

/* The header is complete, as far as it is known: find a place for the payload. */
static void begin_payload(struct source_sim *self)
{
	lp_sim_header_parse_more(self->header_data, &self->header);
	self->frame = lp_owned_frame_take(self->frames, false);
	if (self->frame && lp_owned_frame_reserve(self->frame, self->header.payload_bytes) < 0) {
		lp_frame_release(&self->frame->frame);
		self->frame = NULL;
	}
	if (!self->frame)
		lp_error(self->object, "read", "no buffer is free; a frame is lost");
}

/* How much of the header is kept: its first part tells how long it is. */
static uint64_t kept_header_bytes(const struct source_sim *self)
{
	if (self->got_bytes < LP_SIM_HEADER_BYTES)
		return LP_SIM_HEADER_BYTES;
	return self->header.header_bytes < LP_SIM_HEADER_KNOWN_BYTES ? self->header.header_bytes
								     : LP_SIM_HEADER_KNOWN_BYTES;
}

/* Where the next bytes go and how many are wanted, by what has been read of this frame. */
static size_t next_place(struct source_sim *self, uint8_t *scratch, uint8_t **place)
{
	const uint64_t kept = kept_header_bytes(self);
	const uint64_t header = self->header.header_bytes;
	uint64_t wanted;

	if (self->got_bytes < kept) {
		*place = self->header_data + self->got_bytes;
		return kept - self->got_bytes;
	}
	if (self->got_bytes < header || !self->frame) {
		*place = scratch;
		wanted = (self->got_bytes < header ? header : header + self->header.payload_bytes) -
			 self->got_bytes;
		return wanted < LP_SIM_HEADER_MAX_BYTES ? wanted : LP_SIM_HEADER_MAX_BYTES;
	}
	*place = self->frame->buffer + (self->got_bytes - header);
	wanted = header + self->header.payload_bytes - self->got_bytes;
	return wanted < READ_BYTES ? wanted : READ_BYTES;
}

static void read_link(struct source_sim *self)
{
	uint8_t scratch[LP_SIM_HEADER_MAX_BYTES];
	uint8_t *place;
	const size_t wanted = next_place(self, scratch, &place);
	const ssize_t got = read(self->link.fd, place, wanted);
	const uint64_t before = self->got_bytes;

	if (got < 0 && (errno == EAGAIN || errno == EINTR))
		return;
	if (got <= 0) {
		lose_link(self, "read", "the simulator has gone — trying to connect again");
		return;
	}
	self->got_bytes += (uint64_t)got;
	if (self->got_bytes < LP_SIM_HEADER_BYTES)
		return;
	if (before < LP_SIM_HEADER_BYTES && !begin_header(self))
		return;
	/* no read goes past the kept part while it is incomplete */
	if (self->got_bytes == kept_header_bytes(self))
		begin_payload(self);
	if (self->got_bytes == self->header.header_bytes + self->header.payload_bytes)
		deliver(self);
}

/* ---------------------------------------------------------------- events */

static void on_link_ready(struct lp_watch *watch, unsigned int events)
{
	struct source_sim *self = LP_CONTAINER_OF(watch, struct source_sim, link);

	if (events & LP_WRITABLE)
		write_lines(self);
	if (events & (LP_READABLE | LP_HANGUP))
		read_link(self);
}

static void connect_link(struct source_sim *self)
{
	const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	char reason[160];
	int ret = fd < 0 ? -errno : 0;

	if (ret == 0 && connect(fd, (struct sockaddr *)&self->address, sizeof(self->address)) < 0)
		ret = -errno;
	if (ret == 0)
		ret = lp_watch_start(self->base.host.loop, &self->link, fd, LP_READABLE,
				     on_link_ready);
	if (ret < 0) {
		if (fd >= 0)
			close(fd);
		(void)snprintf(reason, sizeof(reason),
			       "%s — is `lightprobe simulate` running? Trying again",
			       lp_strerror(ret));
		lose_link(self, "connect", reason);
		return;
	}
	self->line_sent = 0;
	self->line_bytes = (size_t)snprintf(self->line, LP_URI_MAX_BYTES + 8, "%s", self->hello);
	write_lines(self);
	lp_timer_set(&self->stall, STALL_NS, STALL_NS);
}

static void on_retry(struct lp_timer *timer)
{
	connect_link(LP_CONTAINER_OF(timer, struct source_sim, retry));
}

static void on_stall(struct lp_timer *timer)
{
	struct source_sim *self = LP_CONTAINER_OF(timer, struct source_sim, stall);

	report(self, LP_SOURCE_STALLED, "read",
	       self->has_corrupt ? "connected, but only corrupt frames for 2 s"
				 : "connected, but no frame for 2 s");
}

/* ---------------------------------------------------------------- ops */

static void sim_destroy(struct lp_source *source)
{
	struct source_sim *self = self_of(source);

	if (!source)
		return;
	disconnect(self);
	lp_timer_stop(&self->retry);
	lp_timer_stop(&self->stall);
	lp_pool_destroy(self->frames);
	free(self->line);
	free(self->hello);
	free(self);
}

const struct lp_source_ops lp_source_sim_ops;

static int sim_create(const struct lp_uri *uri, const struct lp_source_host *host,
		      struct lp_source **source)
{
	struct source_sim *self;
	int ret = -ENOMEM;

	if (!*uri->rest || strlen(uri->rest) >= sizeof(self->address.sun_path)) {
		lp_error(uri->text, "parse", "must be sim:PATH of a socket, at most %zu bytes",
			 sizeof(self->address.sun_path) - 1);
		return -EINVAL;
	}
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_sim_ops, .host = *host};
	self->link.fd = -1;
	self->exposure_min_us = self->exposure_max_us = self->exposure_step_us = NAN;
	self->backoff =
		(struct lp_backoff){.first_ns = FIRST_BACKOFF_NS, .longest_ns = LONGEST_BACKOFF_NS};
	self->address.sun_family = AF_UNIX;
	memcpy(self->address.sun_path, uri->rest, strlen(uri->rest) + 1);
	(void)snprintf(self->object, sizeof(self->object), "sim: %s", uri->rest);
	self->line = malloc(LP_URI_MAX_BYTES + 8);
	self->frames = lp_owned_frames_create(FRAMES);
	if (!self->line || !self->frames || asprintf(&self->hello, "hello %s\n", uri->query) < 0)
		goto err_destroy;
	lp_timer_init(host->loop, &self->retry, on_retry);
	lp_timer_init(host->loop, &self->stall, on_stall);
	*source = &self->base;
	return 0;
err_destroy:
	lp_error(self->object, "create", "%s", lp_strerror(ret));
	sim_destroy(&self->base);
	return ret;
}

static int sim_start(struct lp_source *source)
{
	lp_timer_set(&self_of(source)->retry, 0, 0);
	return 0;
}

static void sim_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	const struct source_sim *self = self_of(source);

	*caps = (struct lp_source_caps){
		.exposure_settable = !self->exposure_fixed,
		.reports_exposure = self->reports_exposure,
		.exposure_min_us = self->exposure_min_us,
		.exposure_max_us = self->exposure_max_us,
		.exposure_step_us = isnan(self->exposure_step_us) ? 0 : self->exposure_step_us,
		.gain_min = NAN,
		.gain_max = NAN,
		.exposure_delay_frames = -1,
	};
}

const struct lp_source_ops lp_source_sim_ops = {
	.info = {.scheme = "sim",
		 .form = "PATH",
		 .help = "the simulator's socket (lightprobe simulate)\n"
			 "The daemon waits for it, also when it goes away or has another daemon.\n"
			 "The keys are those of the simulator: see lightprobe simulate --help."},
	.create = sim_create,
	.start = sim_start,
	.caps = sim_caps,
	.set_exposure = sim_set_exposure,
	.destroy = sim_destroy,
};
