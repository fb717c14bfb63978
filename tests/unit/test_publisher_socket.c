/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "base/uri.h"
#include "drivers/publisher/places.h"
#include "include/packet.h"
#include "include/publisher.h"
#include "loop_test.h"

extern const struct lp_publisher_ops lp_publisher_tcp_ops;
extern const struct lp_publisher_ops lp_publisher_unix_ops;

/* ---------------------------------------------------------------- a host that echoes */

static struct {
	int connected, disconnected, requests, requests_done, unreadable, superseded;
	struct lp_client *client; /* the newest */
	struct lp_publisher *publisher;
	bool refuse;
	char last[512];
	size_t last_bytes;
} heard;

static int packets_alive;

static void release(struct lp_packet *packet)
{
	packets_alive--;
	free(packet);
}

static void send_text(struct lp_publisher *publisher, struct lp_client *client, const char *text,
		      enum lp_packet_kind kind, uint32_t size)
{
	struct lp_packet *packet = calloc(1, sizeof(*packet) + size);

	packet->references = 1;
	packet->kind = kind;
	packet->size_bytes = size;
	packet->release = release;
	packet->data = (uint8_t *)(packet + 1);
	memcpy(packet->data, text, strlen(text));
	packets_alive++;
	publisher->ops->send(publisher, client, packet);
	lp_packet_drop(packet);
}

static int on_connected(void *context, struct lp_publisher *publisher, struct lp_client *client,
			int code, const char *refusal, void **user)
{
	(void)context;
	(void)code;
	heard.client = client;
	heard.publisher = publisher;
	*user = client;
	if (heard.refuse)
		refusal = "refused";
	if (refusal) {
		send_text(publisher, client, refusal, LP_PACKET_CONTROL, (uint32_t)strlen(refusal));
		return -EUSERS;
	}
	heard.connected++;
	send_text(publisher, client, "hello", LP_PACKET_CONTROL, 5);
	return 0;
}

/* "bye" is the request that makes no sense. */
static int on_request(void *context, void *user, const uint8_t *data, size_t size)
{
	(void)context;
	heard.requests++;
	memcpy(heard.last, data, size);
	heard.last_bytes = size;
	if (size == 3 && memcmp(data, "bye", 3) == 0) {
		send_text(heard.publisher, user, "error", LP_PACKET_CONTROL, 5);
		return -EBADMSG;
	}
	return 0;
}

static void on_requests_done(void *context, void *user)
{
	(void)context;
	(void)user;
	heard.requests_done++;
}

static void on_unreadable(void *context, void *user, int code, const char *reason)
{
	(void)context;
	(void)code;
	heard.unreadable++;
	send_text(heard.publisher, user, reason, LP_PACKET_CONTROL, (uint32_t)strlen(reason));
}

static void on_disconnected(void *context, void *user)
{
	(void)context;
	assert_non_null(user);
	heard.disconnected++;
}

static void on_superseded(void *context, void *user)
{
	(void)context;
	(void)user;
	heard.superseded++;
}

static struct lp_publisher_host host = {
	.connected = on_connected,
	.max_clients = 16,
	.request = on_request,
	.requests_done = on_requests_done,
	.unreadable = on_unreadable,
	.disconnected = on_disconnected,
	.superseded = on_superseded,
};

/* ---------------------------------------------------------------- helpers */

static char path[64];
static struct lp_publisher *publisher;

static struct lp_publisher *create(const struct lp_publisher_ops *ops, const char *text)
{
	struct lp_publisher *created;
	struct lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	assert_int_equal(ops->create(&uri, &host, &created), 0);
	return created;
}

static struct lp_publisher *create_unix(const char *query)
{
	char text[128];

	(void)snprintf(text, sizeof(text), "unix:%s%s", path, query);
	return create(&lp_publisher_unix_ops, text);
}

static int setup(void **state)
{
	(void)state;
	memset(&heard, 0, sizeof(heard));
	(void)snprintf(path, sizeof(path), "/tmp/lp-pub-%d.sock", (int)getpid());
	unlink(path);
	assert_int_equal(lp_loop_create(&host.loop), 0);
	host.places = lp_places_create(host.max_clients);
	assert_non_null(host.places);
	publisher = create_unix("");
	return publisher->ops->start(publisher);
}

static int teardown(void **state)
{
	struct stat status;

	(void)state;
	if (publisher)
		publisher->ops->destroy(publisher);
	publisher = NULL;
	lp_loop_destroy(host.loop);
	lp_places_destroy(host.places);
	assert_int_equal(packets_alive, 0);
	assert_int_equal(heard.connected, heard.disconnected);
	assert_true(stat(path, &status) < 0); /* the socket file is gone */
	return 0;
}

static int dial(void)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);

	(void)strcpy(address.sun_path, path);
	assert_int_equal(connect(fd, (struct sockaddr *)&address, sizeof(address)), 0);
	return fd;
}

static void dispatch_all(void)
{
	while (loop_turn(host.loop, 0)) {
	}
}

/* Dispatch until `*counter` is `value`. */
static void pump(const int *counter, int value)
{
	while (*counter != value)
		assert_true(loop_turn(host.loop, 60000));
}

static int join(void)
{
	const int fd = dial(), before = heard.connected;

	pump(&heard.connected, before + 1);
	return fd;
}

/* Everything until the other side closes. */
static const char *read_to_end(int fd)
{
	static char text[512];
	size_t size = 0;
	struct pollfd poll_fd = {.fd = fd, .events = POLLIN};

	for (;;) {
		dispatch_all();
		assert_int_equal(poll(&poll_fd, 1, 60000), 1);
		const ssize_t got = read(fd, text + size, sizeof(text) - 1 - size);

		if (got <= 0)
			break;
		size += (size_t)got;
	}
	text[size] = '\0';
	return text;
}

static void assert_reads(int fd, const char *expected)
{
	char text[64] = "";

	assert_int_equal(read(fd, text, sizeof(text) - 1), strlen(expected));
	assert_string_equal(text, expected);
}

/* ---------------------------------------------------------------- tests */

static void test_hello_requests_and_leaving(void **state)
{
	const int fd = join();

	(void)state;
	assert_reads(fd, "hello");
	assert_int_equal(write(fd, "\3abc\0\2de\1", 9), 9); /* three requests, and a piece */
	pump(&heard.requests, 3);
	assert_memory_equal(heard.last, "de", 2);
	assert_int_equal(heard.requests_done, 1);
	assert_int_equal(write(fd, "f", 1), 1);
	pump(&heard.requests, 4);
	assert_memory_equal(heard.last, "f", 1);
	close(fd);
	pump(&heard.disconnected, 1);
}

static void test_bad_request_gets_its_answer_then_the_connection_closes(void **state)
{
	const int fd = join();

	(void)state;
	assert_int_equal(write(fd, "\3bye\1x", 6), 6);
	assert_string_equal(read_to_end(fd), "helloerror");
	assert_int_equal(heard.requests, 1); /* what came after it was not read */
	assert_int_equal(heard.disconnected, 1);
	close(fd);
}

static void test_oversized_and_unreadable_requests(void **state)
{
	int fd = join();

	(void)state;
	assert_int_equal(write(fd, "\x81\x02", 2), 2);
	assert_string_equal(read_to_end(fd), "hellolonger than a request may be (256 bytes)");
	close(fd);
	fd = join();
	assert_int_equal(write(fd, "\xff\xff\xff\xff\xff", 5), 5);
	assert_string_equal(read_to_end(fd), "hellodoes not begin with its length as a varint");
	close(fd);
	assert_int_equal(heard.unreadable, 2);
	assert_int_equal(heard.requests, 0);
}

static void test_refused_client_is_told_and_closed(void **state)
{
	const int fd = dial();

	(void)state;
	heard.refuse = true;
	assert_string_equal(read_to_end(fd), "refused");
	assert_int_equal(heard.connected, 0);
	assert_int_equal(heard.disconnected, 0);
	close(fd);
}

/* One user's connections, and all together, have limits of their own. */
static void test_a_peer_has_its_share_and_so_has_the_publisher(void **state)
{
	static const struct {
		const char *query, *refusal;
	} cases[] = {
		{"?per_peer=3", "3 are from the same user — raise ?per_peer="},
		{"?clients=3", "unix has 3 clients — raise its ?clients="},
	};
	int fds[4];

	(void)state;
	for (size_t k = 0; k < LP_COUNT(cases); k++) {
		const int before = heard.connected;

		publisher->ops->destroy(publisher);
		publisher = create_unix(cases[k].query);
		assert_int_equal(publisher->ops->start(publisher), 0);
		for (int i = 0; i < 3; i++)
			fds[i] = join();
		fds[3] = dial();
		assert_string_equal(read_to_end(fds[3]), cases[k].refusal);
		assert_int_equal(heard.connected - before, 3);
		close(fds[0]); /* one leaves, another may come */
		close(fds[3]);
		fds[0] = join();
		for (int i = 0; i < 3; i++)
			close(fds[i]);
		pump(&heard.disconnected, heard.connected);
	}
}

/* Closing clients that flood us and never close are cut off all the same, also while others keep
 * coming that must be closed. */
static void test_closing_does_not_wait_for_ever(void **state)
{
	const int fd = join();
	const char flood[512] = {0};
	int others = 0;

	(void)state;
	fcntl(fd, F_SETFL, O_NONBLOCK);
	assert_int_equal(write(fd, "\3bye", 4), 4);
	while (write(fd, flood, sizeof(flood)) >= 0 || errno == EAGAIN) {
		const int other = dial();

		assert_int_equal(write(other, "\3bye", 4), 4);
		dispatch_all();
		usleep(20000);
		dispatch_all();
		close(other);
		assert_true(++others < 600);
	}
	close(fd);
	dispatch_all();
}

static void test_client_that_never_reads_costs_a_bounded_amount(void **state)
{
	const int slow = join();
	struct lp_client *slow_client = heard.client;
	const int healthy = join();
	struct lp_client *healthy_client = heard.client;
	char text[512], newest[32] = "";
	int received = 0;
	ssize_t got;

	(void)state;
	assert_reads(healthy, "hello");
	for (int i = 0; i < 2000; i++) {
		(void)snprintf(newest, sizeof(newest), "packet %08d", i);
		send_text(publisher, slow_client, newest, LP_PACKET_STATE, 350);
		send_text(publisher, healthy_client, newest, LP_PACKET_STATE, 350);
		got = read(healthy, text, sizeof(text));
		assert_int_equal(got, 350);
		assert_string_equal(text, newest);
		received++;
		assert_true(packets_alive <= 2);
	}
	assert_int_equal(received, 2000);
	assert_true(heard.superseded > 1500);
	assert_true(publisher->ops->pending(publisher));
	/* When it reads at last: whole packets, and the newest of all behind them. */
	fcntl(slow, F_SETFL, O_NONBLOCK);
	assert_int_equal(read(slow, text, 5), 5);
	while (packets_alive > 0 || (got = read(slow, text, 350)) > 0) {
		if (packets_alive > 0)
			got = read(slow, text, 350);
		if (got > 0)
			assert_int_equal(got, 350);
		dispatch_all();
	}
	assert_string_equal(text, newest);
	assert_false(publisher->ops->pending(publisher));
	close(slow);
	close(healthy);
	pump(&heard.disconnected, 2);
}

static void test_client_that_dies_in_the_middle_of_a_request(void **state)
{
	const int fd = join(), other = join();
	struct linger linger = {.l_onoff = 1};

	(void)state;
	assert_int_equal(write(fd, "\x10half", 5), 5);
	dispatch_all();
	setsockopt(fd, SOL_SOCKET, SO_LINGER, &linger, sizeof(linger));
	close(fd);
	/* Sending to it before its hang-up was seen does no harm. */
	for (int i = 0; i < 3; i++)
		send_text(publisher, heard.client, "state", LP_PACKET_STATE, 5);
	pump(&heard.disconnected, 1);
	assert_reads(other, "hellostatestatestate");
	close(other);
	pump(&heard.disconnected, 2);
}

static void test_send_to_a_client_that_has_just_died(void **state)
{
	const int fd = join();
	struct lp_client *client = heard.client;

	(void)state;
	close(fd);
	for (int i = 0; i < 3; i++)
		send_text(publisher, client, "state", LP_PACKET_STATE, 5);
	assert_int_equal(heard.disconnected, 0); /* told by the loop, never by send() */
	pump(&heard.disconnected, 1);
}

static void test_out_of_descriptors(void **state)
{
	struct rlimit limit, low;
	int before = join(), fd, filler[64], fillers = 0;
	struct pollfd poll_fd = {.events = POLLIN};
	char byte;

	(void)state;
	fd = dial(); /* waits in the listening queue */
	assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
	low = limit;
	low.rlim_cur = 64;
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &low), 0);
	while (fillers < 64 && (filler[fillers] = dup(0)) >= 0)
		fillers++;
	dispatch_all(); /* ends: the client was turned away, not left to wake us for ever */
	poll_fd.fd = fd;
	assert_int_equal(poll(&poll_fd, 1, 60000), 1);
	assert_true(read(fd, &byte, 1) <= 0);
	while (fillers > 0)
		close(filler[--fillers]);
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
	close(fd);
	close(join()); /* and it serves again */
	pump(&heard.disconnected, 1);
	close(before);
	pump(&heard.disconnected, 2);
}

/* ---------------------------------------------------------------- TCP */

static int free_port(int family)
{
	struct sockaddr_in6 address = {.sin6_family = (sa_family_t)family};
	socklen_t length = sizeof(address);
	const int fd = socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);

	assert_int_equal(bind(fd, (struct sockaddr *)&address,
			      family == AF_INET ? sizeof(struct sockaddr_in) : sizeof(address)),
			 0);
	assert_int_equal(getsockname(fd, (struct sockaddr *)&address, &length), 0);
	close(fd);
	return ntohs(address.sin6_port); /* at the same place in both families */
}

static void test_tcp_serves_and_a_port_in_use_is_an_error(void **state)
{
	const struct sockaddr_in address = {.sin_family = AF_INET,
					    .sin_port = htons((uint16_t)free_port(AF_INET)),
					    .sin_addr = {htonl(INADDR_LOOPBACK)}};
	const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
	struct lp_publisher *second;
	struct capture capture;
	char text[64];

	(void)state;
	publisher->ops->destroy(publisher);
	(void)snprintf(text, sizeof(text), "tcp:127.0.0.1:%d", ntohs(address.sin_port));
	publisher = create(&lp_publisher_tcp_ops, text);
	assert_int_equal(publisher->ops->start(publisher), 0);
	second = create(&lp_publisher_tcp_ops, text);
	capture_begin(&capture);
	assert_int_equal(second->ops->start(second), -EADDRINUSE);
	second->ops->destroy(second);
	capture_end(&capture);
	assert_contains(capture.text, text);
	assert_contains(capture.text, "bind: Address already in use — does another lightprobed");
	assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof(address)), 0);
	pump(&heard.connected, 1);
	assert_reads(fd, "hello");
	close(fd);
	pump(&heard.disconnected, 1);
}

#define SOCKET_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		SOCKET_TEST(test_hello_requests_and_leaving),
		SOCKET_TEST(test_bad_request_gets_its_answer_then_the_connection_closes),
		SOCKET_TEST(test_oversized_and_unreadable_requests),
		SOCKET_TEST(test_refused_client_is_told_and_closed),
		SOCKET_TEST(test_a_peer_has_its_share_and_so_has_the_publisher),
		SOCKET_TEST(test_closing_does_not_wait_for_ever),
		SOCKET_TEST(test_client_that_never_reads_costs_a_bounded_amount),
		SOCKET_TEST(test_client_that_dies_in_the_middle_of_a_request),
		SOCKET_TEST(test_send_to_a_client_that_has_just_died),
		SOCKET_TEST(test_out_of_descriptors),
		SOCKET_TEST(test_tcp_serves_and_a_port_in_use_is_an_error),
	};

	signal(SIGPIPE, SIG_IGN);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
