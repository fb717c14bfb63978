/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "drivers/publisher/listen.h"

static char path[64];

static int setup(void **state)
{
	(void)state;
	(void)snprintf(path, sizeof(path), "/tmp/lp-listen-%d/probe", (int)getpid());
	return 0;
}

static int teardown(void **state)
{
	char folder[64];

	(void)state;
	unlink(path);
	(void)snprintf(folder, sizeof(folder), "/tmp/lp-listen-%d", (int)getpid());
	rmdir(folder);
	return 0;
}

static void test_a_missing_folder_is_made_and_the_mode_is_set(void **state)
{
	struct lp_socket_file file = {0};
	struct stat status;
	const int fd = lp_listen_unix("test", path, 0640, &file);

	(void)state;
	assert_true(fd >= 0);
	assert_int_equal(stat(path, &status), 0);
	assert_int_equal(status.st_mode & 0777, 0640);
	lp_socket_file_remove(&file);
	assert_true(stat(path, &status) < 0);
	lp_socket_file_remove(&file); /* not twice */
	close(fd);
}

static void test_second_daemon_on_a_live_path(void **state)
{
	struct lp_socket_file file = {0}, second = {0};
	struct capture capture;
	struct stat status;
	const int fd = lp_listen_unix("test", path, 0600, &file);

	(void)state;
	assert_true(fd >= 0);
	capture_begin(&capture);
	assert_int_equal(lp_listen_unix("second", path, 0600, &second), -EADDRINUSE);
	assert_contains(capture_end(&capture), "error second: bind: Address already in use — does "
					       "another lightprobed run?");
	lp_socket_file_remove(&second); /* it owns nothing */
	assert_int_equal(stat(path, &status), 0);
	close(fd);
	lp_socket_file_remove(&file);
}

static void test_a_stale_path_is_replaced(void **state)
{
	struct lp_socket_file killed = {0}, file = {0};
	int fd = lp_listen_unix("test", path, 0600, &killed);

	(void)state;
	assert_true(fd >= 0);
	close(fd); /* as if it had been killed: the file stays */
	fd = lp_listen_unix("test", path, 0600, &file);
	assert_true(fd >= 0);
	lp_socket_file_remove(&file);
	close(fd);
}

static void test_a_file_that_somebody_replaced_is_left_alone(void **state)
{
	struct lp_socket_file old = {0}, file = {0};
	const int old_fd = lp_listen_unix("test", path, 0600, &old);
	struct stat status;
	int fd;

	(void)state;
	assert_true(old_fd >= 0);
	assert_int_equal(unlink(path), 0);
	fd = lp_listen_unix("test", path, 0600, &file);
	assert_true(fd >= 0);
	lp_socket_file_remove(&old);
	assert_int_equal(stat(path, &status), 0);
	lp_socket_file_remove(&file);
	assert_true(stat(path, &status) < 0);
	close(fd);
	close(old_fd);
}

/* Without descriptors nobody can find out whether a program answers. */
static void test_a_live_path_is_not_taken_over_for_lack_of_descriptors(void **state)
{
	struct lp_socket_file file = {0}, second = {0};
	const int fd = lp_listen_unix("test", path, 0600, &file);
	struct rlimit old, low;
	const int next_fd = dup(fd);
	int ret;

	(void)state;
	assert_true(fd >= 0);
	close(next_fd);
	assert_int_equal(getrlimit(RLIMIT_NOFILE, &old), 0);
	low = old;
	low.rlim_cur = (rlim_t)next_fd + 1; /* for the socket that would listen, no more */
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &low), 0);
	ret = lp_listen_unix("second", path, 0600, &second);
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &old), 0);
	assert_int_equal(ret, -EADDRINUSE);
	assert_int_equal(access(path, F_OK), 0);
	close(fd);
	lp_socket_file_remove(&file);
}

static void test_paths_that_cannot_be(void **state)
{
	struct lp_socket_file file = {0};
	char regular[64], longer[sizeof(((struct sockaddr_un *)NULL)->sun_path) + 1];

	(void)state;
	(void)snprintf(regular, sizeof(regular), "/tmp/lp-listen-%d.file", (int)getpid());
	close(open(regular, O_CREAT | O_WRONLY, 0600)); /* somebody's file */
	assert_int_equal(lp_listen_unix("test", regular, 0600, &file), -EEXIST);
	assert_int_equal(unlink(regular), 0); /* it was left alone */
	assert_true(lp_listen_unix("test", "/proc/no/such/folder", 0600, &file) < 0);
	assert_int_equal(lp_listen_unix("test", "", 0600, &file), -EINVAL);
	memset(longer, 'x', sizeof(longer) - 1);
	longer[sizeof(longer) - 1] = '\0';
	assert_int_equal(lp_listen_unix("test", longer, 0600, &file), -EINVAL);
}

static void test_tcp_addresses(void **state)
{
	static const char *const bad[] = {
		"",	     "7700",	  ":7700",	     "127.0.0.1:",     "::1:7700",
		"[::1]7700", "[::1:7700", "127.0.0.1:99999", "127.0.0.1:http", "127.0.0.1:-1",
		"[]:1",	     "[a]b]:1"};
	struct lp_tcp_address address;
	int fds[LP_LISTEN_MAX];

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		if (lp_tcp_address_parse("test", bad[i], &address) != -EINVAL)
			fail_msg("%s was accepted", bad[i]);
	}
	assert_int_equal(lp_tcp_address_parse("test", "no.such.host.invalid:1", &address), 0);
	assert_int_equal(lp_listen_tcp("test", &address, fds), -EINVAL);
	assert_int_equal(lp_tcp_address_parse("test", "127.0.0.1:0", &address), 0);
	assert_int_equal(lp_listen_tcp("test", &address, fds), 1);
	close(fds[0]);
	assert_int_equal(lp_tcp_address_parse("test", "[::1]:0", &address), 0);
	assert_string_equal(address.host, "::1");
	if (lp_listen_tcp("test", &address, fds) == 1)
		close(fds[0]);
	else
		print_message(
			"no IPv6 on this machine: brackets are tested by their errors only\n");
}

/* Without encryption only this machine, unless the user says otherwise. */
static void test_who_may_be_let_in_unencrypted(void **state)
{
	const char *const loopback[] = {"127.0.0.1:1", "127.8.7.6:1", "[::1]:1", "localhost:1"};
	const char *const network[] = {"0.0.0.0:1",	   "[::]:1",
				       "192.168.1.20:1",   "[fe80::1]:1",
				       "probe.local:1",	   "128.0.0.1:1",
				       "localhost.evil:1", "[::ffff:10.0.0.1]:1"};
	struct lp_tcp_address address;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(loopback); i++) {
		assert_int_equal(lp_tcp_address_parse("test", loopback[i], &address), 0);
		assert_int_equal(lp_tcp_address_check_open("test", &address, false), 0);
		assert_int_equal(lp_tcp_address_check_open("test", &address, true), 0);
	}
	for (size_t i = 0; i < LP_COUNT(network); i++) {
		assert_int_equal(lp_tcp_address_parse("test", network[i], &address), 0);
		assert_int_equal(lp_tcp_address_check_open("test", &address, false), -EACCES);
		assert_int_equal(lp_tcp_address_check_open("test", &address, true), 1);
	}
}

#define LISTEN_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		LISTEN_TEST(test_a_missing_folder_is_made_and_the_mode_is_set),
		LISTEN_TEST(test_second_daemon_on_a_live_path),
		LISTEN_TEST(test_a_stale_path_is_replaced),
		LISTEN_TEST(test_a_file_that_somebody_replaced_is_left_alone),
		LISTEN_TEST(test_a_live_path_is_not_taken_over_for_lack_of_descriptors),
		LISTEN_TEST(test_paths_that_cannot_be),
		LISTEN_TEST(test_tcp_addresses),
		LISTEN_TEST(test_who_may_be_let_in_unencrypted),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
