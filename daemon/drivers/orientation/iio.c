/* SPDX-License-Identifier: Apache-2.0 */
/*
 * iio:NAME — a gyroscope through Linux's industrial I/O (libiio): an IMU on I2C, SPI or USB that
 * has a kernel driver. The kernel stamps its samples. A thread of its own opens the device, which
 * may take as long as its bus likes, reads the kernel's buffer every few milliseconds and sends the
 * samples to the loop. A gyroscope that is not there, or goes, is waited for.
 */
#include <errno.h>
#include <iio.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "base/backoff.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/text.h"
#include "base/uri.h"
#include "drivers/link/bus_thread.h"
#include "drivers/orientation/gyro.h"
#include "include/orientation.h"

extern const struct lp_orientation_ops lp_orientation_iio_ops;

#define OBJECT_BYTES 64
/* The buffer is looked at so often, and holds so much. */
#define READ_MS 10
#define HELD_S 0.5
#define MOST_AT_ONCE 256
#define LET_GO_MS 500
#define CHANNELS 4 /* x, y, z and the time */

struct keys {
	float rate_hz;
};

/* What the thread owns. */
struct gyroscope {
	struct keys keys;
	char name[OBJECT_BYTES];   /* of the device; "": the first gyroscope */
	char object[OBJECT_BYTES]; /* for messages */
	int loop_fd;		   /* to the loop, a packet a sample */
	struct lp_backoff backoff;
	struct iio_context *context; /* NULL: not open */
	struct iio_buffer *buffer;
	struct iio_channel *channels[CHANNELS];
	double scale[3], offset[3], mount[3][3];
	struct lp_gyro gyro;
	int64_t t_last_ns;
	bool is_told; /* that it is not there */
};

struct orientation_iio {
	struct lp_orientation base;
	struct gyroscope *gyroscope;  /* NULL: it is the thread's */
	struct lp_bus_thread *thread; /* NULL: not started */
	struct lp_watch watch;
};

static const struct lp_param list[] = {
	{"rate_hz", LP_PARAM_FLOAT, offsetof(struct keys, rate_hz), .initial = "200", .min = 10,
	 .max = 2000, .help = "samples a second; the driver takes the nearest that it can"},
};
static const struct lp_params params = LP_PARAMS(list);

/* ---------------------------------------------------------------- find and open */

/* Log why it cannot be used, once until it could. */
static int refuse(struct gyroscope *self, const char *stage, int error, const char *next_step)
{
	if (!self->is_told)
		lp_warning(self->object, stage, "%s — %s; it is tried again", lp_strerror(error),
			   next_step);
	self->is_told = true;
	return error;
}

/* The channels of a gyroscope that can be buffered. False: the device is none. */
static bool find_channels(struct iio_device *device, struct iio_channel *channels[CHANNELS])
{
	static const char *const names[CHANNELS] = {"anglvel_x", "anglvel_y", "anglvel_z",
						    "timestamp"};

	for (int k = 0; k < CHANNELS; k++) {
		channels[k] = iio_device_find_channel(device, names[k], false);
		if (!channels[k] || !iio_channel_is_scan_element(channels[k]))
			return false;
	}
	return true;
}

static struct iio_device *find_device(struct gyroscope *self)
{
	const unsigned int count = iio_context_get_devices_count(self->context);

	for (unsigned int i = 0; i < count; i++) {
		struct iio_device *device = iio_context_get_device(self->context, i);
		const char *name = iio_device_get_name(device);

		if (*self->name && (!name || strcmp(name, self->name) != 0) &&
		    strcmp(iio_device_get_id(device), self->name) != 0)
			continue;
		if (find_channels(device, self->channels))
			return device;
	}
	return NULL;
}

/* A sensor without a data-ready line of its own needs a trigger: the one that its driver made. */
static int set_trigger(struct gyroscope *self, struct iio_device *device)
{
	const char *name = iio_device_get_name(device);
	const unsigned int count = iio_context_get_devices_count(self->context);
	const struct iio_device *trigger = NULL;

	if (iio_device_get_trigger(device, &trigger) == 0 && trigger)
		return 0;
	for (unsigned int i = 0; name && i < count; i++) {
		trigger = iio_context_get_device(self->context, i);
		const char *its_name = iio_device_get_name(trigger);

		if (iio_device_is_trigger(trigger) && its_name &&
		    strncmp(its_name, name, strlen(name)) == 0)
			return iio_device_set_trigger(device, trigger);
	}
	return 0; /* some have a buffer in hardware, and need none */
}

static int read_scale(struct gyroscope *self, const struct iio_device *device)
{
	char text[256];
	ssize_t length;

	for (int k = 0; k < 3; k++) {
		const struct iio_channel *channel = self->channels[k];

		if (iio_channel_attr_read_double(channel, "scale", &self->scale[k]) < 0 ||
		    !(fabs(self->scale[k]) > 0.0))
			return -ENODATA;
		if (iio_channel_attr_read_double(channel, "offset", &self->offset[k]) < 0)
			self->offset[k] = 0.0;
		for (int j = 0; j < 3; j++)
			self->mount[k][j] = k == j;
	}
	length = iio_channel_attr_read(self->channels[0], "mount_matrix", text, sizeof(text));
	if (length <= 0)
		length = iio_device_attr_read(device, "mount_matrix", text, sizeof(text));
	if (length <= 0)
		return 0; /* the board's description has none: the sensor's axes are the device's */
	return lp_gyro_parse_mount(text, self->mount);
}

static int open_buffer(struct gyroscope *self, struct iio_device *device)
{
	const double rate_hz = (double)self->keys.rate_hz;
	int ret;

	for (int k = 0; k < CHANNELS; k++)
		iio_channel_enable(self->channels[k]);
	/* Some sensors have one rate only, which cannot be set. */
	if (iio_channel_attr_write_double(self->channels[0], "sampling_frequency", rate_hz) < 0)
		(void)iio_device_attr_write_double(device, "sampling_frequency", rate_hz);
	ret = (int)iio_device_attr_write(device, "current_timestamp_clock", "monotonic");
	if (ret < 0)
		return refuse(self, "set the clock of time stamps", ret,
			      "may the daemon write to this device (udev)?");
	ret = set_trigger(self, device);
	if (ret < 0)
		return refuse(self, "set the trigger", ret, "may the daemon write to it (udev)?");
	self->buffer = iio_device_create_buffer(device, (size_t)(HELD_S * rate_hz) + 2, false);
	if (!self->buffer)
		return refuse(self, "open its buffer", -errno,
			      "does another program read it (iiod, iio-sensor-proxy), may the "
			      "daemon (udev), has it a trigger?");
	ret = iio_buffer_set_blocking_mode(self->buffer, false);
	return ret < 0 ? refuse(self, "read without waiting", ret, "report this") : 0;
}

static int open_device(struct gyroscope *self)
{
	struct iio_device *device;
	int ret;

	self->context = iio_create_local_context();
	if (!self->context)
		return refuse(self, "open", -errno, "has this kernel industrial I/O?");
	device = find_device(self);
	if (!device)
		return refuse(self, "find", -ENODEV,
			      "is the gyroscope connected, and its driver loaded (iio_info)?");
	ret = read_scale(self, device);
	if (ret == -EINVAL)
		return refuse(self, "read its mount matrix", ret,
			      "correct it in the board's description: it must be a rotation");
	if (ret < 0)
		return refuse(self, "read its scale", ret, "is its driver complete?");
	return open_buffer(self, device);
}

static void close_device(struct gyroscope *self)
{
	if (self->buffer)
		iio_buffer_destroy(self->buffer);
	if (self->context)
		iio_context_destroy(self->context);
	self->buffer = NULL;
	self->context = NULL;
}

/* ---------------------------------------------------------------- read */

/* A number of channel `k` at `from`, whatever its size. */
static int64_t number_at(const struct gyroscope *self, int k, const void *from)
{
	const struct iio_data_format *format = iio_channel_get_data_format(self->channels[k]);
	union {
		int8_t of_8;
		int16_t of_16;
		int32_t of_32;
		int64_t of_64;
	} value = {0};

	iio_channel_convert(self->channels[k], &value, from);
	switch (format->length) {
	case 8:
		return value.of_8;
	case 16:
		return value.of_16;
	case 32:
		return value.of_32;
	default:
		return value.of_64;
	}
}

static void take_sample(struct gyroscope *self, const uint8_t *const at[CHANNELS])
{
	struct lp_orientation_sample sample = {.kind = LP_TURN_RATE,
					       .t_ns = number_at(self, 3, at[3])};
	double rate[3];

	for (int k = 0; k < 3; k++)
		rate[k] = self->scale[k] * ((double)number_at(self, k, at[k]) + self->offset[k]);
	if (sample.t_ns <= self->t_last_ns || !lp_gyro_rate(&self->gyro, sample.t_ns, rate))
		return;
	self->t_last_ns = sample.t_ns;
	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			sample.rate_rad_s[i] += self->mount[i][j] * rate[j];
	sample.sigma = self->gyro.sigma_rad_s;
	/* A loop that is busy for so long that the socket is full needs no old samples. */
	(void)send(self->loop_fd, &sample, sizeof(sample), MSG_DONTWAIT | MSG_NOSIGNAL);
}

static void take_samples(struct gyroscope *self)
{
	const ptrdiff_t step = iio_buffer_step(self->buffer);
	const uint8_t *end = iio_buffer_end(self->buffer);
	const uint8_t *at[CHANNELS];

	for (int k = 0; k < CHANNELS; k++)
		at[k] = iio_buffer_first(self->buffer, self->channels[k]);
	while (at[3] < end) {
		take_sample(self, at);
		for (int k = 0; k < CHANNELS; k++)
			at[k] += step;
	}
}

/* One step: open it, or read what there is. Returns when the next is due, in ms. */
static int step(struct gyroscope *self)
{
	if (!self->buffer) {
		if (open_device(self) < 0) {
			close_device(self);
			return (int)(lp_backoff_next_ns(&self->backoff) / LP_NS_PER_MS);
		}
		lp_info(self->object, "open", "samples are read");
		self->is_told = false;
		self->gyro = (struct lp_gyro){0}; /* it may be another one */
		return READ_MS;
	}
	const ssize_t ret = iio_buffer_refill(self->buffer);

	if (ret > 0) {
		lp_backoff_reset(&self->backoff);
		take_samples(self);
	} else if (ret < 0 && ret != -EAGAIN) {
		(void)refuse(self, "read", (int)ret, "has it been unplugged?");
		close_device(self);
	}
	return READ_MS;
}

static void run(void *context, int fd)
{
	struct gyroscope *self = context;
	struct pollfd loop = {.fd = fd, .events = POLLIN};

	self->loop_fd = fd;
	while (poll(&loop, 1, step(self)) <= 0)
		; /* the loop sends nothing: it hangs up */
	close_device(self);
}

static void finish(void *context)
{
	free(context);
}

/* ---------------------------------------------------------------- the role */

static struct orientation_iio *self_of(const struct lp_orientation *orientation)
{
	return (struct orientation_iio *)orientation;
}

static void on_samples(struct lp_watch *watch, unsigned int events)
{
	struct orientation_iio *self = LP_CONTAINER_OF(watch, struct orientation_iio, watch);
	struct lp_orientation_sample sample;

	(void)events;
	for (int i = 0; i < MOST_AT_ONCE; i++) {
		if (recv(watch->fd, &sample, sizeof(sample), MSG_DONTWAIT) !=
		    (ssize_t)sizeof(sample))
			return;
		self->base.host.sample(self->base.host.context, &sample);
	}
}

static int iio_start(struct lp_orientation *orientation)
{
	struct orientation_iio *self = self_of(orientation);
	const struct lp_bus_job job = {.context = self->gyroscope, .run = run, .finish = finish};
	int ret = lp_bus_thread_start(&job, &self->thread);

	if (ret < 0) {
		lp_error(self->gyroscope->object, "start its thread", "%s", lp_strerror(ret));
		return ret;
	}
	self->gyroscope = NULL;
	ret = lp_watch_start(self->base.host.loop, &self->watch, lp_bus_thread_fd(self->thread),
			     LP_READABLE, on_samples);
	if (ret < 0)
		lp_error("iio", "watch", "%s", lp_strerror(ret));
	return ret;
}

static void iio_destroy(struct lp_orientation *orientation)
{
	struct orientation_iio *self = self_of(orientation);

	if (!self)
		return;
	lp_watch_stop(&self->watch);
	lp_bus_thread_destroy(self->thread, LET_GO_MS);
	free(self->gyroscope);
	free(self);
}

static int iio_create(const struct lp_uri *uri, const struct lp_orientation_host *host,
		      struct lp_orientation **orientation)
{
	struct orientation_iio *self = calloc(1, sizeof(*self));
	struct gyroscope *gyroscope = calloc(1, sizeof(*gyroscope));
	int ret = self && gyroscope ? lp_uri_read(uri, &params, &gyroscope->keys) : -ENOMEM;

	if (ret < 0) {
		free(gyroscope);
		free(self);
		return ret;
	}
	gyroscope->backoff =
		(struct lp_backoff){.first_ns = LP_NS_PER_S / 2, .longest_ns = 5 * LP_NS_PER_S};
	lp_text_copy(gyroscope->name, sizeof(gyroscope->name), uri->rest);
	(void)snprintf(gyroscope->object, sizeof(gyroscope->object), "iio:%.40s", uri->rest);
	*self = (struct orientation_iio){.base = {.ops = &lp_orientation_iio_ops, .host = *host},
					 .gyroscope = gyroscope,
					 .watch = {.fd = -1}};
	*orientation = &self->base;
	return 0;
}

const struct lp_orientation_ops lp_orientation_iio_ops = {
	.info = {.scheme = "iio",
		 .form = "[NAME]",
		 .help = "a gyroscope that Linux knows as an IIO device\n"
			 "NAME as iio_info lists it; without it the first gyroscope.\n"
			 "How it sits in the probe is said by --mount.",
		 .params = &params},
	.create = iio_create,
	.start = iio_start,
	.destroy = iio_destroy,
};
