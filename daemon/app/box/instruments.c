/* SPDX-License-Identifier: Apache-2.0 */
#include "app/box/instruments.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <stdio.h>
#include <string.h>

#include "app/backends.h"
#include "app/box/sweep.h"
#include "app/options/options.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "include/connections.h"
#include "include/frame.h"
#include "include/light_estimate.h"
#include "include/ring.h"
#include "include/rotator.h"
#include "serve/health.h"

#define SILENCE_NS (1 * LP_NS_PER_S)
#define RATE_WINDOW_NS (1 * LP_NS_PER_S)

struct lp_instruments {
	struct lp_instruments_host host;
	struct lp_health *health;
	struct lp_connections connections;
	struct lp_rotator *rotator; /* NULL: none */
	struct lp_ring *ring;	    /* NULL: none */
	struct lp_sweep sweep;
	bool sweeps;	     /* --polarizer=sweep */
	float stated_deg;    /* of a film without a wheel, by --polarizer=fixed:DEG; NAN: none */
	uint32_t unmeasured; /* of the newest estimate */

	bool ring_heard; /* the next two count */
	uint32_t ring_sequence;
	int64_t t_ring_ns;
	bool ring_silent;
	int64_t window_start_ns;
	uint64_t window_start_samples;
};

static void on_fault(void *context, const char *id, const char *text)
{
	struct lp_instruments *self = context;

	lp_health_fault(self->health, id, text);
}

/* ---------------------------------------------------------------- wheel */

static void on_wheel(void *context, const struct lp_wheel_state *state)
{
	struct lp_instruments *self = context;

	lp_sweep_state(&self->sweep, state, lp_clock_ns());
}

static void emit(void *context, struct lp_frame *frame)
{
	struct lp_instruments *self = context;

	self->host.frame(self->host.context, frame);
}

static void move(void *context, float target_deg)
{
	struct lp_instruments *self = context;

	self->rotator->ops->move(self->rotator, target_deg);
}

static void look(void *context)
{
	struct lp_instruments *self = context;

	self->rotator->ops->look(self->rotator);
}

void lp_instruments_frame(struct lp_instruments *instruments, struct lp_frame *frame)
{
	if (instruments->rotator) {
		lp_sweep_frame(&instruments->sweep, frame, lp_clock_ns());
		return;
	}
	if (!isnan(instruments->stated_deg) && isnan(frame->wheel_deg)) {
		frame->wheel_deg = instruments->stated_deg;
		frame->wheel_sigma_deg = LP_STATED_ANGLE_SIGMA_DEG;
	}
	emit(instruments, frame);
}

/* ---------------------------------------------------------------- ring */

static void on_sample(void *context, const struct lp_ring_sample *sample)
{
	struct lp_instruments *self = context;
	struct lp_ring_report *report = &self->health->report.ring;
	const uint32_t gap = sample->sequence - self->ring_sequence - 1;

	if (self->ring_heard && gap < UINT32_MAX / 2)
		report->samples_lost += gap;
	self->ring_heard = true;
	self->ring_sequence = sample->sequence;
	self->t_ring_ns = lp_clock_ns();
	report->samples++;
	memcpy(report->illuminance_lux, sample->illuminance_lux, sizeof(report->illuminance_lux));
	if (self->ring_silent)
		lp_health_fault(self->health, "ring-silent", NULL);
	self->ring_silent = false;
	self->host.ring(self->host.context, sample);
}

static void tell_silence(struct lp_instruments *self)
{
	char text[160];

	(void)snprintf(
		text, sizeof(text),
		"ring: receive: no sample for a second from --ring=%s: — is it connected? the "
		"other faults say more",
		self->ring->ops->info.scheme);
	lp_warning("ring", "receive", "no sample for a second");
	lp_health_fault(self->health, "ring-silent", text);
}

static void watch_ring(struct lp_instruments *self, int64_t now_ns)
{
	struct lp_ring_report *report = &self->health->report.ring;
	const int64_t window_ns = now_ns - self->window_start_ns;

	if (!self->ring_silent && now_ns - self->t_ring_ns > SILENCE_NS) {
		self->ring_silent = true;
		self->ring_heard = false;
		for (int k = 0; k < LP_RING_SENSORS; k++)
			report->illuminance_lux[k] = NAN;
		tell_silence(self);
	}
	if (window_ns < RATE_WINDOW_NS)
		return;
	report->samples_per_s = (float)((double)(report->samples - self->window_start_samples) *
					(double)LP_NS_PER_S / (double)window_ns);
	self->window_start_ns = now_ns;
	self->window_start_samples = report->samples;
}

/* ---------------------------------------------------------------- both */

void lp_instruments_tick(struct lp_instruments *instruments, int64_t now_ns)
{
	if (instruments->rotator)
		lp_sweep_tick(&instruments->sweep, now_ns);
	if (instruments->ring)
		watch_ring(instruments, now_ns);
}

uint32_t lp_instruments_flags(const struct lp_instruments *instruments)
{
	const struct lp_ring_report *ring = &instruments->health->report.ring;
	uint32_t flags = 0;

	if (instruments->rotator && lp_sweep_lost(&instruments->sweep))
		flags |= LP_ESTIMATE_WHEEL_FAULT;
	for (int k = 0; instruments->ring && k < LP_RING_SENSORS; k++) {
		if (isnan(ring->illuminance_lux[k]))
			flags |= LP_ESTIMATE_RING_FAULT;
	}
	return flags;
}

int lp_instruments_start(struct lp_instruments *instruments)
{
	int ret = 0;

	instruments->t_ring_ns = instruments->window_start_ns = lp_clock_ns();
	if (instruments->rotator) {
		lp_sweep_start(&instruments->sweep);
		ret = instruments->rotator->ops->start(instruments->rotator);
	}
	if (ret == 0 && instruments->ring)
		ret = instruments->ring->ops->start(instruments->ring);
	return ret;
}

void lp_instruments_see(struct lp_instruments *instruments,
			const struct lp_light_estimate *estimate)
{
	if (estimate->unmeasured != instruments->unmeasured)
		lp_sweep_want(&instruments->sweep);
	instruments->unmeasured = estimate->unmeasured;
}

int lp_instruments_sweep(struct lp_instruments *instruments, uint64_t *done_at, const char **reason)
{
	*reason = "this probe has no polarizer wheel — start lightprobed with --rotator=URI and "
		  "--polarizer=sweep";
	if (!instruments->rotator)
		return -ENODEV;
	*reason = "the polarizer stays where it is — start lightprobed with --polarizer=sweep";
	if (!instruments->sweeps)
		return -EOPNOTSUPP;
	*reason = "the wheel is lost, or not ready yet — its fault in the health says more "
		  "(lightprobe doctor)";
	if (lp_sweep_lost(&instruments->sweep))
		return -EIO;
	*done_at = lp_sweep_request(&instruments->sweep);
	return 0;
}

static int ascending(const void *a, const void *b)
{
	const float x = *(const float *)a, y = *(const float *)b;

	return (x > y) - (x < y);
}

/* Where the wheel goes: what the polarizer needs, unless the user names several angles. A sweep
 * ends where the film stands as it began, 180 degrees on: what has changed meanwhile contradicts
 * what was read there first. */
static struct lp_floats wheel_angles(const struct lp_options *options)
{
	const struct lp_polarizer *polarizer = &options->polarizer;
	struct lp_floats angles = options->wheel_angles_deg;

	if (polarizer->mode == LP_POLARIZER_FIXED)
		return (struct lp_floats){1, {polarizer->fixed_deg}};
	if (polarizer->mode != LP_POLARIZER_SWEEP)
		return angles;
	if (angles.count < 2)
		return (struct lp_floats){5, {0.0F, 45.0F, 90.0F, 135.0F, 180.0F}};
	qsort(angles.values, (size_t)angles.count, sizeof(*angles.values), ascending);
	return angles;
}

static int open_rotator(struct lp_instruments *self, const struct lp_options *options)
{
	const struct lp_rotator_host host = {.context = self,
					     .loop = self->host.loop,
					     .state = on_wheel,
					     .fault = on_fault,
					     .connections = &self->connections};
	struct lp_wheel_report *report = &self->health->report.wheel;

	report->state = (struct lp_wheel_state){.phase = LP_WHEEL_ABSENT,
						.commanded_deg = NAN,
						.measured_deg = NAN,
						.sigma_deg = NAN,
						.clock_sigma_us = NAN};
	self->health->report.has_wheel = true;
	const struct lp_floats angles = wheel_angles(options);

	self->sweeps = options->polarizer.mode == LP_POLARIZER_SWEEP;
	self->sweep = (struct lp_sweep){
		.host = {.context = self, .frame = emit, .move = move, .look = look},
		.report = report,
		.pass_turning = options->polarizer.mode != LP_POLARIZER_OFF,
		.angle_count = angles.count,
		.to_and_fro = self->sweeps,
		.by_exposures = self->sweeps,
		.dwell_ns = (int64_t)((double)options->wheel_dwell_ms * 1e6),
		.rest_ns = options->polarizer.mode == LP_POLARIZER_SWEEP
				   ? (int64_t)((double)options->polarizer_rest_s * 1e9)
				   : 0};
	memcpy(self->sweep.angles_deg, angles.values, sizeof(self->sweep.angles_deg));
	return lp_rotator_open(options->rotator, &host, &self->rotator);
}

static int open_ring(struct lp_instruments *self, const struct lp_options *options)
{
	const struct lp_ring_host host = {.context = self,
					  .loop = self->host.loop,
					  .sample = on_sample,
					  .fault = on_fault,
					  .connections = &self->connections};

	self->health->report.has_ring = true;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		self->health->report.ring.illuminance_lux[k] = NAN;
	return lp_ring_open(options->ring, &host, &self->ring);
}

int lp_instruments_create(const struct lp_options *options, struct lp_health *health,
			  const struct lp_instruments_host *host,
			  struct lp_instruments **instruments)
{
	struct lp_instruments *self = calloc(1, sizeof(*self));
	int ret = 0;

	if (!self)
		return -ENOMEM;
	self->host = *host;
	self->health = health;
	self->stated_deg =
		options->polarizer.mode == LP_POLARIZER_FIXED ? options->polarizer.fixed_deg : NAN;
	if (options->once && (*options->rotator || *options->ring)) {
		lp_error("lightprobed", "--once",
			 "--once uses neither wheel nor ring — leave out --rotator and --ring");
		ret = -EINVAL;
	}
	if (ret == 0 && *options->rotator)
		ret = open_rotator(self, options);
	if (ret == 0 && *options->ring)
		ret = open_ring(self, options);
	if (ret < 0) {
		lp_instruments_destroy(self);
		return ret;
	}
	*instruments = self;
	return 0;
}

void lp_instruments_destroy(struct lp_instruments *instruments)
{
	if (!instruments)
		return;
	lp_sweep_finish(&instruments->sweep);
	if (instruments->ring)
		instruments->ring->ops->destroy(instruments->ring);
	if (instruments->rotator)
		instruments->rotator->ops->destroy(instruments->rotator);
	free(instruments);
}
