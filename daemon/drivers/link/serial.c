/* SPDX-License-Identifier: Apache-2.0 */
/* serial:DEVICE — messages over a serial line: USB (ttyUSB, ttyACM), a UART, or a pty. */
#include <errno.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/macros.h"
#include "drivers/link/carrier.h"
#include "drivers/link/envelope.h"

#define OUTBOX_BYTES 512
#define READ_BYTES 4096 /* of one dispatch: 80 ms of the line */

struct link_serial {
	struct lp_link base;
	char device[256];
	int baud;
	struct lp_watch watch;
	struct lp_serial_reader reader;
	uint8_t outbox[OUTBOX_BYTES];
	size_t out_bytes;
};

static struct link_serial *self_of(const struct lp_link *link)
{
	return (struct link_serial *)link;
}

static int speed_of(int baud, speed_t *speed)
{
	static const struct {
		int baud;
		speed_t speed;
	} known[] = {{115200, B115200}, {230400, B230400}, {500000, B500000}, {1000000, B1000000}};

	for (size_t i = 0; i < LP_COUNT(known); i++) {
		if (known[i].baud == baud) {
			*speed = known[i].speed;
			return 0;
		}
	}
	return -EINVAL;
}

/* Without this a USB converter may hold bytes back for 16 ms. Not every driver knows it. */
static void ask_for_low_latency(int fd)
{
	struct serial_struct serial;

	if (ioctl(fd, TIOCGSERIAL, &serial) == 0) {
		serial.flags |= ASYNC_LOW_LATENCY;
		(void)ioctl(fd, TIOCSSERIAL, &serial);
	}
}

static int configure(const struct link_serial *self, int fd, const char **reason)
{
	struct termios settings;
	speed_t speed;

	/* As lightprobe's tools do; it ends with the descriptor, however this program ends. */
	*reason = "is another program using it? lightprobe mcu, or another lightprobed";
	if (flock(fd, LOCK_EX | LOCK_NB) < 0)
		return errno == EWOULDBLOCK ? -EBUSY : -errno;
	*reason = "not a serial line, or it does not support this rate";
	if (speed_of(self->baud, &speed) < 0 || tcgetattr(fd, &settings) < 0)
		return errno ? -errno : -EINVAL;
	cfmakeraw(&settings);
	/* No HUPCL: closing the line must not reset the board. */
	settings.c_cflag = CS8 | CREAD | CLOCAL;
	settings.c_cc[VMIN] = 0;
	settings.c_cc[VTIME] = 0;
	if (cfsetspeed(&settings, speed) < 0 || tcsetattr(fd, TCSANOW, &settings) < 0)
		return -errno;
	ask_for_low_latency(fd);
	return tcflush(fd, TCIOFLUSH) < 0 ? -errno : 0;
}

static void serial_close(struct lp_link *link)
{
	struct link_serial *self = self_of(link);
	const int fd = self->watch.fd;

	if (fd < 0)
		return;
	lp_watch_stop(&self->watch);
	close(fd);
}

static void flush(struct link_serial *self)
{
	const ssize_t sent = write(self->watch.fd, self->outbox, self->out_bytes);

	if (sent > 0) {
		self->out_bytes -= (size_t)sent;
		memmove(self->outbox, self->outbox + sent, self->out_bytes);
	}
	lp_watch_change(&self->watch, self->out_bytes ? LP_READABLE | LP_WRITABLE : LP_READABLE);
}

/* Handing a message on may close the line. */
static void read_line(struct link_serial *self)
{
	const struct lp_link_host *host = &self->base.host;
	uint8_t bytes[READ_BYTES];
	const ssize_t got = read(self->watch.fd, bytes, sizeof(bytes));
	const int64_t t_ns = lp_clock_ns();
	struct lp_link_message message;

	if (got < 0 && (errno == EAGAIN || errno == EINTR))
		return;
	if (got <= 0) {
		host->lost(host->context, "read",
			   got < 0 ? lp_strerror(errno) : "the device is gone — is it plugged in?");
		return;
	}
	for (ssize_t i = 0; i < got && self->watch.fd >= 0; i++) {
		if (lp_serial_read(&self->reader, bytes[i], &message))
			host->received(host->context, &message, t_ns);
	}
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct link_serial *self = LP_CONTAINER_OF(watch, struct link_serial, watch);

	if (events & LP_WRITABLE)
		flush(self);
	if (events & (LP_READABLE | LP_HANGUP))
		read_line(self);
}

static int serial_open(struct lp_link *link, const char **reason)
{
	struct link_serial *self = self_of(link);
	const int fd = open(self->device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
	int ret;

	if (fd < 0) {
		*reason = errno == EACCES  ? "join the group dialout, or install the udev rule"
			  : errno == EBUSY ? "is another program using it?"
					   : "is it plugged in?";
		return -errno;
	}
	errno = 0;
	ret = configure(self, fd, reason);
	if (ret == 0) {
		memset(&self->reader, 0, sizeof(self->reader));
		self->outbox[0] = 0; /* ends half a frame, if one was sent before us */
		self->out_bytes = 1;
		ret = lp_watch_start(link->host.loop, &self->watch, fd, LP_READABLE | LP_WRITABLE,
				     on_ready);
	}
	if (ret < 0)
		close(fd);
	return ret;
}

static int serial_send(struct lp_link *link, const struct lp_link_message *message)
{
	struct link_serial *self = self_of(link);

	if (self->watch.fd < 0 || self->out_bytes + LP_SERIAL_FRAME_MAX_BYTES > OUTBOX_BYTES)
		return -EAGAIN;
	self->out_bytes += lp_serial_pack(message, self->outbox + self->out_bytes);
	flush(self);
	return 0;
}

static void serial_destroy(struct lp_link *link)
{
	serial_close(link);
	free(link);
}

static int serial_create(const char *device, const struct lp_link_settings *settings,
			 const struct lp_link_host *host, struct lp_link **link)
{
	struct link_serial *self;
	speed_t speed;

	if (strlen(device) >= sizeof(self->device))
		return -ENAMETOOLONG;
	if (speed_of(settings->baud, &speed) < 0) {
		lp_error(device, "baud", "%d is none of 115200, 230400, 500000, 1000000",
			 settings->baud);
		return -EINVAL;
	}
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_link){.ops = &lp_link_serial_ops, .host = *host};
	memcpy(self->device, device, strlen(device) + 1);
	self->baud = settings->baud;
	self->watch.fd = -1;
	*link = &self->base;
	return 0;
}

const struct lp_link_ops lp_link_serial_ops = {
	.scheme = "serial",
	.create = serial_create,
	.open = serial_open,
	.send = serial_send,
	.close = serial_close,
	.destroy = serial_destroy,
};
