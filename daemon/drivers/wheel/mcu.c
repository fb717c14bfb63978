/* SPDX-License-Identifier: Apache-2.0 */
/*
 * mcu:CARRIER:DEVICE — the wheel on the microcontroller. Commands are not queued and not trusted:
 * whenever a state says that the wheel is not on its way to what is wanted, it is told again, and
 * only a state that carries the newest command's token counts.
 */
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/link/mcu.h"
#include "include/rotator.h"

#define AGAIN_NS (300 * LP_NS_PER_MS) /* a command that shows no effect is repeated */

extern const struct lp_rotator_ops lp_rotator_mcu_ops;

struct rotator_mcu {
	struct lp_rotator base;
	struct lp_mcu *mcu;
	struct lp_mcu_user user;
	float target_deg; /* NAN: none yet */
	uint8_t token;	  /* of the newest command */
	bool commanded;	  /* since the microcontroller was found */
	bool homing;	  /* the newest command */
	int64_t t_command_ns;
	struct lp_wheel_state state;
};

static struct rotator_mcu *self_of(const struct lp_rotator *rotator)
{
	return (struct rotator_mcu *)rotator;
}

static struct rotator_mcu *self_of_user(struct lp_mcu_user *user)
{
	return LP_CONTAINER_OF(user, struct rotator_mcu, user);
}

static void report_state(const struct rotator_mcu *self)
{
	self->base.host.state(self->base.host.context, &self->state);
}

/* An angle that must not be used: nothing is known but the phase. */
static void forget_angle(struct lp_wheel_state *state)
{
	state->commanded_deg = state->measured_deg = state->sigma_deg = NAN;
}

static void command(struct rotator_mcu *self, bool home)
{
	const int64_t now_ns = lp_clock_ns();

	if (self->commanded && now_ns - self->t_command_ns < AGAIN_NS)
		return;
	self->commanded = true;
	self->homing = home;
	self->t_command_ns = now_ns;
	self->token++;
	lp_debug("wheel", "command", home ? "home (%d)" : "move (%d) to %.2f degrees", self->token,
		 (double)self->target_deg);
	if (home)
		lp_mcu_home(self->mcu, self->token);
	else
		lp_mcu_move(self->mcu, self->token, self->target_deg);
}

static bool at_target(const struct rotator_mcu *self)
{
	return isnan(self->target_deg) ||
	       fabsf(self->state.commanded_deg - self->target_deg) < 0.006F;
}

/* What to do next. A fault is cleared by the connection, in its time. */
static void steer(struct rotator_mcu *self, bool ours)
{
	const enum lp_wheel_phase phase = self->state.phase;

	if (phase == LP_WHEEL_FAULT || lp_mcu_wheel_stopped(self->mcu))
		return;
	if (!self->commanded || phase == LP_WHEEL_UNKNOWN)
		command(self, true);
	else if (!ours) /* the command, or the news of it, is on its way or lost */
		command(self, self->homing);
	else if (phase == LP_WHEEL_SETTLED && !at_target(self))
		command(self, false);
}

static void on_wheel(struct lp_mcu_user *user, const struct lp_mcu_wheel *wheel)
{
	struct rotator_mcu *self = self_of_user(user);
	const bool ours = self->commanded && wheel->token == self->token;

	self->state = wheel->state;
	if (!ours)
		forget_angle(&self->state);
	steer(self, ours);
	if (lp_mcu_wheel_stopped(self->mcu))
		self->state.phase = LP_WHEEL_FAULT;
	else if (!ours && self->state.phase != LP_WHEEL_FAULT)
		self->state.phase = self->homing ? LP_WHEEL_HOMING : LP_WHEEL_MOVING;
	report_state(self);
}

/* A target that the wheel cannot go to: it stays where it is. */
static void on_refused(struct lp_mcu_user *user, uint8_t token, const char *reason)
{
	struct rotator_mcu *self = self_of_user(user);
	const struct lp_rotator_host *host = &self->base.host;
	char text[160];

	if (token != self->token || self->homing)
		return;
	(void)snprintf(text, sizeof(text),
		       "wheel: move: %.2f degrees: %s — see its range with lightprobe mcu params",
		       (double)self->target_deg, reason);
	lp_warning("wheel", "move", "%.2f degrees: %s", (double)self->target_deg, reason);
	self->target_deg = NAN;
	self->commanded = false; /* home again: the token is not the wheel's */
	host->fault(host->context, "wheel-refused", text);
}

static void on_found(struct lp_mcu_user *user)
{
	struct rotator_mcu *self = self_of_user(user);

	self->commanded = false;
	self->state.phase = LP_WHEEL_UNKNOWN;
	forget_angle(&self->state);
	report_state(self);
}

static void on_lost(struct lp_mcu_user *user)
{
	struct rotator_mcu *self = self_of_user(user);

	self->state.phase = LP_WHEEL_ABSENT;
	forget_angle(&self->state);
	report_state(self);
}

static void on_fault(struct lp_mcu_user *user, const char *id, const char *text)
{
	const struct lp_rotator_host *host = &self_of_user(user)->base.host;

	host->fault(host->context, id, text);
}

/* ---------------------------------------------------------------- ops */

static int mcu_start(struct lp_rotator *rotator)
{
	lp_mcu_start(self_of(rotator)->mcu);
	return 0;
}

static void mcu_move(struct lp_rotator *rotator, float target_deg)
{
	struct rotator_mcu *self = self_of(rotator);

	self->target_deg = target_deg;
	self->base.host.fault(self->base.host.context, "wheel-refused", NULL);
	if (self->state.phase != LP_WHEEL_SETTLED || at_target(self))
		return;
	self->commanded = false; /* at once, even after another command */
	command(self, false);
	self->state.phase = LP_WHEEL_MOVING;
	forget_angle(&self->state);
	report_state(self);
}

static void mcu_look(struct lp_rotator *rotator)
{
	lp_mcu_look(self_of(rotator)->mcu);
}

static void mcu_destroy(struct lp_rotator *rotator)
{
	struct rotator_mcu *self = self_of(rotator);

	if (!self)
		return;
	lp_mcu_release(self->mcu);
	lp_mcu_leave(self->mcu, &self->user);
	free(self);
}

static int mcu_create(const struct lp_uri *uri, const struct lp_rotator_host *host,
		      struct lp_rotator **rotator)
{
	struct lp_mcu_settings settings;
	struct rotator_mcu *self;
	int ret = lp_uri_read(uri, &lp_mcu_params, &settings);

	if (ret < 0)
		return ret;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_rotator){.ops = &lp_rotator_mcu_ops, .host = *host};
	self->user = (struct lp_mcu_user){.found = on_found,
					  .lost = on_lost,
					  .wheel = on_wheel,
					  .refused = on_refused,
					  .fault = on_fault};
	self->target_deg = NAN;
	self->state.phase = LP_WHEEL_ABSENT;
	self->state.clock_sigma_us = NAN;
	forget_angle(&self->state);
	ret = lp_mcu_join(host->connections, host->loop, uri, &settings, &self->user, &self->mcu);
	if (ret < 0) {
		free(self);
		return ret;
	}
	*rotator = &self->base;
	return 0;
}

const struct lp_rotator_ops lp_rotator_mcu_ops = {
	.info = {.scheme = "mcu",
		 .form = "CARRIER:DEVICE",
		 .help = "the wheel on the microcontroller, as mcu:serial:/dev/ttyUSB0\n"
			 "CARRIER is serial, i2c (mcu:i2c:/dev/i2c-1) or can (mcu:can:can0). The "
			 "daemon waits for the\n"
			 "wheel, homes it, and tries again after a fault.",
		 .params = &lp_mcu_params},
	.create = mcu_create,
	.start = mcu_start,
	.move = mcu_move,
	.look = mcu_look,
	.destroy = mcu_destroy,
};
