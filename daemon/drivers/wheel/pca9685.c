/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pca9685:I2C-DEVICE — the wheel on a servo hat, straight on the board's I2C bus, and one sensor of
 * the comb on a GPIO line. What is known of the wheel: timed.h.
 *
 * The pulse is renewed every 20 ms by one transfer of five bytes, half a millisecond at 100 kHz.
 */
#include <errno.h>
#include <fcntl.h>
#include <gpiod.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/wheel/guard.h"
#include "drivers/wheel/timed.h"
#include "include/rotator.h"

#define MODE1 0x00
#define MODE1_SLEEP 0x10
#define MODE1_INCREMENT 0x20
#define LED0 0x06
#define FULL_OFF 0x10
#define PRE_SCALE 0xFE
#define PRE_SCALE_50_HZ 121 /* 25 MHz / 4096 / 50 Hz - 1 */
#define COUNTS_PER_US (4096 * 50 / 1e6F)
#define PERIOD_NS (20 * LP_NS_PER_MS)
#define BUS_TIMEOUT_10MS 1
#define FIRST_RETRY_NS (200 * LP_NS_PER_MS)
#define LAST_RETRY_NS (2 * LP_NS_PER_S)
#define WAITING "pca9685-waiting"
#define STOPPED "; tried three times: to try again restart lightprobed"

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
	const char *told_fault;
	bool told_stopped;
	struct lp_timer tick;
	struct lp_watch edges;
	int bus_fd;   /* -1: not open */
	int guard_fd; /* ends the pulses should this program die; -1: none */
	struct gpiod_chip *chip;
	struct gpiod_line *line;
	int64_t t_retry_ns;
	struct lp_backoff retry;
	uint64_t opened;
};

static struct rotator_pca9685 *self_of(const struct lp_rotator *rotator)
{
	return (struct rotator_pca9685 *)rotator;
}

/* ---------------------------------------------------------------- what is told */

static void tell(const struct rotator_pca9685 *self)
{
	struct lp_wheel_state state;

	lp_timed_state(&self->timed, lp_clock_ns(), &state);
	if (self->bus_fd < 0)
		state.phase = LP_WHEEL_ABSENT;
	state.reconnects = self->opened ? self->opened - 1 : 0;
	self->base.host.state(self->base.host.context, &state);
}

/* The model's fault, when it has changed. */
static void tell_fault(struct rotator_pca9685 *self)
{
	const struct lp_rotator_host *host = &self->base.host;
	const char *fault = self->timed.fault;
	char text[500];

	if (fault == self->told_fault && self->timed.stopped == self->told_stopped)
		return;
	if (self->told_fault)
		host->fault(host->context, self->told_fault, NULL);
	if (fault) {
		(void)snprintf(text, sizeof(text), "%s: %s: %s%s", self->object, fault,
			       self->timed.next_step, self->timed.stopped ? STOPPED : "");
		lp_warning(self->object, fault, "%s%s", self->timed.next_step,
			   self->timed.stopped ? STOPPED : "");
		host->fault(host->context, fault, text);
	}
	self->told_fault = fault;
	self->told_stopped = self->timed.stopped;
}

/* ---------------------------------------------------------------- the hat */

/* 0 or -errno. Safe after fork(), as write_pulse() is. */
static int write_registers(int bus_fd, const struct keys *keys, uint8_t *bytes, uint16_t count)
{
	struct i2c_msg message = {.addr = (uint16_t)keys->address, .len = count, .buf = bytes};
	struct i2c_rdwr_ioctl_data request = {.msgs = &message, .nmsgs = 1};

	return ioctl(bus_fd, I2C_RDWR, &request) < 0 ? -errno : 0;
}

static int write_register(const struct rotator_pca9685 *self, uint8_t number, uint8_t value)
{
	return write_registers(self->bus_fd, &self->keys, (uint8_t[]){number, value}, 2);
}

/* 0: no pulse; the model gives no other outside of the servo's limits. */
static int write_pulse(int bus_fd, const struct keys *keys, float pulse_us)
{
	const uint16_t off = (uint16_t)lrintf(pulse_us * COUNTS_PER_US);

	return write_registers(bus_fd, keys,
			       (uint8_t[]){(uint8_t)(LED0 + 4 * keys->channel), 0, 0,
					   (uint8_t)(off & 0xFF),
					   off ? (uint8_t)(off >> 8) : FULL_OFF},
			       5);
}

static void end_pulses(int bus_fd, const void *context)
{
	(void)write_pulse(bus_fd, context, 0);
}

/* The pre-scaler can be set while it sleeps only. */
static int wake_up(const struct rotator_pca9685 *self)
{
	int ret = write_register(self, MODE1, MODE1_SLEEP | MODE1_INCREMENT);

	if (ret == 0)
		ret = write_register(self, PRE_SCALE, PRE_SCALE_50_HZ);
	if (ret == 0)
		ret = write_pulse(self->bus_fd, &self->keys, 0);
	if (ret == 0)
		ret = write_register(self, MODE1, MODE1_INCREMENT);
	return ret;
}

/* ---------------------------------------------------------------- the sensor */

/* The oldest edge that has not been read. False: none. */
static bool read_edge(struct rotator_pca9685 *self)
{
	struct gpiod_line_event event;

	if (gpiod_line_event_read(self->line, &event) < 0)
		return false;
	lp_timed_edge(&self->timed, event.ts.tv_sec * LP_NS_PER_S + event.ts.tv_nsec);
	tell_fault(self);
	return true;
}

static void on_edges(struct lp_watch *watch, unsigned int events)
{
	struct rotator_pca9685 *self = LP_CONTAINER_OF(watch, struct rotator_pca9685, edges);

	(void)events;
	if (read_edge(self))
		tell(self);
}

static int open_sensor(struct rotator_pca9685 *self)
{
	self->chip = gpiod_chip_open_lookup(self->keys.chip);
	if (!self->chip)
		return -errno;
	self->line = gpiod_chip_get_line(self->chip, (unsigned)self->keys.line);
	if (!self->line ||
	    gpiod_line_request_both_edges_events_flags(self->line, "lightprobed",
						       GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP) < 0)
		return -errno;
	return lp_watch_start(self->base.host.loop, &self->edges,
			      gpiod_line_event_get_fd(self->line), LP_READABLE, on_edges);
}

/* ---------------------------------------------------------------- open, close */

static void close_all(struct rotator_pca9685 *self)
{
	lp_watch_stop(&self->edges);
	if (self->chip)
		gpiod_chip_close(self->chip);
	self->chip = NULL;
	self->line = NULL;
	if (self->bus_fd >= 0) {
		(void)write_pulse(self->bus_fd, &self->keys, 0);
		close(self->bus_fd);
	}
	lp_guard_release(self->guard_fd);
	self->bus_fd = self->guard_fd = -1;
}

static const char *next_step(int ret, const char *stage)
{
	if (ret == -EACCES)
		return "join the groups i2c and gpio";
	if (strcmp(stage, "index") == 0)
		return "which GPIO chip and line? gpioinfo lists them";
	if (ret == -ENXIO || ret == -EREMOTEIO)
		return "no acknowledge: address and power of the hat?";
	return "is the bus there? modprobe i2c-dev, or its overlay";
}

static void lose(struct rotator_pca9685 *self, const char *stage, int ret)
{
	const struct lp_rotator_host *host = &self->base.host;
	char text[600];

	close_all(self);
	lp_timed_forget(&self->timed, lp_clock_ns());
	self->t_retry_ns = lp_clock_ns() + lp_backoff_next_ns(&self->retry);
	(void)snprintf(text, sizeof(text), "%s: %s: %s — %s", self->object, stage, lp_strerror(ret),
		       next_step(ret, stage));
	lp_warning(self->object, stage, "%s — %s", lp_strerror(ret), next_step(ret, stage));
	host->fault(host->context, WAITING, text);
	tell_fault(self);
	tell(self);
}

static void open_all(struct rotator_pca9685 *self)
{
	const struct lp_rotator_host *host = &self->base.host;
	const char *stage = "open";
	int ret = 0;

	self->bus_fd = open(self->device, O_RDWR | O_CLOEXEC);
	if (self->bus_fd < 0)
		ret = -errno;
	if (ret == 0) {
		stage = "set up";
		(void)ioctl(self->bus_fd, I2C_TIMEOUT, BUS_TIMEOUT_10MS);
		ret = wake_up(self);
	}
	if (ret == 0) {
		stage = "guard";
		self->guard_fd = lp_guard_start(self->bus_fd, end_pulses, &self->keys);
		ret = self->guard_fd < 0 ? self->guard_fd : 0;
	}
	if (ret == 0) {
		stage = "index";
		ret = open_sensor(self);
	}
	if (ret < 0) {
		lose(self, stage, ret);
		return;
	}
	self->opened++;
	lp_backoff_reset(&self->retry);
	lp_timed_forget(&self->timed, lp_clock_ns());
	host->fault(host->context, WAITING, NULL);
	lp_info(self->object, "open", "servo hat and index are there");
}

static void on_tick(struct lp_timer *timer)
{
	struct rotator_pca9685 *self = LP_CONTAINER_OF(timer, struct rotator_pca9685, tick);
	const int64_t now_ns = lp_clock_ns();
	const enum lp_timed_step before = self->timed.step;
	int ret;

	if (self->bus_fd < 0) {
		if (now_ns >= self->t_retry_ns)
			open_all(self);
		return;
	}
	lp_timed_tick(&self->timed, now_ns, gpiod_line_get_value(self->line) == 0);
	ret = write_pulse(self->bus_fd, &self->keys, lp_timed_pulse_us(&self->timed, now_ns));
	if (ret < 0) {
		lose(self, "write", ret);
		return;
	}
	tell_fault(self);
	if (self->timed.step != before)
		tell(self);
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
		(void)snprintf(text, sizeof(text), "wheel: move: %.2f degrees: %s — see --help",
			       (double)target_deg, reason);
		lp_warning(self->object, "move", "%.2f degrees: %s", (double)target_deg, reason);
		host->fault(host->context, "wheel-refused", text);
	}
	tell(self);
}

/* Edges that have come and were not read yet come first. */
static void pca9685_look(struct lp_rotator *rotator)
{
	struct rotator_pca9685 *self = self_of(rotator);

	while (self->line && read_edge(self)) {
	}
	tell(self);
}

static void pca9685_destroy(struct lp_rotator *rotator)
{
	struct rotator_pca9685 *self = self_of(rotator);

	if (!self)
		return;
	close_all(self);
	lp_timer_stop(&self->tick);
	free(self);
}

static int parse_address(const char *text, void *field)
{
	char *end;
	const long address = strtol(text, &end, 0);

	if (end == text || *end || address < 0x40 || address > 0x7F)
		return -EINVAL;
	*(int *)field = (int)address;
	return 0;
}

#define OWN_KEYS 4
#define MOST_KEYS 20

/* The hat's keys and the model's in one table: its fields begin the structure. */
static int read_keys(const struct lp_uri *uri, struct keys *keys)
{
	struct lp_param table[MOST_KEYS] = {
		{"address", LP_PARAM_OWN, offsetof(struct keys, address), .initial = "0x40",
		 .parse = parse_address, .expects = "an I2C address, 0x40..0x7f"},
		{"channel", LP_PARAM_INT, offsetof(struct keys, channel), .initial = "0",
		 .max = 15},
		{"chip", LP_PARAM_TEXT, offsetof(struct keys, chip), .initial = "gpiochip0",
		 .max = 64},
		{"line", LP_PARAM_INT, offsetof(struct keys, line), .initial = "17", .max = 1023},
	};

	_Static_assert(offsetof(struct keys, timed) == 0, "the model's offsets hold");
	memcpy(table + OWN_KEYS, lp_timed_param_table,
	       (size_t)lp_timed_param_count * sizeof(table[0]));
	return lp_uri_read(uri, table, OWN_KEYS + (size_t)lp_timed_param_count, keys);
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
	self->bus_fd = self->guard_fd = self->edges.fd = -1;
	self->retry = (struct lp_backoff){.first_ns = FIRST_RETRY_NS, .longest_ns = LAST_RETRY_NS};
	ret = read_keys(uri, &self->keys);
	if (ret == 0 && !lp_timed_check(&self->keys.timed, uri->text))
		ret = -EINVAL;
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
	.scheme = "pca9685",
	.help = "pca9685:I2C-DEVICE  the wheel on a servo hat (/dev/i2c-1), one sensor of its "
		"comb\n"
		"      on a GPIO line ?address=0x40 &channel=0 &chip=gpiochip0 &line=17\n"
		"      &servo_min_us=500 &servo_max_us=2500\n"
		"      &servo_zero_us=800 &servo_us_per_deg=7.407 &slew_deg_s=90 &lag_ms=40\n"
		"      &settle_ms=200 &hold_s=10 &first_deg=-16.5 &pitch_deg=6 &edges=34\n"
		"      &edge_error_deg=0.3 &tolerance_deg=6 &slew_physical_deg_s=900",
	.create = pca9685_create,
	.start = pca9685_start,
	.move = pca9685_move,
	.look = pca9685_look,
	.destroy = pca9685_destroy,
};
