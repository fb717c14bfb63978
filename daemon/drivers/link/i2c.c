/* SPDX-License-Identifier: Apache-2.0 */
/*
 * i2c:DEVICE — messages through the microcontroller's mailbox on an I2C bus. A transfer may block
 * for as long as the bus likes, so a thread does them (bus_thread.h); messages go to it, and
 * packets come back.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "drivers/link/bus_thread.h"
#include "drivers/link/carrier.h"
#include "drivers/link/envelope.h"

#define MAIL_BYTES (LP_ENVELOPE_MAX_BYTES + 1)
#define POLL_MS 2
#define TROUBLED_POLL_MS 50 /* while nobody answers */
#define TROUBLES 5	    /* transfers in a row, until it is a fault */
#define MAILS_AT_ONCE 32
#define BUS_TIMEOUT_10MS 10
#define LAST_MESSAGES_MS 1000 /* at the end of the program: the servo is let go */
#define FAULT_ID "i2c-nack"

/* From the thread to the loop. */
struct packet {
	int error; /* 0: a message; else errno of a transfer, or -1: transfers work again */
	int64_t t_ns;
	struct lp_link_message message;
};

/* The thread's own. */
struct mailbox {
	int bus_fd;
	uint16_t address;
	int fd; /* to the loop */
};

struct link_i2c {
	struct lp_link base;
	char device[256];
	uint16_t address;
	struct lp_watch watch;
	struct lp_bus_thread *thread; /* NULL: none yet; watch.fd -1: it is to end */
	bool has_fault;		      /* the host was told of one, which has not ended */
};

static struct link_i2c *self_of(const struct lp_link *link)
{
	return (struct link_i2c *)link;
}

/* ---------------------------------------------------------------- the thread */

/* 0 or -errno. */
static int transfer(const struct mailbox *mailbox, uint16_t flags, uint8_t *bytes, uint16_t count)
{
	struct i2c_msg message = {.addr = mailbox->address,
				  .flags = flags,
				  .len = count,
				  .buf = bytes};
	struct i2c_rdwr_ioctl_data request = {.msgs = &message, .nmsgs = 1};

	return ioctl(mailbox->bus_fd, I2C_RDWR, &request) < 0 ? -errno : 0;
}

static void hand_on(const struct mailbox *mailbox, const struct packet *packet)
{
	/* A loop that is this far behind loses messages, as on a line. */
	(void)send(mailbox->fd, packet, sizeof(*packet), MSG_NOSIGNAL | MSG_DONTWAIT);
}

/* 1: a message was read and handed on, or spoilt; 0: none waits; -errno. */
static int read_mail(const struct mailbox *mailbox)
{
	struct packet packet = {0};
	uint8_t mail[MAIL_BYTES];
	const int ret = transfer(mailbox, I2C_M_RD, mail, sizeof(mail));

	if (ret < 0)
		return ret;
	if (mail[0] == 0)
		return 0;
	packet.t_ns = lp_clock_ns();
	if (mail[0] <= LP_ENVELOPE_MAX_BYTES &&
	    lp_envelope_unpack(mail + 1, mail[0], &packet.message))
		hand_on(mailbox, &packet);
	return 1;
}

/* What the loop has sent. 0 or -errno. */
static int write_mails(const struct mailbox *mailbox)
{
	struct lp_link_message message;
	uint8_t mail[MAIL_BYTES];
	int ret = 0;

	while (ret == 0 &&
	       recv(mailbox->fd, &message, sizeof(message), MSG_DONTWAIT) == sizeof(message)) {
		mail[0] = (uint8_t)lp_envelope_pack(&message, mail + 1);
		ret = transfer(mailbox, 0, mail, (uint16_t)(mail[0] + 1));
	}
	return ret;
}

/* What the loop has to send, then what the microcontroller has. 0 or -errno. */
static int exchange(const struct mailbox *mailbox)
{
	int ret = write_mails(mailbox);

	for (int i = 0; i < MAILS_AT_ONCE && ret >= 0; i++) {
		ret = read_mail(mailbox);
		if (ret == 0)
			break;
	}
	return ret < 0 ? ret : 0;
}

static void run(void *context, int fd)
{
	struct mailbox *mailbox = context;
	struct pollfd waiting = {.fd = fd, .events = POLLIN};
	int troubles = 0;

	mailbox->fd = fd;
	for (;;) {
		(void)poll(&waiting, 1, troubles < TROUBLES ? POLL_MS : 0);
		if (waiting.revents & (POLLHUP | POLLERR)) {
			(void)write_mails(mailbox); /* sent before the end */
			return;
		}
		const int ret = exchange(mailbox);

		if (ret == 0 && troubles >= TROUBLES)
			hand_on(mailbox, &(struct packet){.error = -1});
		troubles = ret == 0 ? 0 : troubles + (troubles < TROUBLES);
		if (ret == 0)
			continue;
		if (troubles == TROUBLES) {
			hand_on(mailbox, &(struct packet){.error = -ret});
			waiting.events = 0; /* wait for the end only */
			(void)poll(&waiting, 1, TROUBLED_POLL_MS);
			waiting.events = POLLIN;
		}
	}
}

static void finish(void *context)
{
	struct mailbox *mailbox = context;

	close(mailbox->bus_fd);
	free(mailbox);
}

/* ---------------------------------------------------------------- the loop */

static const char *why(int error)
{
	return error == ENXIO || error == EREMOTEIO
		       ? "no acknowledge — check address, power and pull-ups of the microcontroller"
	       : error == ETIMEDOUT ? "the bus hangs — is SDA or SCL held low?"
				    : lp_strerror(error);
}

/* NULL: a transfer has succeeded. To close and to open the bus again proves nothing. */
static void tell(struct link_i2c *self, const char *text)
{
	const struct lp_link_host *host = &self->base.host;

	if (text || self->has_fault)
		host->fault(host->context, FAULT_ID, text);
	self->has_fault = text != NULL;
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct link_i2c *self = LP_CONTAINER_OF(watch, struct link_i2c, watch);
	const struct lp_link_host *host = &self->base.host;
	struct packet packet;

	(void)events;
	/* one a turn of the loop, so that all others have theirs */
	if (recv(watch->fd, &packet, sizeof(packet), MSG_DONTWAIT) != sizeof(packet))
		return;
	if (packet.error != ENODEV)
		tell(self, packet.error > 0 ? why(packet.error) : NULL);
	if (packet.error == 0)
		host->received(host->context, &packet.message, packet.t_ns);
	else if (packet.error == ENODEV)
		host->lost(host->context, "transfer", "the bus is gone — is it plugged in?");
}

static void i2c_close(struct lp_link *link)
{
	struct link_i2c *self = self_of(link);

	if (self->watch.fd < 0)
		return;
	lp_watch_stop(&self->watch);
	lp_bus_thread_end(self->thread);
}

/* A descriptor; or -errno, and *reason says what to do. */
static int open_bus(const struct link_i2c *self, const char **reason)
{
	const int fd = open(self->device, O_RDWR | O_CLOEXEC);
	unsigned long able = 0;
	int ret;

	*reason = "does the bus exist? load i2c-dev (modprobe) or the overlay of the bus";
	if (fd < 0) {
		if (errno == EACCES || errno == EPERM)
			*reason = "join the group i2c; a service needs its drop-in i2c.conf";
		return -errno;
	}
	ret = ioctl(fd, I2C_FUNCS, &able) < 0 ? -errno : able & I2C_FUNC_I2C ? 0 : -EOPNOTSUPP;
	if (ret < 0) {
		*reason = "this bus cannot do plain I2C transfers";
		close(fd);
		return ret;
	}
	(void)ioctl(fd, I2C_TIMEOUT, BUS_TIMEOUT_10MS);
	return fd;
}

static int start_thread(struct link_i2c *self, int bus_fd)
{
	struct mailbox *mailbox = calloc(1, sizeof(*mailbox));
	const struct lp_bus_job job = {.context = mailbox, .run = run, .finish = finish};
	int ret = -ENOMEM;

	if (mailbox) {
		*mailbox = (struct mailbox){.bus_fd = bus_fd, .address = self->address};
		ret = lp_bus_thread_start(&job, &self->thread);
	}
	if (ret < 0) {
		free(mailbox);
		close(bus_fd);
		return ret;
	}
	ret = lp_watch_start(self->base.host.loop, &self->watch, lp_bus_thread_fd(self->thread),
			     LP_READABLE, on_ready);
	if (ret < 0)
		lp_bus_thread_end(self->thread);
	return ret;
}

static int i2c_open(struct lp_link *link, const char **reason)
{
	struct link_i2c *self = self_of(link);
	int fd;

	*reason = "the last transfer has not ended: is SDA or SCL held low?";
	if (self->thread && !lp_bus_thread_has_ended(self->thread))
		return -EBUSY;
	lp_bus_thread_destroy(self->thread, 0);
	self->thread = NULL;
	fd = open_bus(self, reason);
	if (fd < 0)
		return fd;
	*reason = "out of resources";
	return start_thread(self, fd);
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
	struct link_i2c *self = self_of(link);

	i2c_close(link);
	lp_bus_thread_destroy(self->thread, LAST_MESSAGES_MS);
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
