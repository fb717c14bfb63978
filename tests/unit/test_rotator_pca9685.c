/* SPDX-License-Identifier: Apache-2.0 */
/* The servo hat on a bus that fails or hangs, and its sensor by the test's hand. The wheel's
 * evidence: test_rotator_timed.c; the kernel's I2C and GPIO: tests/kernel. */
#include "lp_test.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/uri.h"
#include "drivers/wheel/pca9685/index.h"
#include "fake_i2c.h"
#include "include/rotator.h"
#include "loop_test.h"

#define DEADLOCK_S 120 /* the test program ends then */
#define PATIENCE_NS (60 * LP_NS_PER_S)
#define LED0_OFF_HIGH 0x09
#define FULL_OFF 0x10
#define MODE1 0x00
#define PRE_SCALE 0xFE

extern const struct lp_rotator_ops lp_rotator_pca9685_ops;

/* ---------------------------------------------------------------- a GPIO line */

struct lp_index {
	int fd;
};

static struct {
	int error; /* -errno of lp_index_open() */
	bool is_open;
} line;

int __wrap_lp_index_open(const char *chip, unsigned int number, struct lp_index **index);
int __wrap_lp_index_fd(const struct lp_index *index);
bool __wrap_lp_index_read(struct lp_index *index, int64_t *t_ns);
bool __wrap_lp_index_is_on(const struct lp_index *index);
void __wrap_lp_index_close(struct lp_index *index);

int __wrap_lp_index_open(const char *chip, unsigned int number, struct lp_index **index)
{
	assert_string_equal(chip, "gpiochip0");
	assert_int_equal(number, 17);
	if (line.error)
		return line.error;
	*index = calloc(1, sizeof(**index));
	(*index)->fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	line.is_open = true;
	return 0;
}

int __wrap_lp_index_fd(const struct lp_index *index)
{
	return index->fd;
}

bool __wrap_lp_index_read(struct lp_index *index, int64_t *t_ns)
{
	eventfd_t count;

	*t_ns = lp_clock_ns();
	return eventfd_read(index->fd, &count) == 0;
}

bool __wrap_lp_index_is_on(const struct lp_index *index)
{
	(void)index;
	return false;
}

void __wrap_lp_index_close(struct lp_index *index)
{
	if (!index)
		return;
	close(index->fd);
	free(index);
	line.is_open = false;
}

/* ---------------------------------------------------------------- the rotator */

static struct lp_loop *loop;
static struct lp_rotator *rotator;
static char waiting[600]; /* text of the fault; "": there is none */
static struct lp_wheel_state wheel;

static void on_state(void *context, const struct lp_wheel_state *state)
{
	(void)context;
	wheel = *state;
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	if (strcmp(id, "pca9685-waiting") == 0)
		(void)snprintf(waiting, sizeof(waiting), "%s", text ? text : "");
}

static int setup(void **state)
{
	struct lp_rotator_host host = {.state = on_state, .fault = on_fault};
	static struct lp_uri uri;

	(void)state;
	alarm(DEADLOCK_S);
	fake_i2c_init();
	memset(&line, 0, sizeof(line));
	waiting[0] = '\0';
	if (lp_loop_create(&loop) < 0 || lp_uri_parse(&uri, "pca9685:" FAKE_I2C) < 0)
		return -1;
	host.loop = loop;
	if (lp_rotator_pca9685_ops.create(&uri, &host, &rotator) < 0)
		return -1;
	return rotator->ops->start(rotator);
}

static int teardown(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, false);
	lp_rotator_pca9685_ops.destroy(rotator);
	rotator = NULL;
	lp_loop_destroy(loop);
	alarm(0);
	return 0;
}

#define UNTIL(condition)                                                           \
	do {                                                                       \
		const int64_t end_ns = lp_clock_ns() + PATIENCE_NS;                \
		while (!(condition)) {                                             \
			if (lp_clock_ns() > end_ns)                                \
				fail_msg("not seen: %s; %s", #condition, waiting); \
			(void)loop_turn(loop, 20);                                 \
		}                                                                  \
	} while (0)

static int pulse_high(void)
{
	int value;

	pthread_mutex_lock(&fake_i2c.lock);
	value = fake_i2c.registers[LED0_OFF_HIGH];
	pthread_mutex_unlock(&fake_i2c.lock);
	return value;
}

static void begin_to_home(void)
{
	UNTIL(line.is_open);
	rotator->ops->move(rotator, 45);
	UNTIL(wheel.phase == LP_WHEEL_HOMING);
	UNTIL(pulse_high() != FULL_OFF);
}

static void test_the_chip_is_set_up_and_the_servo_let_go_at_the_end(void **state)
{
	(void)state;
	begin_to_home();
	assert_int_equal(fake_i2c.registers[PRE_SCALE], 121);
	assert_int_equal(fake_i2c.registers[MODE1], 0x20); /* awake, registers count up */
	rotator->ops->destroy(rotator);
	UNTIL(pulse_high() == FULL_OFF);
	assert_false(line.is_open);
	rotator = NULL;
}

/* The loop goes on, says so, and looks again; once it stood still as long as the bus did. */
static void test_a_bus_that_hangs_does_not_hold_the_loop(void **state)
{
	(void)state;
	begin_to_home();
	FAKE_I2C_SET(hangs, true);
	UNTIL(strstr(waiting, "write: Connection timed out — the bus hangs"));
	assert_int_equal(wheel.phase, LP_WHEEL_ABSENT);
	UNTIL(strstr(waiting, "open: Device or resource busy — the bus hangs"));
	assert_int_equal(fake_i2c_get(&fake_i2c.opened), 1);
	FAKE_I2C_SET(hangs, false);
	UNTIL(line.is_open && !*waiting);
	UNTIL(wheel.phase == LP_WHEEL_HOMING); /* the angle is not known any more */
	assert_int_equal(wheel.reconnects, 1);
}

static void test_a_bus_that_hangs_from_the_beginning(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, true);
	UNTIL(strstr(waiting, "the bus hangs"));
	FAKE_I2C_SET(hangs, false);
	begin_to_home();
	assert_string_equal(waiting, "");
}

static void test_what_is_missing_is_named(void **state)
{
	(void)state;
	FAKE_I2C_SET(error, EREMOTEIO);
	UNTIL(strstr(waiting,
		     "set up: Remote I/O error — no acknowledge: check address and power"));
	FAKE_I2C_SET(error, 0);
	UNTIL(line.is_open);
	FAKE_I2C_SET(error, ENXIO);
	UNTIL(strstr(waiting, "write: No such device or address — no acknowledge"));
	line.error = -EINVAL;
	FAKE_I2C_SET(error, 0);
	UNTIL(strstr(waiting, "index: Invalid argument — check GPIO chip and line"));
	line.error = 0;
	UNTIL(line.is_open && !*waiting);
}

#define WHEEL_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		WHEEL_TEST(test_the_chip_is_set_up_and_the_servo_let_go_at_the_end),
		WHEEL_TEST(test_a_bus_that_hangs_does_not_hold_the_loop),
		WHEEL_TEST(test_a_bus_that_hangs_from_the_beginning),
		WHEEL_TEST(test_what_is_missing_is_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
