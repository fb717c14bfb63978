/* SPDX-License-Identifier: Apache-2.0 */
/* The CAN carrier on a bus that switches itself off. What it says over a good one: tests/kernel. */
#include "lp_test.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/link/carrier.h"
#include "loop_test.h"

#define FIRST_ID 0x540 /* of what the microcontroller sends */

static struct lp_loop *loop;
static struct lp_link *carrier;
static int bus = -1; /* the other end of the carrier's socket */
static int received, lost;
static bool is_faulty;

/* ---------------------------------------------------------------- an interface without hardware */

int __wrap_socket(int domain, int type, int protocol);
int __wrap_bind(int fd, const struct sockaddr *address, socklen_t length);
int __wrap_setsockopt(int fd, int level, int name, const void *value, socklen_t length);
int __wrap_ioctl(int fd, unsigned long request, void *value);

int __wrap_socket(int domain, int type, int protocol)
{
	int ends[2];

	(void)protocol;
	assert_int_equal(domain, PF_CAN);
	assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET | (type & SOCK_NONBLOCK), 0, ends), 0);
	if (bus >= 0)
		close(bus);
	bus = ends[1];
	return ends[0];
}

int __wrap_bind(int fd, const struct sockaddr *address, socklen_t length)
{
	(void)fd;
	(void)address;
	(void)length;
	return 0;
}

int __wrap_setsockopt(int fd, int level, int name, const void *value, socklen_t length)
{
	(void)fd;
	(void)level;
	(void)name;
	(void)value;
	(void)length;
	return 0;
}

int __wrap_ioctl(int fd, unsigned long request, void *value)
{
	(void)fd;
	if (request == SIOCGIFFLAGS)
		((struct ifreq *)value)->ifr_flags = IFF_UP;
	return 0;
}

/* ---------------------------------------------------------------- */

static void on_received(void *context, const struct lp_link_message *message, int64_t t_ns)
{
	(void)context;
	(void)message;
	(void)t_ns;
	received++;
}

static void on_lost(void *context, const char *stage, const char *reason)
{
	(void)context;
	(void)stage;
	(void)reason;
	lost++;
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	assert_string_equal(id, "can-bus-off");
	is_faulty = text != NULL;
}

static int setup(void **state)
{
	const struct lp_link_settings settings = {0};

	(void)state;
	received = 0;
	lost = 0;
	is_faulty = false;
	if (lp_loop_create(&loop) < 0)
		return -1;
	const struct lp_link_host host = {.loop = loop,
					  .received = on_received,
					  .lost = on_lost,
					  .fault = on_fault};

	return lp_link_can_ops.create("can0", &settings, &host, &carrier);
}

static int teardown(void **state)
{
	(void)state;
	carrier->ops->destroy(carrier);
	lp_loop_destroy(loop);
	close(bus);
	bus = -1;
	return 0;
}

static void open_carrier(void)
{
	const char *reason = "";

	assert_int_equal(carrier->ops->open(carrier, &reason), 0);
}

static void hear(canid_t id, int length)
{
	const struct can_frame frame = {.can_id = id, .can_dlc = (uint8_t)length};

	assert_int_equal(write(bus, &frame, sizeof(frame)), sizeof(frame));
	while (loop_turn(loop, 0))
		;
}

static void hear_error(canid_t error)
{
	hear(CAN_ERR_FLAG | error, CAN_ERR_DLC);
}

static void hear_the_microcontroller(void)
{
	canid_t id = FIRST_ID;

	while (lp_link_length((uint8_t)(id - 0x500)) < 0)
		id++;
	hear(id, lp_link_length((uint8_t)(id - 0x500)));
}

static void test_a_bus_that_is_off_stays_so_over_connections(void **state)
{
	(void)state;
	open_carrier();
	hear_error(CAN_ERR_BUSOFF);
	assert_true(is_faulty);
	for (int retry = 0; retry < 3; retry++) { /* nothing is heard: the link is opened anew */
		carrier->ops->close(carrier);
		open_carrier();
		assert_true(is_faulty);
	}
	hear_the_microcontroller();
	assert_int_equal(received, 1);
	assert_false(is_faulty);
}

static void test_a_controller_that_restarts_ends_it(void **state)
{
	(void)state;
	open_carrier();
	hear_error(CAN_ERR_BUSOFF);
	assert_true(is_faulty);
	carrier->ops->close(carrier);
	open_carrier();
	hear_error(CAN_ERR_RESTARTED);
	assert_false(is_faulty);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_a_bus_that_is_off_stays_so_over_connections,
						setup, teardown),
		cmocka_unit_test_setup_teardown(test_a_controller_that_restarts_ends_it, setup,
						teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
