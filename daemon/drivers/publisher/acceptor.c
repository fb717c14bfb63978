/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/acceptor.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/log.h"
#include "base/macros.h"

#define ACCEPTS_PER_EVENT 4
#define SEND_BUFFER_BYTES (16 << 10)
#define KEEPALIVE_IDLE_S 10
#define KEEPALIVE_INTERVAL_S 5
#define KEEPALIVE_PROBES 3
#define UNACKNOWLEDGED_MAX_MS (120 * 1000) /* then a TCP peer counts as gone */

void lp_connection_set_options(int fd, bool is_tcp)
{
	static const struct {
		int level, name, value;
	} options[] = {
		{SOL_SOCKET, SO_SNDBUF, SEND_BUFFER_BYTES},
		{IPPROTO_TCP, TCP_NODELAY, 1},
		{SOL_SOCKET, SO_KEEPALIVE, 1},
		{IPPROTO_TCP, TCP_KEEPIDLE, KEEPALIVE_IDLE_S},
		{IPPROTO_TCP, TCP_KEEPINTVL, KEEPALIVE_INTERVAL_S},
		{IPPROTO_TCP, TCP_KEEPCNT, KEEPALIVE_PROBES},
		{IPPROTO_TCP, TCP_USER_TIMEOUT, UNACKNOWLEDGED_MAX_MS},
	};
	const size_t count = is_tcp ? LP_COUNT(options) : 1;

	for (size_t i = 0; i < count; i++) /* without one of them it is slower, not wrong */
		(void)setsockopt(fd, options[i].level, options[i].name, &options[i].value,
				 sizeof(options[i].value));
}

/* Out of descriptors: without this the connection would stay in the queue and wake us for ever. */
static void turn_away(struct lp_acceptor *self, int listener_fd)
{
	int fd;

	lp_error(self->object, "accept",
		 "out of file descriptors: a client is turned away — raise LimitNOFILE");
	if (self->spare_fd >= 0)
		close(self->spare_fd);
	fd = accept4(listener_fd, NULL, NULL, SOCK_CLOEXEC);
	if (fd >= 0)
		close(fd);
	self->spare_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
}

/* Nothing stays of it, here or in the kernel. */
static void hang_up(int fd)
{
	const struct linger at_once = {.l_onoff = 1};

	(void)setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
	close(fd);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_acceptor *self = LP_CONTAINER_OF(watch, struct lp_listener, watch)->owner;

	(void)events;
	for (int i = 0; i < ACCEPTS_PER_EVENT; i++) {
		const int fd = accept4(watch->fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
		int ret;

		if (fd < 0 && (errno == EMFILE || errno == ENFILE)) {
			turn_away(self, watch->fd);
			return;
		}
		if (fd < 0)
			return; /* none left, or it has gone again */
		ret = self->accepted(self, fd);
		if (ret < 0 && ret != -EUSERS)
			lp_error(self->object, "accept", "%s", lp_strerror(ret));
		if (ret < 0)
			hang_up(fd);
	}
}

void lp_acceptor_init(struct lp_acceptor *acceptor, const char *object,
		      int (*accepted)(struct lp_acceptor *acceptor, int fd))
{
	*acceptor = (struct lp_acceptor){.object = object, .accepted = accepted, .spare_fd = -1};
}

/* Takes over the descriptor. */
static int add_listener(struct lp_acceptor *self, struct lp_loop *loop, int fd)
{
	struct lp_listener *listener = &self->listeners[self->count];
	const int ret = lp_watch_start(loop, &listener->watch, fd, LP_READABLE, on_ready);

	if (ret < 0) {
		close(fd);
		return ret;
	}
	listener->owner = self;
	self->count++;
	return 0;
}

int lp_acceptor_start(struct lp_acceptor *acceptor, struct lp_loop *loop, const int *fds, int count)
{
	int ret = 0;

	for (int i = 0; i < count; i++) {
		const int added = add_listener(acceptor, loop, fds[i]);

		ret = added < 0 ? added : ret;
	}
	acceptor->spare_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
	if (ret < 0)
		lp_error(acceptor->object, "start", "%s", lp_strerror(ret));
	return ret;
}

void lp_acceptor_finish(struct lp_acceptor *acceptor)
{
	for (int i = 0; i < acceptor->count; i++) {
		const int fd = acceptor->listeners[i].watch.fd;

		lp_watch_stop(&acceptor->listeners[i].watch);
		close(fd);
	}
	acceptor->count = 0;
	if (acceptor->spare_fd >= 0)
		close(acceptor->spare_fd);
	acceptor->spare_fd = -1;
}
