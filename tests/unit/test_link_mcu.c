/* SPDX-License-Identifier: Apache-2.0 */
/* The names are the schema's; and a session on a pty, the microcontroller by the test's hand. */
#include "lp_test.h"

#include <math.h>
#include <poll.h>
#include <pty.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>

#include "base/uri.h"
#include "dbc/mcu.h"
#include "drivers/link/envelope.h"
#include "drivers/link/mcu.h"
#include "drivers/link/mcu_faults.h"
#include "drivers/ring/ldr.h"
#include "include/connections.h"
#include "loop_test.h"

static void test_names_are_the_schemas(void **state)
{
#define SAME(NAME) assert_string_equal(lp_mcu_fault(MCU_FAULT_FAULT_##NAME##_CHOICE)->name, #NAME)
	(void)state;
	SAME(WHEEL_STUCK);
	SAME(WHEEL_SLOW);
	SAME(WHEEL_SLIP);
	SAME(WHEEL_TOO_FAST);
	SAME(INDEX_NEVER);
	SAME(INDEX_ALWAYS);
	SAME(INDEX_PATTERN);
	SAME(INDEX_NOISE);
	SAME(FEEDBACK_OPEN);
	SAME(SUPPLY_LOW);
	SAME(LDR_OPEN);
	SAME(LDR_SHORTED);
	SAME(PARAMS_LOST);
	SAME(PARAMS_COPY_LOST);
	SAME(CAN_ABSENT);
	SAME(CAN_BUS_OFF);
	SAME(RESET_BROWN_OUT);
	SAME(RESET_WATCHDOG);
	SAME(RESET_STACK);
	assert_string_equal(lp_mcu_fault(MCU_FAULT_FAULT_I2_C_BUS_CHOICE)->name, "I2C_BUS");
	assert_string_equal(lp_mcu_fault(31)->name, "MCU_FAULT");
	assert_string_equal(lp_mcu_fault(99)->name, "MCU_FAULT");
	assert_string_equal(lp_mcu_reset_cause(MCU_HELLO_RESET_CAUSE_WATCHDOG_CHOICE), "watchdog");
	assert_string_equal(lp_mcu_reset_cause(MCU_HELLO_RESET_CAUSE_REQUESTED_CHOICE),
			    "on request");
	assert_string_equal(lp_mcu_reset_cause(15), "cause unknown");
}

/* ---------------------------------------------------------------- a session */

static struct session {
	int device;
	struct lp_loop *loop;
	struct lp_connections connections;
	struct lp_mcu *mcu;
	struct lp_mcu_user user;
	int found, lost, wheels, rings;
	struct lp_mcu_wheel wheel;
	struct lp_mcu_ring ring;
	char fault[32];
} session;

static void on_found(struct lp_mcu_user *user)
{
	(void)user;
	session.found++;
}

static void on_lost(struct lp_mcu_user *user)
{
	(void)user;
	session.lost++;
}

static void on_wheel(struct lp_mcu_user *user, const struct lp_mcu_wheel *wheel)
{
	(void)user;
	session.wheels++;
	session.wheel = *wheel;
}

static void on_ring(struct lp_mcu_user *user, const struct lp_mcu_ring *ring)
{
	(void)user;
	session.rings++;
	session.ring = *ring;
}

static void on_fault(struct lp_mcu_user *user, const char *id, const char *text)
{
	(void)user;
	if (text)
		(void)snprintf(session.fault, sizeof(session.fault), "%s", id);
	else if (strcmp(session.fault, id) == 0)
		session.fault[0] = '\0';
}

static int setup(void **state)
{
	static struct lp_uri uri;
	char name[64], text[128];
	int line;

	(void)state;
	memset(&session, 0, sizeof(session));
	if (openpty(&session.device, &line, name, NULL, NULL) < 0)
		return -1;
	(void)snprintf(text, sizeof(text), "mcu:serial:%s", name);
	session.user = (struct lp_mcu_user){.found = on_found,
					    .lost = on_lost,
					    .wheel = on_wheel,
					    .ring = on_ring,
					    .fault = on_fault};
	if (lp_uri_parse(&uri, text) < 0 || lp_loop_create(&session.loop) < 0 ||
	    lp_mcu_join(&session.connections, session.loop, &uri, &session.user, &session.mcu) < 0)
		return -1;
	lp_mcu_start(session.mcu);
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	lp_mcu_leave(session.mcu, &session.user);
	close(session.device);
	lp_loop_destroy(session.loop);
	return session.connections.first ? -1 : 0;
}

#define ID(NAME) (MCU_##NAME##_FRAME_ID - 0x500)
#define SAY(name, NAME, ...)                                                            \
	do {                                                                            \
		const struct mcu_##name##_t signals = {__VA_ARGS__};                    \
		struct lp_link_message message = {.id = ID(NAME),                       \
						  .length_bytes = MCU_##NAME##_LENGTH}; \
		uint8_t bytes[LP_SERIAL_FRAME_MAX_BYTES];                               \
		mcu_##name##_pack(message.payload, &signals, 8);                        \
		const size_t size = lp_serial_pack(&message, bytes);                    \
		assert_int_equal(write(session.device, bytes, size), size);             \
	} while (0)

/* Let it work until `*count` has reached `wanted`, or the microcontroller is asked for `id`. */
static bool until(const int *count, int wanted, int id)
{
	static uint8_t frame[64];
	static size_t length;

	for (int i = 0; i < 2000; i++) {
		struct pollfd polled = {.fd = session.device, .events = POLLIN};
		uint8_t byte;

		if (count && *count >= wanted)
			return true;
		if (session.found && i % 50 == 49) /* it is not silent */
			SAY(counters_work, COUNTERS_WORK, .uptime_s = 1);
		(void)loop_turn(session.loop, 10);
		while (poll(&polled, 1, 0) == 1 && read(session.device, &byte, 1) == 1) {
			if (byte || length == 0) {
				if (byte && length < sizeof(frame))
					frame[length++] = byte;
				continue;
			}
			/* The id stands after the first block's length, and is never 0. */
			length = 0;
			if (frame[1] == id)
				return true;
		}
	}
	return false;
}

static void greet(uint16_t boot_count)
{
	const int before = session.found;

	assert_true(until(NULL, 0, ID(HELLO_REQUEST)));
	SAY(hello, HELLO, .protocol_major = 1, .boot_count = boot_count);
	assert_true(until(NULL, 0, ID(RATES)));
	SAY(result, RESULT, .request = ID(RATES));
	assert_true(until(&session.found, before + 1, 0));
}

static void say_wheel(uint8_t counter, uint8_t time_counter)
{
	SAY(wheel_state, WHEEL_STATE, .counter = counter, .phase = 3, .token = 9,
	    .commanded_cdeg = 4500, .measured_cdeg = 4512, .sigma_cdeg = 60);
	SAY(wheel_time, WHEEL_TIME, .counter = time_counter, .phase = 3, .token = 9,
	    .t_phase_us = 1000, .age_ms = 5);
}

static void test_what_it_says_is_understood(void **state)
{
	(void)state;
	greet(1);
	say_wheel(2, 2);
	assert_true(until(&session.wheels, 1, 0));
	assert_int_equal(session.wheel.token, 9);
	assert_int_equal(session.wheel.state.phase, LP_WHEEL_SETTLED);
	assert_true(fabsf(session.wheel.state.measured_deg - 45.12F) < 1e-4F);
	assert_true(fabsf(session.wheel.state.sigma_deg - 0.6F) < 1e-4F);
	assert_true(session.wheel.state.t_seen_ns == 0); /* no request was answered yet */
	SAY(ring0, RING0, .counter = 255, .t_us = 7, .level_0 = 10, .level_1 = 11);
	SAY(ring1, RING1, .counter = 255, .level_2 = 12, .level_3 = 13, .level_4 = 14,
	    .level_5 = 15);
	SAY(ring2, RING2, .counter = 255, .level_6 = 16, .level_7 = 17, .level_8 = 18, .dead = 256);
	assert_true(until(&session.rings, 1, 0));
	for (int k = 0; k < LP_RING_SENSORS; k++)
		assert_int_equal(session.ring.levels[k], 10 + k);
	assert_int_equal(session.ring.dead, 256);
	const uint32_t first = session.ring.sequence;

	/* One ring without its middle, then a whole one; the counter has wrapped round. */
	SAY(ring0, RING0, .counter = 0);
	SAY(ring2, RING2, .counter = 0);
	SAY(ring0, RING0, .counter = 1);
	SAY(ring1, RING1, .counter = 1);
	SAY(ring2, RING2, .counter = 1);
	assert_true(until(&session.rings, 2, 0));
	assert_int_equal(session.ring.sequence - first, 2);
	SAY(fault, FAULT, .fault = 3, .active = 1, .detail = 7);
	say_wheel(3, 3);
	assert_true(until(&session.wheels, 2, 0));
	assert_string_equal(session.fault, "WHEEL_SLIP");
	assert_true(until(NULL, 0, ID(FAULT_CLEAR))); /* by itself, after a while */
	SAY(fault_state, FAULT_STATE, .latched = 0);
	say_wheel(4, 4);
	assert_true(until(&session.wheels, 3, 0));
	assert_string_equal(session.fault, "");
}

static void test_halves_of_two_states_are_no_state(void **state)
{
	(void)state;
	greet(1);
	say_wheel(2, 3);
	say_wheel(4, 4);
	assert_true(until(&session.wheels, 1, 0));
	assert_int_equal(session.wheels, 1);
}

static void test_seen_is_when_the_answered_request_was_sent(void **state)
{
	(void)state;
	greet(1);
	SAY(time_reply, TIME_REPLY, .count = 1, .t_rx_us = 5000, .turnaround_us = 1, .stamped = 1);
	say_wheel(1, 1);
	assert_true(until(&session.wheels, 1, 0));
	const int64_t seen_ns = session.wheel.state.t_seen_ns;

	assert_true(seen_ns > 0);
	/* The same answer again, or one that nobody asked for, says nothing. */
	SAY(time_reply, TIME_REPLY, .count = 1, .t_rx_us = 9000, .stamped = 1);
	SAY(time_reply, TIME_REPLY, .count = 200, .t_rx_us = 9000, .stamped = 1);
	say_wheel(2, 2);
	assert_true(until(&session.wheels, 2, 0));
	assert_true(session.wheel.state.t_seen_ns == seen_ns);
	assert_false(isnan(session.wheel.state.clock_sigma_us));
}

static void test_an_unasked_hello_is_a_reset(void **state)
{
	(void)state;
	greet(1);
	SAY(hello, HELLO, .protocol_major = 1, .boot_count = 2, .reset_cause = 4);
	assert_true(until(&session.lost, 1, 0));
	assert_true(until(NULL, 0, ID(RATES)));
	SAY(result, RESULT, .request = ID(RATES));
	assert_true(until(&session.found, 2, 0));
	say_wheel(1, 1);
	assert_true(until(&session.wheels, 1, 0));
	assert_int_equal(session.wheel.state.reconnects, 1);
}

static void test_illuminance_of_levels(void **state)
{
	struct lp_ldr_calibration calibration;

	(void)state;
	lp_ldr_defaults(&calibration);
	/* R10 at 10 lx, wherever it lies in the divider. */
	const float share = 3300.0F / (3300.0F + 14000.0F);

	assert_true(fabsf(lp_ldr_lux(&calibration, 4, share) - 10) < 1e-3F);
	calibration.gamma[2] = 1;
	calibration.r10_ohm[2] = 33000;
	assert_true(fabsf(lp_ldr_lux(&calibration, 2, 0.5F) - 100) < 1e-2F);
	assert_true(isnan(lp_ldr_lux(&calibration, 0, 0)));
	assert_true(isnan(lp_ldr_lux(&calibration, 0, 1)));
	assert_true(isnan(lp_ldr_lux(&calibration, 0, NAN)));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_names_are_the_schemas),
		cmocka_unit_test_setup_teardown(test_what_it_says_is_understood, setup, teardown),
		cmocka_unit_test_setup_teardown(test_halves_of_two_states_are_no_state, setup,
						teardown),
		cmocka_unit_test_setup_teardown(test_seen_is_when_the_answered_request_was_sent,
						setup, teardown),
		cmocka_unit_test_setup_teardown(test_an_unasked_hello_is_a_reset, setup, teardown),
		cmocka_unit_test(test_illuminance_of_levels),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
