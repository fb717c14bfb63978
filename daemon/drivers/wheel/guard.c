/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/wheel/guard.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/close_range.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

/* Everything of the parent's but the two: its sockets and devices must close when it dies. */
static void keep_only(int one, int other)
{
	const unsigned low = (unsigned)(one < other ? one : other);
	const unsigned high = (unsigned)(one < other ? other : one);

	if (low > 0)
		(void)syscall(SYS_close_range, 0U, low - 1, 0U);
	if (high > low + 1)
		(void)syscall(SYS_close_range, low + 1, high - 1, 0U);
	(void)syscall(SYS_close_range, high + 1, ~0U, 0U);
}

static _Noreturn void wait_and_act(int end_fd, int device_fd, void (*act)(int, const void *),
				   const void *context)
{
	char byte;

	(void)prctl(PR_SET_NAME, "servo-guard");
	keep_only(end_fd, device_fd);
	while (read(end_fd, &byte, 1) < 0 && errno == EINTR)
		;
	act(device_fd, context);
	_exit(0);
}

int lp_guard_start(int device_fd, void (*act)(int device_fd, const void *context),
		   const void *context)
{
	sigset_t all, before;
	int ends[2];
	int ret;

	if (pipe2(ends, O_CLOEXEC) < 0)
		return -errno;
	/* What ends the daemon in good order ends the guard by the pipe: no signal reaches it, from
	 * its first moment on. */
	(void)sigfillset(&all);
	(void)pthread_sigmask(SIG_SETMASK, &all, &before);
	const pid_t child = fork();
	if (child < 0) {
		ret = -errno;
		(void)pthread_sigmask(SIG_SETMASK, &before, NULL);
		close(ends[0]);
		close(ends[1]);
		return ret;
	}
	if (child == 0) { /* a child's child: nobody here has to wait for its end */
		if (fork() == 0)
			wait_and_act(ends[0], device_fd, act, context);
		_exit(0);
	}
	(void)pthread_sigmask(SIG_SETMASK, &before, NULL);
	close(ends[0]);
	while (waitpid(child, NULL, 0) < 0 && errno == EINTR)
		;
	return ends[1];
}

void lp_guard_release(int guard_fd)
{
	if (guard_fd >= 0)
		close(guard_fd);
}
