/* SPDX-License-Identifier: Apache-2.0 */
/* stdout: - packets to standard output, for a program at the other end of a pipe. One client, which
 * cannot ask for anything; when it goes, the daemon ends. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/loop.h"
#include "base/uri.h"
#include "drivers/publisher/queue.h"
#include "include/packet.h"
#include "include/publisher.h"

#define OBJECT "stdout:"

struct stdout_publisher {
	struct lp_publisher base;
	struct lp_watch watch;
	struct lp_timer wake; /* tells the host of a failure, after the send that met it */
	struct lp_send_queue queue;
	int fd;	     /* -1: not started */
	bool own_fd; /* close it */
	bool connected;
	void *user;
	int failure; /* 0 or -errno */
};

static struct stdout_publisher *self_of(const struct lp_publisher *publisher)
{
	return (struct stdout_publisher *)publisher;
}

static void fail(struct stdout_publisher *self, int failure)
{
	if (self->failure)
		return;
	self->failure = failure;
	lp_send_queue_clear(&self->queue);
	lp_watch_stop(&self->watch);
	lp_timer_set(&self->wake, 0, 0);
	if (failure == -EPIPE)
		lp_info(OBJECT, "write", "the reader is gone: ending");
	else
		lp_error(OBJECT, "write", "%s", lp_strerror(failure));
}

static void flush(struct stdout_publisher *self)
{
	const int ret = lp_send_queue_flush(&self->queue, self->fd);

	if (ret < 0)
		fail(self, ret);
	else
		lp_watch_change(&self->watch, ret > 0 ? LP_WRITABLE : LP_HANGUP);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct stdout_publisher *self = LP_CONTAINER_OF(watch, struct stdout_publisher, watch);

	if (events & LP_HANGUP)
		fail(self, -EPIPE);
	else
		flush(self);
}

static void on_wake(struct lp_timer *timer)
{
	struct stdout_publisher *self = LP_CONTAINER_OF(timer, struct stdout_publisher, wake);

	self->base.host.failed(self->base.host.context, &self->base, self->failure);
}

/*
 * A descriptor that does not block. Pipes are opened anew, because O_NONBLOCK belongs to the open
 * file, which others may share. What cannot be opened anew (sockets, pipes of another user) is
 * switched. Files do not block.
 */
static int open_nonblocking(struct stdout_publisher *self)
{
	struct stat status;

	if (isatty(STDOUT_FILENO)) {
		lp_error(OBJECT, "open",
			 "standard output is a terminal — pipe it to a program, or publish "
			 "elsewhere");
		return -ENOTTY;
	}
	if (fstat(STDOUT_FILENO, &status) < 0)
		return -errno;
	if (S_ISFIFO(status.st_mode))
		self->fd = open("/proc/self/fd/1", O_WRONLY | O_NONBLOCK | O_CLOEXEC);
	self->own_fd = self->fd >= 0;
	if (self->own_fd)
		return 0;
	self->fd = STDOUT_FILENO;
	return S_ISREG(status.st_mode) || fcntl(self->fd, F_SETFL, O_NONBLOCK) == 0 ? 0 : -errno;
}

static int stdout_start(struct lp_publisher *publisher)
{
	struct stdout_publisher *self = self_of(publisher);
	int ret = open_nonblocking(self);

	if (ret == 0) {
		ret = lp_watch_start(publisher->host.loop, &self->watch, self->fd, LP_HANGUP,
				     on_ready);
		if (ret == -EPERM)
			ret = 0; /* a file: always ready, cannot be watched */
	}
	if (ret < 0) {
		if (ret != -ENOTTY)
			lp_error(OBJECT, "open", "%s", lp_strerror(ret));
		return ret;
	}
	self->connected =
		publisher->host.connected(publisher->host.context, publisher,
					  (struct lp_client *)self, 0, NULL, &self->user) == 0;
	return 0;
}

static void stdout_send(struct lp_publisher *publisher, struct lp_client *client,
			struct lp_packet *packet)
{
	struct stdout_publisher *self = self_of(publisher);

	(void)client;
	if (self->failure)
		return;
	if (lp_send_queue_put(&self->queue, packet))
		publisher->host.superseded(publisher->host.context, self->user);
	flush(self);
}

static bool stdout_pending(const struct lp_publisher *publisher)
{
	return !lp_send_queue_is_empty(&self_of(publisher)->queue);
}

static void stdout_destroy(struct lp_publisher *publisher)
{
	struct stdout_publisher *self = self_of(publisher);

	if (!publisher)
		return;
	if (self->connected)
		publisher->host.disconnected(publisher->host.context, self->user);
	lp_send_queue_clear(&self->queue);
	lp_watch_stop(&self->watch);
	lp_timer_stop(&self->wake);
	if (self->own_fd)
		close(self->fd);
	free(self);
}

const struct lp_publisher_ops lp_publisher_stdout_ops;

static int stdout_create(const struct lp_uri *uri, const struct lp_publisher_host *host,
			 struct lp_publisher **publisher)
{
	struct stdout_publisher *self;
	int ret = lp_uri_read(uri, NULL, NULL);

	if (ret == 0 && *uri->rest) {
		lp_error(uri->text, "parse", "stdout: takes nothing after the colon");
		ret = -EINVAL;
	}
	if (ret < 0)
		return ret;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_publisher){.ops = &lp_publisher_stdout_ops, .host = *host};
	self->fd = -1;
	lp_timer_init(host->loop, &self->wake, on_wake);
	*publisher = &self->base;
	return 0;
}

const struct lp_publisher_ops lp_publisher_stdout_ops = {
	.info = {.scheme = "stdout",
		 .form = "",
		 .help = "messages to standard output; the daemon ends with its reader"},
	.create = stdout_create,
	.start = stdout_start,
	.send = stdout_send,
	.pending = stdout_pending,
	.destroy = stdout_destroy,
};
