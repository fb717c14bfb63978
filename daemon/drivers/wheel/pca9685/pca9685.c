/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pca9685:I2C-DEVICE — the wheel on a servo hat, straight on the board's I2C bus (hat.h), and one
 * sensor of the comb on a GPIO line (index.h). What is known of the wheel: timed.h.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/wheel/pca9685/hat.h"
#include "drivers/wheel/pca9685/index.h"
#include "drivers/wheel/timed.h"
#include "include/rotator.h"

#define PERIOD_NS (20 * LP_NS_PER_MS)
#define FIRST_RETRY_NS (200 * LP_NS_PER_MS)
#define LAST_RETRY_NS (2 * LP_NS_PER_S)
#define WAITING "pca9685-waiting"
#define STOPPED "; three attempts failed: repair, then restart lightprobed"

extern const struct lp_rotator_ops lp_rotator_pca9685_ops;

struct keys {
	struct lp_timed_params timed;
	int address, channel, line;
	char chip[64];
};

struct rotator_pca9685 {
	struct lp_rotator base;
	char device[256], object[300];
	struct keys keys;
	struct lp_timed timed;
	const char *last_fault; /* of the model, as the host knows it; NULL: none */
	bool last_stopped;
	struct lp_timer tick;
	struct lp_servo_hat *hat;
	struct lp_index *index; /* NULL: hat and index are not both there */
	struct lp_watch edges;
	bool opening; /* the hat is being set up */
	int64_t t_retry_ns;
	struct lp_backoff retry;
	uint64_t opened;
};

static struct rotator_pca9685 *self_of(const struct lp_rotator *rotator)
{
	return (struct rotator_pca9685 *)rotator;
}

/* ---------------------------------------------------------------- towards the host */

static void report_state(const struct rotator_pca9685 *self)
{
	struct lp_wheel_state state;

	lp_timed_state(&self->timed, lp_clock_ns(), &state);
	if (!self->index)
		state.phase = LP_WHEEL_ABSENT;
	state.reconnects = self->opened ? self->opened - 1 : 0;
	self->base.host.state(self->base.host.context, &state);
}

/* The model has taken a step. */
static void report_step(const struct rotator_pca9685 *self)
{
	lp_debug(self->object, "wheel", "%s; target %.2f degrees",
		 lp_timed_step_name(self->timed.step), (double)self->timed.target_deg);
	report_state(self);
}

/* The model's fault, when it has changed. */
static void report_fault(struct rotator_pca9685 *self)
{
	const struct lp_rotator_host *host = &self->base.host;
	const char *fault = self->timed.fault;
	char text[500];

	if (fault == self->last_fault && self->timed.stopped == self->last_stopped)
		return;
	if (self->last_fault)
		host->fault(host->context, self->last_fault, NULL);
	if (fault) {
		(void)snprintf(text, sizeof(text), "%s: %s: %s%s", self->object, fault,
			       self->timed.next_step, self->timed.stopped ? STOPPED : "");
		lp_warning(self->object, fault, "%s%s", self->timed.next_step,
			   self->timed.stopped ? STOPPED : "");
		host->fault(host->context, fault, text);
	}
	self->last_fault = fault;
	self->last_stopped = self->timed.stopped;
}

/* ---------------------------------------------------------------- the sensor */

/* The oldest edge that has not been read. False: none. */
static bool read_edge(struct rotator_pca9685 *self)
{
	int64_t t_ns;

	if (!lp_index_read(self->index, &t_ns))
		return false;
	lp_timed_edge(&self->timed, t_ns);
	report_fault(self);
	return true;
}

static void on_edges(struct lp_watch *watch, unsigned int events)
{
	struct rotator_pca9685 *self = LP_CONTAINER_OF(watch, struct rotator_pca9685, edges);

	(void)events;
	if (read_edge(self))
		report_state(self);
}

/* ---------------------------------------------------------------- open, close */

static void close_all(struct rotator_pca9685 *self)
{
	lp_watch_stop(&self->edges);
	lp_index_close(self->index);
	self->index = NULL;
	self->opening = false;
	if (self->hat)
		lp_servo_hat_close(self->hat);
}

static const char *next_step(const char *stage, int error)
{
	if (error == -EACCES || error == -EPERM)
		return "join the groups i2c and gpio; a service needs its drop-in i2c.conf";
	if (strcmp(stage, "index") == 0)
		return "check GPIO chip and line; gpioinfo lists them";
	if (error == -ENXIO || error == -EREMOTEIO)
		return "no acknowledge: check address and power of the hat";
	if (error == -ETIMEDOUT || error == -EBUSY)
		return "the bus hangs: is SDA or SCL held low?";
	return "does the bus exist? load i2c-dev (modprobe) or the overlay of the bus";
}

static void lose(struct rotator_pca9685 *self, const char *stage, int error)
{
	const struct lp_rotator_host *host = &self->base.host;
	char text[600];

	close_all(self);
	lp_timed_forget(&self->timed, lp_clock_ns());
	self->t_retry_ns = lp_clock_ns() + lp_backoff_next_ns(&self->retry);
	(void)snprintf(text, sizeof(text), "%s: %s: %s — %s", self->object, stage,
		       lp_strerror(error), next_step(stage, error));
	lp_warning(self->object, stage, "%s — %s", lp_strerror(error), next_step(stage, error));
	host->fault(host->context, WAITING, text);
	report_fault(self);
	report_state(self);
}

static void on_hat_failed(void *context, const char *stage, int error)
{
	lose(context, stage, error);
}

static void on_hat_ready(void *context)
{
	struct rotator_pca9685 *self = context;
	const struct lp_rotator_host *host = &self->base.host;
	int ret = lp_index_open(self->keys.chip, (unsigned)self->keys.line, &self->index);

	if (ret == 0)
		ret = lp_watch_start(host->loop, &self->edges, lp_index_fd(self->index),
				     LP_READABLE, on_edges);
	if (ret < 0) {
		lose(self, "index", ret);
		return;
	}
	self->opening = false;
	self->opened++;
	lp_backoff_reset(&self->retry);
	lp_timed_forget(&self->timed, lp_clock_ns());
	host->fault(host->context, WAITING, NULL);
	lp_info(self->object, "open", "servo hat and index sensor found");
}

static void open_all(struct rotator_pca9685 *self)
{
	const int ret = lp_servo_hat_open(self->hat);

	if (ret < 0)
		lose(self, "open", ret);
	else
		self->opening = true;
}

static void on_tick(struct lp_timer *timer)
{
	struct rotator_pca9685 *self = LP_CONTAINER_OF(timer, struct rotator_pca9685, tick);
	const enum lp_timed_step before = self->timed.step;
	const int64_t now_ns = lp_clock_ns();

	if (self->opening) {
		lp_servo_hat_pulse(self->hat, 0);
	} else if (!self->index) {
		if (now_ns >= self->t_retry_ns)
			open_all(self);
	} else {
		lp_timed_tick(&self->timed, now_ns, lp_index_is_on(self->index));
		report_fault(self);
		if (self->timed.step != before)
			report_step(self);
		lp_servo_hat_pulse(self->hat, lp_timed_pulse_us(&self->timed, now_ns));
	}
}

/* ---------------------------------------------------------------- ops */

static int pca9685_start(struct lp_rotator *rotator)
{
	struct rotator_pca9685 *self = self_of(rotator);

	lp_timer_set(&self->tick, 0, PERIOD_NS);
	return 0;
}

static void pca9685_move(struct lp_rotator *rotator, float target_deg)
{
	struct rotator_pca9685 *self = self_of(rotator);
	const struct lp_rotator_host *host = &self->base.host;
	const char *reason;
	char text[200];

	host->fault(host->context, "wheel-refused", NULL);
	if (lp_timed_move(&self->timed, target_deg, lp_clock_ns(), &reason) < 0) {
		(void)snprintf(text, sizeof(text),
			       "wheel: move: %.2f degrees: %s — see --help-backends",
			       (double)target_deg, reason);
		lp_warning(self->object, "move", "%.2f degrees: %s", (double)target_deg, reason);
		host->fault(host->context, "wheel-refused", text);
	}
	report_state(self);
}

/* Edges that have come and were not read yet come first. */
static void pca9685_look(struct lp_rotator *rotator)
{
	struct rotator_pca9685 *self = self_of(rotator);

	while (self->index && read_edge(self)) {
	}
	report_state(self);
}

static void pca9685_destroy(struct lp_rotator *rotator)
{
	struct rotator_pca9685 *self = self_of(rotator);

	if (!self)
		return;
	lp_timer_stop(&self->tick);
	close_all(self);
	lp_servo_hat_destroy(self->hat);
	free(self);
}

static const struct lp_param list[] = {
	{"address", LP_PARAM_HEX, offsetof(struct keys, address), .initial = "0x40", .min = 0x40,
	 .max = 0x7F, .help = "I2C address of the hat"},
	{"channel", LP_PARAM_INT, offsetof(struct keys, channel), .initial = "0", .max = 15,
	 .help = "channel of the hat to which the servo is connected"},
	{"chip", LP_PARAM_TEXT, offsetof(struct keys, chip), .initial = "gpiochip0", .max = 64,
	 .help = "GPIO chip of the comb's sensor"},
	{"line", LP_PARAM_INT, offsetof(struct keys, line), .initial = "17", .max = 1023,
	 .help = "line of the chip to which the sensor is connected"},
};
_Static_assert(offsetof(struct keys, timed) == 0, "the model's offsets hold");
static const struct lp_params params = {list, LP_COUNT(list), &lp_timed_keys};

static int create_hat(struct rotator_pca9685 *self)
{
	struct lp_servo_hat_settings settings = {.address = self->keys.address,
						 .channel = self->keys.channel};
	const struct lp_servo_hat_host host = {.context = self,
					       .loop = self->base.host.loop,
					       .ready = on_hat_ready,
					       .failed = on_hat_failed};

	memcpy(settings.device, self->device, sizeof(settings.device));
	self->hat = lp_servo_hat_create(&settings, &host);
	return self->hat ? 0 : -ENOMEM;
}

static int pca9685_create(const struct lp_uri *uri, const struct lp_rotator_host *host,
			  struct lp_rotator **rotator)
{
	struct rotator_pca9685 *self;
	int ret;

	if (!*uri->rest || strlen(uri->rest) >= sizeof(self->device)) {
		lp_error(uri->text, "parse", "name the bus: pca9685:/dev/i2c-1");
		return -EINVAL;
	}
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_rotator){.ops = &lp_rotator_pca9685_ops, .host = *host};
	memcpy(self->device, uri->rest, strlen(uri->rest) + 1);
	(void)snprintf(self->object, sizeof(self->object), "pca9685: %s", self->device);
	self->edges.fd = -1;
	self->retry = (struct lp_backoff){.first_ns = FIRST_RETRY_NS, .longest_ns = LAST_RETRY_NS};
	ret = lp_uri_read(uri, &params, &self->keys);
	if (ret == 0 && !lp_timed_check(&self->keys.timed, uri->text))
		ret = -EINVAL;
	if (ret == 0)
		ret = create_hat(self);
	if (ret < 0) {
		pca9685_destroy(&self->base);
		return ret;
	}
	self->timed.params = self->keys.timed;
	lp_timed_init(&self->timed);
	lp_timer_init(host->loop, &self->tick, on_tick);
	*rotator = &self->base;
	return 0;
}

const struct lp_rotator_ops lp_rotator_pca9685_ops = {
	.info = {.scheme = "pca9685",
		 .form = "I2C-DEVICE",
		 .help = "the wheel on a servo hat (/dev/i2c-1), with the comb's sensor on a GPIO "
			 "line",
		 .params = &params},
	.create = pca9685_create,
	.start = pca9685_start,
	.move = pca9685_move,
	.look = pca9685_look,
	.destroy = pca9685_destroy,
};
