/* SPDX-License-Identifier: Apache-2.0 */
/* The I2C carrier on a bus that may hang. What it says over a good one: tests/kernel. */
#include "lp_test.h"

#include <errno.h>

#include "base/clock.h"
#include "drivers/link/carrier.h"
#include "fake_i2c.h"
#include "loop_test.h"

#define DEADLOCK_S 120 /* the test program ends then */

static struct lp_loop *loop;
static struct lp_link *carrier;
static int faults;
static bool is_faulty;

static void on_received(void *context, const struct lp_link_message *message, int64_t t_ns)
{
	(void)context;
	(void)message;
	(void)t_ns;
}

static void on_lost(void *context, const char *stage, const char *reason)
{
	(void)context;
	fail_msg("lost: %s: %s", stage, reason);
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	assert_string_equal(id, "i2c-nack");
	faults += text != NULL;
	is_faulty = text != NULL;
}

static int setup(void **state)
{
	const struct lp_link_settings settings = {.address = 0x2c};

	(void)state;
	alarm(DEADLOCK_S);
	fake_i2c_init();
	faults = 0;
	is_faulty = false;
	if (lp_loop_create(&loop) < 0)
		return -1;
	const struct lp_link_host host = {.loop = loop,
					  .received = on_received,
					  .lost = on_lost,
					  .fault = on_fault};

	return lp_link_i2c_ops.create(FAKE_I2C, &settings, &host, &carrier);
}

static int teardown(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, false);
	if (carrier)
		carrier->ops->destroy(carrier);
	carrier = NULL;
	lp_loop_destroy(loop);
	alarm(0);
	return 0;
}

static void open_carrier(void)
{
	const char *reason = "";
	int ret;

	while ((ret = carrier->ops->open(carrier, &reason)) == -EBUSY)
		(void)loop_turn(loop, 1);
	assert_int_equal(ret, 0);
}

static void wait_for(const int *value, int wanted)
{
	while (fake_i2c_get(value) != wanted)
		(void)loop_turn(loop, 1);
}

static void send_release(void)
{
	const struct lp_link_message message = {.id = 0x21, .length_bytes = 2, .payload = {7, 2}};

	assert_int_equal(carrier->ops->send(carrier, &message), 0);
}

static void test_closing_does_not_wait_for_a_bus_that_hangs(void **state)
{
	const char *reason = "";

	(void)state;
	FAKE_I2C_SET(hangs, true);
	open_carrier();
	wait_for(&fake_i2c.hanging, 1);
	carrier->ops->close(carrier); /* waited for ever, once */
	assert_int_equal(carrier->ops->open(carrier, &reason), -EBUSY);
	assert_string_equal(reason, "the last transfer has not ended: is SDA or SCL held low?");
	assert_int_equal(carrier->ops->send(carrier, &(struct lp_link_message){0}), -EAGAIN);
	FAKE_I2C_SET(hangs, false);
	open_carrier();
	assert_int_equal(fake_i2c_get(&fake_i2c.opened), 2);
}

static void test_destroying_does_not_wait_for_ever_either(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, true);
	open_carrier();
	wait_for(&fake_i2c.hanging, 1);
	carrier->ops->destroy(carrier);
	carrier = NULL;
	assert_int_equal(fake_i2c_get(&fake_i2c.hanging), 1);
	FAKE_I2C_SET(hangs, false); /* the thread frees what was its own */
	wait_for(&fake_i2c.hanging, 0);
}

/* The last message of all lets the servo go. */
static void test_what_was_sent_before_the_end_is_transferred(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, true);
	open_carrier();
	wait_for(&fake_i2c.hanging, 1);
	send_release();
	carrier->ops->close(carrier);
	FAKE_I2C_SET(hangs, false);
	carrier->ops->destroy(carrier);
	carrier = NULL;
	wait_for(&fake_i2c.writes, 1);
	assert_int_equal(fake_i2c.last[1], 0x21);
}

static void test_a_chip_that_does_not_answer_is_a_fault_that_ends(void **state)
{
	(void)state;
	FAKE_I2C_SET(error, EREMOTEIO);
	open_carrier();
	wait_for(&faults, 1);
	FAKE_I2C_SET(error, 0);
	send_release();
	wait_for(&fake_i2c.writes, 1);
}

/* The connection is begun anew every few seconds: that ends no fault. */
static void test_a_fault_outlives_the_connection(void **state)
{
	(void)state;
	FAKE_I2C_SET(error, EREMOTEIO);
	for (int i = 1; i < 4; i++) {
		open_carrier();
		wait_for(&faults, i);
		carrier->ops->close(carrier);
		assert_true(is_faulty);
	}
	open_carrier();
	wait_for(&faults, 4);
	FAKE_I2C_SET(error, 0);
	while (is_faulty)
		(void)loop_turn(loop, 1);
}

#define LINK_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		LINK_TEST(test_closing_does_not_wait_for_a_bus_that_hangs),
		LINK_TEST(test_destroying_does_not_wait_for_ever_either),
		LINK_TEST(test_what_was_sent_before_the_end_is_transferred),
		LINK_TEST(test_a_chip_that_does_not_answer_is_a_fault_that_ends),
		LINK_TEST(test_a_fault_outlives_the_connection),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
