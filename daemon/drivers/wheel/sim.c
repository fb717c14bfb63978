/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sim:?... — a servo and its wheel inside the daemon, seen through a simulated comb as the servo
 * hat's is (timed.h). It can be told to misbehave. It turns no simulated camera's
 * polarizer: for that, lightprobe simulate starts the whole box, to be named by mcu:.
 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/wheel/timed.h"
#include "include/rotator.h"

#define STEP_NS (2 * LP_NS_PER_MS)
#define SERVO_DEG_S 300.0F

extern const struct lp_rotator_ops lp_rotator_sim_ops;

struct keys {
	struct lp_timed_params timed;
	int fault; /* index of `faults` */
	float after_s;
};

enum { FAULT_NONE, FAULT_STUCK, FAULT_SLOW, FAULT_SLIP, FAULT_TOO_FAST, FAULT_ABSENT };
static const char *const faults[] = {"none", "stuck", "slow", "slip", "too-fast", "absent", NULL};

struct rotator_sim {
	struct lp_rotator base;
	struct keys keys;
	struct lp_timed timed;
	const char *last_fault;
	struct lp_timer tick;
	int64_t t_start_ns, t_step_ns;
	float wheel_deg;
	bool slipped;
};

static struct rotator_sim *self_of(const struct lp_rotator *rotator)
{
	return (struct rotator_sim *)rotator;
}

static int fault_now(const struct rotator_sim *self)
{
	const float running_s = (float)(lp_clock_ns() - self->t_start_ns) / 1e9F;

	return running_s >= self->keys.after_s ? self->keys.fault : FAULT_NONE;
}

static void report_state(const struct rotator_sim *self)
{
	struct lp_wheel_state state;

	lp_timed_state(&self->timed, lp_clock_ns(), &state);
	if (fault_now(self) == FAULT_ABSENT)
		state = (struct lp_wheel_state){.phase = LP_WHEEL_ABSENT,
						.commanded_deg = NAN,
						.measured_deg = NAN,
						.sigma_deg = NAN,
						.clock_sigma_us = NAN};
	self->base.host.state(self->base.host.context, &state);
}

static void report_fault(struct rotator_sim *self)
{
	const struct lp_rotator_host *host = &self->base.host;

	if (self->timed.fault == self->last_fault)
		return;
	if (self->last_fault)
		host->fault(host->context, self->last_fault, NULL);
	if (self->timed.fault)
		host->fault(host->context, self->timed.fault, self->timed.next_step);
	self->last_fault = self->timed.fault;
}

/* Edges of the comb below an angle. */
static int below(const struct rotator_sim *self, float angle_deg)
{
	const struct lp_timed_params *p = &self->keys.timed;
	const int count = (int)ceilf((angle_deg - p->first_deg) / p->pitch_deg);

	return count < 0 ? 0 : count > p->edges ? p->edges : count;
}

static void turn(struct rotator_sim *self, int64_t now_ns, int fault)
{
	const struct lp_timed_params *p = &self->keys.timed;
	const float pulse_us =
		lp_timed_pulse_us(&self->timed, now_ns - (int64_t)(p->lag_ms * 1e6F));
	const float step_s = (float)(now_ns - self->t_step_ns) / 1e9F;
	const float most_deg = SERVO_DEG_S * step_s * (fault == FAULT_SLOW ? 0.1F : 1.0F);
	const int before = below(self, self->wheel_deg);

	self->t_step_ns = now_ns;
	if (pulse_us > 0 && fault != FAULT_STUCK && fault != FAULT_TOO_FAST) {
		const float asked_deg = (pulse_us - p->servo_zero_us) / p->servo_us_per_deg;

		self->wheel_deg += fminf(fmaxf(asked_deg - self->wheel_deg, -most_deg), most_deg);
	}
	if (fault == FAULT_SLIP && !self->slipped && self->timed.step == LP_TIMED_REST) {
		self->slipped = true;
		self->wheel_deg += 2 * p->pitch_deg;
	}
	for (int k = abs(below(self, self->wheel_deg) - before); k > 0; k--)
		lp_timed_edge(&self->timed, now_ns);
	if (fault == FAULT_TOO_FAST && self->timed.step == LP_TIMED_UP &&
	    now_ns - self->timed.t_step_ns >
		    (int64_t)(9.0F / p->slew_deg_s * 1e9F) + (int64_t)(p->lag_ms * 1e6F))
		lp_timed_edge(&self->timed, now_ns);
}

static void on_tick(struct lp_timer *timer)
{
	struct rotator_sim *self = LP_CONTAINER_OF(timer, struct rotator_sim, tick);
	const enum lp_timed_step before = self->timed.step;
	const int64_t now_ns = lp_clock_ns();

	turn(self, now_ns, fault_now(self));
	lp_timed_tick(&self->timed, now_ns, false);
	report_fault(self);
	if (self->timed.step != before)
		lp_debug("wheel", "sim", "%s; target %.2f degrees",
			 lp_timed_step_name(self->timed.step), (double)self->timed.target_deg);
	if (self->timed.step != before || fault_now(self) == FAULT_ABSENT)
		report_state(self);
}

static int sim_start(struct lp_rotator *rotator)
{
	struct rotator_sim *self = self_of(rotator);

	self->t_start_ns = self->t_step_ns = lp_clock_ns();
	lp_timer_set(&self->tick, 0, STEP_NS);
	return 0;
}

static void sim_move(struct lp_rotator *rotator, float target_deg)
{
	struct rotator_sim *self = self_of(rotator);
	const struct lp_rotator_host *host = &self->base.host;
	const char *reason = NULL;

	if (lp_timed_move(&self->timed, target_deg, lp_clock_ns(), &reason) == 0)
		reason = NULL;
	host->fault(host->context, "wheel-refused", reason);
	report_state(self);
}

static void sim_look(struct lp_rotator *rotator)
{
	report_state(self_of(rotator));
}

static void sim_destroy(struct lp_rotator *rotator)
{
	struct rotator_sim *self = self_of(rotator);

	if (!self)
		return;
	lp_timer_stop(&self->tick);
	free(self);
}

static const struct lp_param list[] = {
	{"fault", LP_PARAM_CHOICE, offsetof(struct keys, fault), .initial = "none",
	 .choices = faults, .help = "fault to simulate"},
	{"after_s", LP_PARAM_FLOAT, offsetof(struct keys, after_s), .initial = "0", .max = 1e6,
	 .help = "time from the start until the fault begins"},
};
_Static_assert(offsetof(struct keys, timed) == 0, "the model's offsets hold");
static const struct lp_params params = {list, LP_COUNT(list), &lp_timed_keys};

static int sim_create(const struct lp_uri *uri, const struct lp_rotator_host *host,
		      struct lp_rotator **rotator)
{
	struct rotator_sim *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_rotator){.ops = &lp_rotator_sim_ops, .host = *host};
	ret = lp_uri_read(uri, &params, &self->keys);
	if (ret == 0 && !lp_timed_check(&self->keys.timed, uri->text))
		ret = -EINVAL;
	if (ret < 0) {
		sim_destroy(&self->base);
		return ret;
	}
	self->timed.params = self->keys.timed;
	self->wheel_deg = 37;
	lp_timed_init(&self->timed);
	lp_timer_init(host->loop, &self->tick, on_tick);
	*rotator = &self->base;
	return 0;
}

const struct lp_rotator_ops lp_rotator_sim_ops = {
	.info = {.scheme = "sim",
		 .form = "",
		 .help = "a simulated wheel inside the daemon, for tests\n"
			 "It does not turn a simulated polarizer: for that, use mcu: with the "
			 "simulator's box.",
		 .params = &params},
	.create = sim_create,
	.start = sim_start,
	.move = sim_move,
	.look = sim_look,
	.destroy = sim_destroy,
};
