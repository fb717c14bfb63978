/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/link/bus_thread.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

struct lp_bus_thread {
	struct lp_bus_job job;
	int loop_fd, thread_fd;
	int ended_fd;	       /* eventfd, readable when the thread has ended */
	atomic_int references; /* the thread, and the loop */
};

static void drop_reference(struct lp_bus_thread *thread)
{
	if (atomic_fetch_sub(&thread->references, 1) > 1)
		return;
	close(thread->ended_fd);
	free(thread);
}

static void *run(void *argument)
{
	struct lp_bus_thread *thread = argument;

	thread->job.run(thread->job.context, thread->thread_fd);
	close(thread->thread_fd);
	thread->job.finish(thread->job.context);
	(void)eventfd_write(thread->ended_fd, 1);
	drop_reference(thread);
	return NULL;
}

static int start_detached(struct lp_bus_thread *thread)
{
	pthread_attr_t attributes;
	pthread_t id;
	int ret = -pthread_attr_init(&attributes);

	if (ret < 0)
		return ret;
	(void)pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
	ret = -pthread_create(&id, &attributes, run, thread);
	pthread_attr_destroy(&attributes);
	return ret;
}

int lp_bus_thread_start(const struct lp_bus_job *job, struct lp_bus_thread **thread)
{
	struct lp_bus_thread *self = calloc(1, sizeof(*self));
	int pair[2], ret;

	if (!self)
		return -ENOMEM;
	self->job = *job;
	atomic_init(&self->references, 2);
	self->ended_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	ret = self->ended_fd < 0 ? -errno : 0;
	if (ret < 0)
		goto err_free;
	ret = socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) < 0 ? -errno : 0;
	if (ret < 0)
		goto err_close_event;
	self->loop_fd = pair[0];
	self->thread_fd = pair[1];
	ret = start_detached(self);
	if (ret < 0)
		goto err_close_pair;
	*thread = self;
	return 0;

err_close_pair:
	close(pair[0]);
	close(pair[1]);
err_close_event:
	close(self->ended_fd);
err_free:
	free(self);
	return ret;
}

int lp_bus_thread_fd(const struct lp_bus_thread *thread)
{
	return thread->loop_fd;
}

void lp_bus_thread_end(struct lp_bus_thread *thread)
{
	if (thread->loop_fd >= 0)
		close(thread->loop_fd);
	thread->loop_fd = -1;
}

static bool has_ended_within(struct lp_bus_thread *thread, int timeout_ms)
{
	struct pollfd ended = {.fd = thread->ended_fd, .events = POLLIN};

	return poll(&ended, 1, timeout_ms) > 0;
}

bool lp_bus_thread_has_ended(struct lp_bus_thread *thread)
{
	return has_ended_within(thread, 0);
}

void lp_bus_thread_destroy(struct lp_bus_thread *thread, int timeout_ms)
{
	if (!thread)
		return;
	lp_bus_thread_end(thread);
	(void)has_ended_within(thread, timeout_ms);
	drop_reference(thread);
}
