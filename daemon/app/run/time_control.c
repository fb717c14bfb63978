/* SPDX-License-Identifier: Apache-2.0 */
#include "app/run/time_control.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"

struct lp_time_control {
	struct lp_loop *loop;
	struct lp_watch link;
	char line[32];
	size_t line_bytes;
	int64_t goal_ns;
};

static void on_reached(void *context)
{
	struct lp_time_control *self = context;
	char line[32];
	const int length = snprintf(line, sizeof(line), "%" PRId64 "\n", self->goal_ns);

	if (self->link.fd >= 0) /* the test waits for this line, so there is room for it */
		(void)send(self->link.fd, line, (size_t)length, MSG_NOSIGNAL);
}

static void take_line(struct lp_time_control *self)
{
	char *end;

	self->goal_ns = strtoll(self->line, &end, 10);
	if (end == self->line || *end || self->goal_ns <= 0)
		lp_error("time", "read", "'%s' is not a time in nanoseconds", self->line);
	else
		lp_loop_advance(self->loop, self->goal_ns, on_reached, self);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_time_control *self = LP_CONTAINER_OF(watch, struct lp_time_control, link);
	const int fd = watch->fd;
	ssize_t got;
	char byte;

	(void)events;
	while ((got = recv(fd, &byte, 1, MSG_DONTWAIT)) == 1) {
		if (byte != '\n' && self->line_bytes < sizeof(self->line) - 1) {
			self->line[self->line_bytes++] = byte;
			continue;
		}
		self->line[self->line_bytes] = '\0';
		self->line_bytes = 0;
		take_line(self);
		return;
	}
	if (got < 0 && (errno == EAGAIN || errno == EINTR))
		return;
	lp_info("time", "read", "the test has gone, and time stands still: the program ends");
	lp_watch_stop(watch);
	close(fd);
	lp_loop_stop(self->loop);
}

static int connect_to(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	int ret;

	if (fd < 0)
		return -errno;
	if (strlen(path) >= sizeof(address.sun_path)) {
		close(fd);
		return -ENAMETOOLONG;
	}
	memcpy(address.sun_path, path, strlen(path) + 1);
	if (connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0) {
		ret = -errno;
		close(fd);
		return ret;
	}
	return fd;
}

int lp_time_control_create(const char *path, struct lp_loop *loop, struct lp_time_control **control)
{
	struct lp_time_control *self = calloc(1, sizeof(*self));
	const int fd = self ? connect_to(path) : -ENOMEM;
	int ret = fd < 0 ? fd : 0;

	if (ret == 0)
		ret = lp_watch_start(loop, &self->link, fd, LP_READABLE, on_ready);
	if (ret < 0) {
		lp_error(path, "--simulated-time", "%s — does a test listen there?",
			 lp_strerror(ret));
		if (fd >= 0)
			close(fd);
		free(self);
		return ret;
	}
	self->loop = loop;
	lp_clock_simulate(LP_TIME_CONTROL_START_NS);
	*control = self;
	return 0;
}

void lp_time_control_destroy(struct lp_time_control *control)
{
	if (!control)
		return;
	const int fd = control->link.fd;

	if (control->link.handle) {
		lp_watch_stop(&control->link);
		close(fd);
	}
	free(control);
}
