/* SPDX-License-Identifier: Apache-2.0 */
/* i2c:/dev/i2c-1?mux=0x70 — a ring of nine colour sensors on an I2C bus (scan.h). */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/text.h"
#include "base/uri.h"
#include "drivers/link/bus_thread.h"
#include "drivers/ring/veml6040/scan.h"
#include "include/ring.h"

extern const struct lp_ring_ops lp_ring_i2c_ops;

#define PERIOD_MS 50 /* the shortest integration time takes 40 */
#define LOOK_NS (250 * LP_NS_PER_MS)
#define HANGS_NS (3 * LP_NS_PER_S) /* without a scan */
#define END_MS 200

#define WAITING "ring-i2c-waiting"
#define MISSING "ring-sensor-missing"
#define SATURATED "ring-saturated"

/* The data sheet states no tolerances. Each sensor by itself: its gain and its seat; all together:
 * their green is not quite the eye's luminance. Chosen by hand. */
#define OWN_SIGMA 0.05F
#define COMMON_SIGMA 0.1F
#define COLOUR_SIGMA 0.05F

struct keys {
	int mux, mux_up;
	float cover, red_gain, blue_gain;
};

struct ring_i2c {
	struct lp_ring base;
	struct keys keys;
	char device[256], object[300];
	struct lp_watch scans;
	struct lp_timer tick;
	struct lp_bus_thread *thread; /* NULL: none */
	struct lp_backoff retry;
	int64_t t_retry_ns, heard_ns;
	uint32_t sequence;
	uint32_t missing, saturated; /* bit k: this fault of sensor k has been reported */
	bool waits;		     /* a bus that cannot be read has been reported */
};

/* The thread's own. */
struct reader {
	char device[256];
	struct lp_veml6040_bus bus;
	struct lp_veml6040_scan scan;
};

/* From the thread to the loop. */
struct report {
	int error; /* -errno of open or of a whole scan; the thread has given up */
	bool opened;
	struct lp_veml6040_scan scan;
};

static const struct lp_param list[] = {
	{"mux", LP_PARAM_HEX, offsetof(struct keys, mux), .initial = "0x70", .min = 0x70,
	 .max = 0x77, .help = "TCA9548A with sensors 0 to 7 at its channels"},
	{"mux_up", LP_PARAM_HEX, offsetof(struct keys, mux_up), .initial = "0x71", .min = 0x70,
	 .max = 0x77, .help = "TCA9548A with sensor 8, the one that looks up, at channel 0"},
	{"cover", LP_PARAM_FLOAT, offsetof(struct keys, cover), .initial = "1", .min = 0.001,
	 .max = 1, .help = "share of the light that a diffuser over the sensors lets through"},
	{"red_gain", LP_PARAM_FLOAT, offsetof(struct keys, red_gain), .initial = "1", .min = 0.1,
	 .max = 10, .help = "counts of green over those of red, under daylight"},
	{"blue_gain", LP_PARAM_FLOAT, offsetof(struct keys, blue_gain), .initial = "1", .min = 0.1,
	 .max = 10, .help = "likewise of blue"},
};
static const struct lp_params params = LP_PARAMS(list);

/* ---------------------------------------------------------------- the thread */

static void read_bus(void *context, int fd)
{
	struct reader *reader = context;
	struct pollfd waiting = {.fd = fd};

	reader->bus.fd = open(reader->device, O_RDWR | O_CLOEXEC);
	struct report report = {.error = reader->bus.fd < 0 ? -errno : 0};

	while (report.error == 0 && !(waiting.revents & (POLLHUP | POLLERR))) {
		report.opened = true;
		report.error = lp_veml6040_scan(&reader->bus, &reader->scan);
		report.scan = reader->scan;
		(void)send(fd, &report, sizeof(report), MSG_NOSIGNAL | MSG_DONTWAIT);
		(void)poll(&waiting, 1, PERIOD_MS);
	}
	if (!report.opened)
		(void)send(fd, &report, sizeof(report), MSG_NOSIGNAL);
}

static void finish_reader(void *context)
{
	struct reader *reader = context;

	if (reader->bus.fd >= 0)
		close(reader->bus.fd);
	free(reader);
}

/* ---------------------------------------------------------------- the loop */

static struct ring_i2c *self_of(const struct lp_ring *ring)
{
	return (struct ring_i2c *)ring;
}

static void close_bus(struct ring_i2c *self)
{
	if (self->scans.fd >= 0)
		lp_watch_stop(&self->scans);
	if (self->thread)
		lp_bus_thread_end(self->thread);
}

static const char *next_step(bool opened, int error)
{
	if (error == -ETIMEDOUT)
		return "the bus hangs: check SDA, SCL and their pull-ups";
	if (opened)
		return "does the multiplexer answer? i2cdetect -y N";
	if (error == -EACCES)
		return "join group i2c, or install drop-in i2c.conf";
	return "is I2C switched on? load module i2c-dev";
}

static void lose(struct ring_i2c *self, bool opened, int error)
{
	const struct lp_ring_host *host = &self->base.host;
	char text[600];

	close_bus(self);
	self->t_retry_ns = lp_clock_ns() + lp_backoff_next_ns(&self->retry);
	(void)snprintf(text, sizeof(text), "%s: %s: %s — %s", self->object,
		       opened ? "read" : "open", lp_strerror(error), next_step(opened, error));
	if (!self->waits)
		lp_warning(self->object, opened ? "read" : "open", "%s — %s", lp_strerror(error),
			   next_step(opened, error));
	self->waits = true;
	host->fault(host->context, WAITING, text);
}

/* Tell which sensors have a fault, when that has changed. */
static void tell(struct ring_i2c *self, const char *id, uint32_t now, uint32_t *told,
		 const char *words)
{
	const struct lp_ring_host *host = &self->base.host;
	char sensors[32], text[200];

	if (now == *told)
		return;
	*told = now;
	lp_text_list_bits(sensors, sizeof(sensors), now);
	(void)snprintf(text, sizeof(text), "ring: sensor %s: %s", sensors, words);
	if (now)
		lp_warning(self->object, "sensor", "%s: %s", sensors, words);
	host->fault(host->context, id, now ? text : NULL);
}

static void take_sensor(const struct ring_i2c *self, const struct lp_veml6040 *sensor, int k,
			struct lp_ring_sample *sample)
{
	const float lux = lp_veml6040_lux_per_count(sensor->step) / self->keys.cover;
	const float gains[3] = {self->keys.red_gain, 1.0F, self->keys.blue_gain};
	const float half_count = 0.5F / fmaxf(sensor->counts[1], 1.0F);
	const bool known = sensor->has_counts && !lp_veml6040_is_saturated(sensor);

	for (int c = 0; c < 3; c++)
		sample->rgb[k][c] = known ? gains[c] * lux * sensor->counts[c] : NAN;
	sample->illuminance_lux[k] = sample->rgb[k][1];
	/* and half a count, of the smallest colour */
	sample->sigma_relative[k] = known ? hypotf(OWN_SIGMA, half_count) : NAN;
	sample->noise_relative[k] = half_count;
}

static void take(struct ring_i2c *self, const struct lp_veml6040_scan *scan)
{
	const struct lp_ring_host *host = &self->base.host;
	struct lp_ring_sample sample = {.t_ns = scan->t_ns,
					.sequence = ++self->sequence,
					.colour_sigma = COLOUR_SIGMA,
					.common_sigma = COMMON_SIGMA};
	uint32_t missing = 0, saturated = 0;
	bool any = false;

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const struct lp_veml6040 *sensor = &scan->sensors[k];

		take_sensor(self, sensor, k, &sample);
		const uint32_t bit = UINT32_C(1) << k;

		any |= sensor->has_counts;
		if (sensor->error < 0)
			missing |= bit;
		else if (!sensor->has_counts) { /* set up, and not read yet: nothing is over */
			missing |= self->missing & bit;
			saturated |= self->saturated & bit;
		} else if (lp_veml6040_is_saturated(sensor))
			saturated |= bit;
	}
	tell(self, MISSING, missing, &self->missing,
	     "does not answer — check its wires and its channel of the multiplexer");
	tell(self, SATURATED, saturated, &self->saturated,
	     "too bright — put a diffuser over the ring (cover=)");
	if (self->waits && any) {
		self->waits = false;
		lp_info(self->object, "read", "colour sensors found");
		host->fault(host->context, WAITING, NULL);
	}
	if (any)
		lp_backoff_reset(&self->retry);
	host->sample(host->context, &sample);
}

/* The newest report counts: a loop that is slower than the bus falls no further behind. */
static void on_scan(struct lp_watch *watch, unsigned int events)
{
	struct ring_i2c *self = LP_CONTAINER_OF(watch, struct ring_i2c, scans);
	struct report report;
	bool any = false;

	(void)events;
	while (recv(watch->fd, &report, sizeof(report), MSG_DONTWAIT) == sizeof(report))
		any = true;
	if (!any)
		return;
	self->heard_ns = lp_clock_ns();
	if (report.error < 0)
		lose(self, report.opened, report.error);
	else
		take(self, &report.scan);
}

/* A transfer from before may still hang: then later. */
static int open_bus(struct ring_i2c *self)
{
	struct lp_bus_job job = {.run = read_bus, .finish = finish_reader};
	struct reader *reader;
	int ret;

	if (self->thread && !lp_bus_thread_has_ended(self->thread))
		return -ETIMEDOUT;
	lp_bus_thread_destroy(self->thread, 0);
	self->thread = NULL;
	reader = calloc(1, sizeof(*reader));
	if (!reader)
		return -ENOMEM;
	memcpy(reader->device, self->device, sizeof(reader->device));
	reader->bus = (struct lp_veml6040_bus){-1, {self->keys.mux, self->keys.mux_up}};
	job.context = reader;
	ret = lp_bus_thread_start(&job, &self->thread);
	if (ret < 0) {
		free(reader);
		return ret;
	}
	self->heard_ns = lp_clock_ns();
	return lp_watch_start(self->base.host.loop, &self->scans, lp_bus_thread_fd(self->thread),
			      LP_READABLE, on_scan);
}

static void on_tick(struct lp_timer *timer)
{
	struct ring_i2c *self = LP_CONTAINER_OF(timer, struct ring_i2c, tick);
	const int64_t now_ns = lp_clock_ns();

	if (self->scans.fd >= 0) {
		if (now_ns - self->heard_ns > HANGS_NS)
			lose(self, true, -ETIMEDOUT);
	} else if (now_ns >= self->t_retry_ns) {
		const int ret = open_bus(self);

		if (ret < 0)
			lose(self, ret == -ETIMEDOUT, ret);
	}
}

/* ---------------------------------------------------------------- ops */

static int i2c_start(struct lp_ring *ring)
{
	lp_timer_set(&self_of(ring)->tick, 0, LOOK_NS);
	return 0;
}

static void i2c_destroy(struct lp_ring *ring)
{
	struct ring_i2c *self = self_of(ring);

	if (!self)
		return;
	lp_timer_stop(&self->tick);
	close_bus(self);
	lp_bus_thread_destroy(self->thread, END_MS);
	free(self);
}

static int i2c_create(const struct lp_uri *uri, const struct lp_ring_host *host,
		      struct lp_ring **ring)
{
	struct ring_i2c *self;
	struct keys keys;
	int ret = lp_uri_read(uri, &params, &keys);

	if (ret < 0)
		return ret;
	if (!*uri->rest || strlen(uri->rest) >= sizeof(self->device)) {
		lp_error(uri->text, "parse", "name the bus: i2c:/dev/i2c-1");
		return -EINVAL;
	}
	if (keys.mux == keys.mux_up) {
		lp_error(uri->text, "mux_up", "0x%x is the address of mux, too — wire A0 of one",
			 (unsigned int)keys.mux_up);
		return -EINVAL;
	}
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	*self = (struct ring_i2c){.base = {.ops = &lp_ring_i2c_ops, .host = *host},
				  .keys = keys,
				  .scans = {.fd = -1},
				  .retry = {.first_ns = LP_NS_PER_S / 2,
					    .longest_ns = 8 * LP_NS_PER_S}};
	memcpy(self->device, uri->rest, strlen(uri->rest) + 1);
	(void)snprintf(self->object, sizeof(self->object), "i2c:%s", self->device);
	lp_timer_init(host->loop, &self->tick, on_tick);
	*ring = &self->base;
	return 0;
}

const struct lp_ring_ops lp_ring_i2c_ops = {
	.info = {.scheme = "i2c",
		 .form = "I2C-DEVICE",
		 .help = "nine colour sensors VEML6040 behind two multiplexers TCA9548A\n"
			 "I2C-DEVICE is that of the bus, such as /dev/i2c-1.",
		 .params = &params},
	.create = i2c_create,
	.start = i2c_start,
	.destroy = i2c_destroy,
};
