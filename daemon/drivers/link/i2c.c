/* SPDX-License-Identifier: Apache-2.0 */
/*
 * i2c:DEVICE — messages through the microcontroller's mailbox on an I2C bus. A transfer may block
 * for as long as the bus likes, so a thread of the link's own does them; it and the loop talk over
 * a pair of sockets, one packet a message.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "drivers/link/carrier.h"
#include "drivers/link/envelope.h"

#define MAIL_BYTES (LP_ENVELOPE_MAX_BYTES + 1)
#define POLL_MS 2
#define TROUBLED_POLL_MS 50 /* while nobody answers */
#define TROUBLES 5	    /* transfers in a row, until it is a fault */
#define MAILS_AT_ONCE 32
#define BUS_TIMEOUT_10MS 10
#define FAULT_ID "i2c-nack"

/* From the thread to the loop. */
struct packet {
	int error; /* 0: a message; else errno of a transfer, or -1: transfers work again */
	int64_t t_ns;
	struct lp_link_message message;
};

struct link_i2c {
	struct lp_link base;
	char device[256];
	uint16_t address;
	struct lp_watch watch; /* the loop's socket */
	int bus_fd, thread_fd;
	pthread_t thread;
};

static struct link_i2c *self_of(const struct lp_link *link)
{
	return (struct link_i2c *)link;
}

/* ---------------------------------------------------------------- the thread */

/* 0 or -errno. */
static int transfer(const struct link_i2c *self, uint16_t flags, uint8_t *bytes, uint16_t count)
{
	struct i2c_msg message = {.addr = self->address,
				  .flags = flags,
				  .len = count,
				  .buf = bytes};
	struct i2c_rdwr_ioctl_data request = {.msgs = &message, .nmsgs = 1};

	return ioctl(self->bus_fd, I2C_RDWR, &request) < 0 ? -errno : 0;
}

static void tell(const struct link_i2c *self, const struct packet *packet)
{
	/* A loop that is this far behind loses messages, as on a line. */
	(void)send(self->thread_fd, packet, sizeof(*packet), MSG_NOSIGNAL | MSG_DONTWAIT);
}

/* 1: a message was read and handed on, or spoilt; 0: none waits; -errno. */
static int read_mail(struct link_i2c *self)
{
	struct packet packet = {0};
	uint8_t mail[MAIL_BYTES];
	const int ret = transfer(self, I2C_M_RD, mail, sizeof(mail));

	if (ret < 0)
		return ret;
	if (mail[0] == 0)
		return 0;
	packet.t_ns = lp_clock_ns();
	if (mail[0] <= LP_ENVELOPE_MAX_BYTES &&
	    lp_envelope_unpack(mail + 1, mail[0], &packet.message))
		tell(self, &packet);
	return 1;
}

static int write_mail(const struct link_i2c *self, const struct lp_link_message *message)
{
	uint8_t mail[MAIL_BYTES];

	mail[0] = (uint8_t)lp_envelope_pack(message, mail + 1);
	return transfer(self, 0, mail, (uint16_t)(mail[0] + 1));
}

/* What the loop has to send, then what the microcontroller has. 0 or -errno. */
static int exchange(struct link_i2c *self)
{
	struct lp_link_message message;
	int ret = 0;

	while (ret == 0 &&
	       recv(self->thread_fd, &message, sizeof(message), MSG_DONTWAIT) == sizeof(message))
		ret = write_mail(self, &message);
	for (int i = 0; i < MAILS_AT_ONCE && ret >= 0; i++) {
		ret = read_mail(self);
		if (ret == 0)
			break;
	}
	return ret < 0 ? ret : 0;
}

static void *run(void *context)
{
	struct link_i2c *self = context;
	struct pollfd waiting = {.fd = self->thread_fd, .events = POLLIN};
	int troubles = 0;

	for (;;) {
		(void)poll(&waiting, 1, troubles < TROUBLES ? POLL_MS : 0);
		if (waiting.revents & (POLLHUP | POLLERR))
			return NULL;
		const int ret = exchange(self);

		if (ret == 0 && troubles >= TROUBLES)
			tell(self, &(struct packet){.error = -1});
		troubles = ret == 0 ? 0 : troubles + (troubles < TROUBLES);
		if (ret == 0)
			continue;
		if (troubles == TROUBLES) {
			tell(self, &(struct packet){.error = -ret});
			waiting.events = 0; /* wait for the end only */
			(void)poll(&waiting, 1, TROUBLED_POLL_MS);
			waiting.events = POLLIN;
		}
	}
}

/* ---------------------------------------------------------------- the loop */

static const char *why(int error)
{
	return error == ENXIO || error == EREMOTEIO
		       ? "no acknowledge — address, power and pull-ups of the microcontroller?"
	       : error == ETIMEDOUT ? "the bus hangs — is SDA or SCL held low?"
				    : lp_strerror(error);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct link_i2c *self = LP_CONTAINER_OF(watch, struct link_i2c, watch);
	const struct lp_link_host *host = &self->base.host;
	struct packet packet;

	(void)events;
	while (watch->fd >= 0 &&
	       recv(watch->fd, &packet, sizeof(packet), MSG_DONTWAIT) == sizeof(packet)) {
		if (packet.error == 0)
			host->received(host->context, &packet.message, packet.t_ns);
		else if (packet.error == ENODEV)
			host->lost(host->context, "transfer",
				   "the bus is gone — is it plugged in?");
		else
			host->fault(host->context, FAULT_ID,
				    packet.error > 0 ? why(packet.error) : NULL);
	}
}

static void i2c_close(struct lp_link *link)
{
	struct link_i2c *self = self_of(link);
	const int fd = self->watch.fd;

	if (fd < 0)
		return;
	lp_watch_stop(&self->watch);
	close(fd); /* ends the thread */
	pthread_join(self->thread, NULL);
	close(self->thread_fd);
	close(self->bus_fd);
	link->host.fault(link->host.context, FAULT_ID, NULL);
}

static int start_thread(struct link_i2c *self, int loop_fd)
{
	int ret =
		lp_watch_start(self->base.host.loop, &self->watch, loop_fd, LP_READABLE, on_ready);

	if (ret < 0)
		return ret;
	ret = -pthread_create(&self->thread, NULL, run, self);
	if (ret < 0)
		lp_watch_stop(&self->watch);
	return ret;
}

static int i2c_open(struct lp_link *link, const char **reason)
{
	struct link_i2c *self = self_of(link);
	unsigned long able = 0;
	int pair[2], ret;

	*reason = "is the bus there? modprobe i2c-dev, or its overlay";
	self->bus_fd = open(self->device, O_RDWR | O_CLOEXEC);
	if (self->bus_fd < 0) {
		if (errno == EACCES || errno == EPERM)
			*reason = "join the group i2c; a service needs its drop-in i2c.conf";
		return -errno;
	}
	ret = ioctl(self->bus_fd, I2C_FUNCS, &able) < 0 ? -errno
	      : able & I2C_FUNC_I2C			? 0
							: -EOPNOTSUPP;
	if (ret < 0) {
		*reason = "this is no bus for plain I2C transfers";
		goto err_close_bus;
	}
	(void)ioctl(self->bus_fd, I2C_TIMEOUT, BUS_TIMEOUT_10MS);
	*reason = "out of resources";
	ret = socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) < 0 ? -errno : 0;
	if (ret < 0)
		goto err_close_bus;
	self->thread_fd = pair[1];
	ret = start_thread(self, pair[0]);
	if (ret == 0)
		return 0;
	close(pair[0]);
	close(pair[1]);
err_close_bus:
	close(self->bus_fd);
	return ret;
}

static int i2c_send(struct lp_link *link, const struct lp_link_message *message)
{
	struct link_i2c *self = self_of(link);

	if (self->watch.fd < 0)
		return -EAGAIN;
	return send(self->watch.fd, message, sizeof(*message), MSG_NOSIGNAL | MSG_DONTWAIT) < 0
		       ? -EAGAIN
		       : 0;
}

static void i2c_destroy(struct lp_link *link)
{
	i2c_close(link);
	free(link);
}

static int i2c_create(const char *device, const struct lp_link_settings *settings,
		      const struct lp_link_host *host, struct lp_link **link)
{
	struct link_i2c *self;

	if (strlen(device) >= sizeof(self->device))
		return -ENAMETOOLONG;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_link){.ops = &lp_link_i2c_ops, .host = *host};
	memcpy(self->device, device, strlen(device) + 1);
	self->address = (uint16_t)settings->address;
	self->watch.fd = -1;
	*link = &self->base;
	return 0;
}

const struct lp_link_ops lp_link_i2c_ops = {
	.scheme = "i2c",
	.create = i2c_create,
	.open = i2c_open,
	.send = i2c_send,
	.close = i2c_close,
	.destroy = i2c_destroy,
};
