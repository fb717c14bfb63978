/* SPDX-License-Identifier: Apache-2.0 */
/* The guard acts when its parent has died, and only then; the device here is a pipe. */
#include "lp_test.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "drivers/wheel/guard.h"

#define PATIENCE_MS 20000

static void say_off(int device_fd, const void *context)
{
	(void)!write(device_fd, context, 3);
}

static bool said_within(int fd, int timeout_ms)
{
	struct pollfd polled = {.fd = fd, .events = POLLIN};
	char said[4] = "";

	return poll(&polled, 1, timeout_ms) == 1 && read(fd, said, 3) == 3 &&
	       strcmp(said, "off") == 0;
}

/* Ends by a signal that cannot be caught, or in good order. */
static void daemon_dies(int device_fd, int how)
{
	int guard_fd = lp_guard_start(device_fd, say_off, "off");

	if (guard_fd < 0)
		_exit(1);
	if (how == SIGKILL)
		raise(SIGKILL);
	lp_guard_release(guard_fd);
	_exit(0);
}

static void acts_when_its_parent_dies(int how)
{
	int device[2], status;

	assert_int_equal(pipe2(device, O_CLOEXEC), 0);
	const pid_t daemon = fork();

	assert_true(daemon >= 0);
	if (daemon == 0)
		daemon_dies(device[1], how);
	close(device[1]);
	assert_int_equal(waitpid(daemon, &status, 0), daemon);
	assert_true(how == SIGKILL ? WIFSIGNALED(status) : status == 0);
	assert_true(said_within(device[0], PATIENCE_MS));
	close(device[0]);
}

static void test_killed(void **state)
{
	(void)state;
	acts_when_its_parent_dies(SIGKILL);
}

static void test_released(void **state)
{
	(void)state;
	acts_when_its_parent_dies(0);
}

static void test_not_before_and_not_by_what_ends_a_service(void **state)
{
	int device[2];

	(void)state;
	assert_int_equal(pipe2(device, O_CLOEXEC), 0);
	const int guard_fd = lp_guard_start(device[1], say_off, "off");

	assert_true(guard_fd >= 0);
	(void)signal(SIGTERM, SIG_IGN);
	assert_int_equal(kill(0, SIGTERM), 0); /* to the whole group, as Ctrl-C and systemd do */
	assert_false(said_within(device[0], 300));
	lp_guard_release(guard_fd);
	assert_true(said_within(device[0], PATIENCE_MS));
	close(device[0]);
	close(device[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_killed),
		cmocka_unit_test(test_released),
		cmocka_unit_test(test_not_before_and_not_by_what_ends_a_service),
	};

	(void)setpgid(0, 0); /* a group of its own, to be signalled */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
