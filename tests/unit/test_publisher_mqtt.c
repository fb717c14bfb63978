/* SPDX-License-Identifier: Apache-2.0 */
/* mqtt: against a broker of a few lines, which this test answers for. */
#include "lp_test.h"

#include <arpa/inet.h>
#include <errno.h>
#include <mosquitto.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include "base/uri.h"
#include "drivers/publisher/mqtt/options.h"
#include "drivers/publisher/mqtt/reasons.h"
#include "include/packet.h"
#include "include/publisher.h"
#include "include/wish.h"
#include "loop_test.h"

extern const struct lp_publisher_ops lp_publisher_mqtt_ops, lp_publisher_mqtts_ops;

#define LONG_MS 20000
#define PAYLOAD_BYTES 1900 /* with two bytes of length before it */

static struct {
	int superseded;
	struct lp_client *client;
} heard;
static int packets_alive;

static int on_connected(void *context, struct lp_publisher *publisher, struct lp_client *client,
			int code, const char *refusal, void **user)
{
	(void)context, (void)publisher, (void)code, (void)refusal, (void)user;
	heard.client = client;
	return 0;
}

static void on_disconnected(void *context, void *user)
{
	(void)context, (void)user;
	heard.client = NULL;
}

static void on_superseded(void *context, void *user)
{
	(void)context, (void)user;
	heard.superseded++;
}

static struct lp_publisher_host host = {
	.connected = on_connected,
	.disconnected = on_disconnected,
	.superseded = on_superseded,
	.max_clients = 4,
};

static struct lp_publisher *publisher;
static int listener_fd, port;

/* ---------------------------------------------------------------- helpers */

static int setup(void **state)
{
	const int small = 4096; /* as little as may be on its way */
	struct sockaddr_in address = {.sin_family = AF_INET,
				      .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
	socklen_t length = sizeof(address);

	(void)state;
	(void)signal(SIGPIPE, SIG_IGN);
	memset(&heard, 0, sizeof(heard));
	packets_alive = 0;
	listener_fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
	assert_int_equal(setsockopt(listener_fd, SOL_SOCKET, SO_RCVBUF, &small, sizeof(small)), 0);
	assert_int_equal(bind(listener_fd, (struct sockaddr *)&address, sizeof(address)), 0);
	assert_int_equal(listen(listener_fd, 4), 0);
	assert_int_equal(getsockname(listener_fd, (struct sockaddr *)&address, &length), 0);
	port = ntohs(address.sin_port);
	return lp_loop_create(&host.loop);
}

static int teardown(void **state)
{
	(void)state;
	if (publisher)
		publisher->ops->destroy(publisher);
	publisher = NULL;
	lp_loop_destroy(host.loop);
	if (listener_fd >= 0)
		close(listener_fd);
	assert_int_equal(packets_alive, 0);
	return 0;
}

static int create(const char *text)
{
	struct lp_uri uri;
	const bool is_tls = strncmp(text, "mqtts", 5) == 0;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	return (is_tls ? lp_publisher_mqtts_ops : lp_publisher_mqtt_ops)
		.create(&uri, &host, &publisher);
}

static void start(const char *query)
{
	char text[128];

	(void)snprintf(text, sizeof(text), "mqtt:127.0.0.1:%d/a/b%s", port, query);
	assert_int_equal(create(text), 0);
	assert_int_equal(publisher->ops->start(publisher), 0);
	assert_non_null(heard.client);
}

static void release(struct lp_packet *packet)
{
	packets_alive--;
	free(packet);
}

static void send_named(const char *name, uint8_t filling)
{
	struct lp_packet *packet = calloc(1, sizeof(*packet) + PAYLOAD_BYTES + 2);

	*packet = (struct lp_packet){.references = 1,
				     .kind = LP_PACKET_STATE,
				     .name = name,
				     .size_bytes = PAYLOAD_BYTES + 2,
				     .release = release,
				     .data = (uint8_t *)(packet + 1)};
	packet->data[0] = PAYLOAD_BYTES % 128 | 128;
	packet->data[1] = PAYLOAD_BYTES / 128;
	memset(packet->data + 2, filling, PAYLOAD_BYTES);
	packets_alive++;
	publisher->ops->send(publisher, heard.client, packet);
	lp_packet_drop(packet);
}

static bool is_readable(int fd)
{
	struct pollfd readable = {.fd = fd, .events = POLLIN};

	return poll(&readable, 1, 0) > 0;
}

/* Let the publisher work until `fd` can be read. */
static void wait_readable(int fd)
{
	for (int waited_ms = 0; waited_ms < LONG_MS; waited_ms++) {
		if (is_readable(fd))
			return;
		(void)loop_turn(host.loop, 1);
	}
	fail_msg("nothing came in %d ms", LONG_MS);
}

/* Send, and whether it leaves soon. */
static bool is_taken(const char *name)
{
	send_named(name, 0);
	for (int turns = 0; turns < 300 && publisher->ops->pending(publisher); turns++)
		(void)loop_turn(host.loop, 1);
	return !publisher->ops->pending(publisher);
}

/* Take the publisher's connection, and answer it with a code of MQTT. */
static int answer(uint8_t code)
{
	uint8_t message[256];
	int fd;

	wait_readable(listener_fd);
	fd = accept(listener_fd, NULL, NULL);
	assert_true(fd >= 0);
	wait_readable(fd);
	assert_true(recv(fd, message, sizeof(message), 0) > 20);
	assert_int_equal(message[0], 0x10); /* CONNECT */
	assert_int_equal(send(fd, (uint8_t[]){0x20, 2, 0, code}, 4, MSG_NOSIGNAL), 4);
	return fd;
}

static void wait_for_reason(const char *words)
{
	for (int waited_ms = 0; waited_ms < LONG_MS; waited_ms++) {
		if (publisher->waits_for && strstr(publisher->waits_for, words))
			return;
		(void)loop_turn(host.loop, 1);
	}
	fail_msg("'%s' is not in '%s'", words, publisher->waits_for);
}

/* ---------------------------------------------------------------- the address */

static void test_addresses(void **state)
{
	static const struct {
		const char *text, *host, *port, *topic;
	} good[] = {
		{"mqtt:127.0.0.1/a", "127.0.0.1", "1883", "a"},
		{"mqtt://localhost:77/a/b c", "localhost", "77", "a/b c"},
		{"mqtts:broker.example/a", "broker.example", "8883", "a"},
		{"mqtts:[::1]/x", "::1", "8883", "x"},
		{"mqtts:[2001:db8::1]:9/x%2Fy", "2001:db8::1", "9", "x/y"},
	};
	struct lp_mqtt_options options;
	struct lp_uri uri;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(good); i++) {
		assert_int_equal(lp_uri_parse(&uri, good[i].text), 0);
		options.is_tls = strncmp(good[i].text, "mqtts", 5) == 0;
		assert_int_equal(lp_mqtt_options_read(&options, &uri), 0);
		assert_string_equal(options.broker.host, good[i].host);
		assert_string_equal(options.broker.port, good[i].port);
		assert_string_equal(options.topic, good[i].topic);
	}
	assert_float_equal(options.wish.rate_hz, 10, 0);
	assert_int_equal(options.wish.health_period_ms, 1000);
}

static void test_what_is_no_address(void **state)
{
	static const char *const bad[] = {
		"mqtt:",
		"mqtt:host",
		"mqtt:host/",
		"mqtt:/topic",
		"mqtt:::1/a",
		"mqtt:[::1/a",
		"mqtt:127.0.0.1:x/a",
		"mqtt:127.0.0.1:70000/a",
		"mqtt:127.0.0.1/a/+/b",
		"mqtt:127.0.0.1/a/%23",
		"mqtt:127.0.0.1//a",
		"mqtt:127.0.0.1/a/",
		"mqtt:127.0.0.1/$a",
		"mqtt:127.0.0.1/a%0Ab",
		"mqtt:127.0.0.1/a?sh_order=9",
		"mqtt:127.0.0.1/a?ca=/nowhere",
		"mqtts:127.0.0.1/a?ca=/nowhere",
		"mqtt:127.0.0.1/a?login=/nowhere",
		"mqtt:127.0.0.1/a?login=/dev/null",
	};
	char host_name[400], *text;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++)
		assert_int_equal(create(bad[i]), -EINVAL);
	memset(host_name, 'a', sizeof(host_name) - 1);
	host_name[sizeof(host_name) - 1] = '\0';
	assert_true(asprintf(&text, "mqtt:%s/a", host_name) > 0);
	assert_int_equal(create(text), -EINVAL);
	free(text);
	assert_true(asprintf(&text, "mqtt:127.0.0.1/%s", host_name) > 0);
	assert_int_equal(create(text), -EINVAL);
	free(text);
}

static void test_nothing_in_clear_beyond_this_machine(void **state)
{
	struct capture capture;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(create("mqtt:192.0.2.1/a"), -EACCES);
	capture_end(&capture);
	assert_contains(capture.text, "without encryption — use mqtts:, or accept this with "
				      "--insecure-lan");
	host.insecure_lan = true;
	assert_int_equal(create("mqtt:192.0.2.1/a"), 0);
	host.insecure_lan = false;
	assert_true(publisher->is_insecure);
}

static void test_a_login_is_two_lines(void **state)
{
	static const char *const bad[] = {"", "\n\n", "user", "user\n", "\npassword\n"};
	char path[] = "/tmp/lp-login-XXXXXX", why[200];
	struct lp_mqtt_login login;
	const int fd = mkstemp(path);

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		assert_int_equal(ftruncate(fd, 0), 0);
		assert_int_equal(pwrite(fd, bad[i], strlen(bad[i]), 0), strlen(bad[i]));
		assert_int_equal(lp_mqtt_login_read(path, &login, why, sizeof(why)), -EINVAL);
		assert_contains(why, "needs two lines");
	}
	assert_int_equal(pwrite(fd, "user\r\npass word", 15, 0), 15);
	assert_int_equal(lp_mqtt_login_read(path, &login, why, sizeof(why)), 0);
	assert_string_equal(login.user, "user");
	assert_string_equal(login.password, "pass word");
	close(fd);
	(void)unlink(path);
}

/* ---------------------------------------------------------------- the broker */

static void test_a_broker_that_is_away_costs_the_newest_alone(void **state)
{
	(void)state;
	close(listener_fd);
	listener_fd = -1;
	start("");
	send_named("hello", 0);
	assert_true(publisher->ops->pending(publisher));
	for (int i = 0; i < 1000; i++)
		send_named("estimate", (uint8_t)i);
	send_named("pong", 0); /* an answer: nobody has asked */
	assert_int_equal(packets_alive, 2);
	assert_int_equal(heard.superseded, 999);
	wait_for_reason(": connect: Connection refused — does the broker run there");
	assert_false(publisher->ops->pending(publisher)); /* --once does not wait for it */
}

static void test_a_broker_that_reads_nothing_costs_the_newest_alone(void **state)
{
	int fd;

	(void)state;
	start("");
	fd = answer(0);
	wait_readable(fd);
	assert_null(publisher->waits_for);
	while (is_taken("estimate")) { /* until what lies between is full */
	}
	for (int i = 0; i < 1000; i++)
		send_named("estimate", (uint8_t)i);
	assert_int_equal(packets_alive, 1);
	assert_true(heard.superseded >= 999);
	assert_true(publisher->ops->pending(publisher));
	close(fd);
	wait_for_reason(": connection: the broker has closed the connection");
	fd = answer(0); /* it comes again by itself */
	wait_readable(fd);
	close(fd);
}

static void test_a_broker_that_refuses(void **state)
{
	static const char *const words[] = {
		[1] = "does not speak MQTT 3.1.1",
		[2] = "does not take this client's id",
		[3] = "is not available now",
		[4] = "wants a user name and a password — name their file with login=",
		[5] = "wants a user name and a password — name their file with login=",
		[6] = "refused — see the log of the broker",
	};
	char text[160];

	(void)state;
	for (int code = 1; code < (int)LP_COUNT(words); code++) {
		const struct lp_mqtt_failure failure = {.code = MOSQ_ERR_CONN_REFUSED,
							.refusal = code};

		assert_string_equal(lp_mqtt_reason(&failure, text, sizeof(text)), "connect");
		assert_contains(text, words[code]);
	}
	start("");
	close(answer(5));
	wait_for_reason(words[5]);
}

static void test_who_speaks_no_mqtt_is_told(void **state)
{
	int fd;

	(void)state;
	start("");
	wait_readable(listener_fd);
	fd = accept(listener_fd, NULL, NULL);
	close(fd);
	wait_for_reason(": connect: closed before any answer — does this port speak MQTT?");
}

/* A broker may send what it likes: nobody has subscribed to it. */
static void test_a_broker_that_sends_is_left(void **state)
{
	static const uint8_t message[] = {0x30, 6, 0, 3, 'a', '/', 'b', 'x'};
	uint8_t left[512];
	ssize_t size = 1;
	int fd;

	(void)state;
	start("");
	fd = answer(0);
	assert_int_equal(send(fd, message, sizeof(message), MSG_NOSIGNAL), sizeof(message));
	while (size > 0) {
		wait_readable(fd);
		size = recv(fd, left, sizeof(left), MSG_DONTWAIT);
	}
	close(fd);
	wait_for_reason(": connection: the broker sends what nobody has subscribed to");
	close(answer(0));
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		TEST(test_addresses),
		TEST(test_what_is_no_address),
		TEST(test_nothing_in_clear_beyond_this_machine),
		TEST(test_a_login_is_two_lines),
		TEST(test_a_broker_that_is_away_costs_the_newest_alone),
		TEST(test_a_broker_that_reads_nothing_costs_the_newest_alone),
		TEST(test_a_broker_that_refuses),
		TEST(test_who_speaks_no_mqtt_is_told),
		TEST(test_a_broker_that_sends_is_left),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
