/* SPDX-License-Identifier: Apache-2.0 */
/* The names are the schema's; and a session on a pty, the microcontroller by the test's hand. */
#include "lp_test.h"

#include <errno.h>
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
#include "drivers/link/mcu_parts.h"
#include "drivers/ring/ldr.h"
#include "include/connections.h"
#include "loop_test.h"

/* The table's names and numbers are the schema's: cantools made the numbers here. */
static void test_names_are_the_schemas(void **state)
{
	(void)state;
	/* cantools spells "I2C" so. */
#define MCU_FAULT_FAULT_I2C_BUS_CHOICE MCU_FAULT_FAULT_I2_C_BUS_CHOICE
#define SAME(NAME, number)                                         \
	assert_int_equal(MCU_FAULT_FAULT_##NAME##_CHOICE, number); \
	assert_string_equal(lp_mcu_fault(MCU_FAULT_FAULT_##NAME##_CHOICE)->name, #NAME);
	MCU_FAULTS(SAME)
	assert_string_equal(lp_mcu_fault(31)->name, "MCU_FAULT");
	assert_string_equal(lp_mcu_fault(99)->name, "MCU_FAULT");
	assert_string_equal(lp_mcu_reset_cause(MCU_HELLO_RESET_CAUSE_WATCHDOG_CHOICE), "watchdog");
	assert_string_equal(lp_mcu_reset_cause(MCU_HELLO_RESET_CAUSE_REQUESTED_CHOICE),
			    "on request");
	assert_string_equal(lp_mcu_reset_cause(15), "cause unknown: the boot loader hides it");
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
	char fault[32], name[64];
	uint8_t asked; /* first byte of what was asked last */
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

/* As a wheel or a ring would, with a URI of this query. 0 or -errno. */
static int join(const char *query, struct lp_mcu_user *user, struct lp_mcu **mcu)
{
	struct lp_mcu_settings settings;
	struct lp_uri uri;
	char text[160];

	(void)snprintf(text, sizeof(text), "mcu:serial:%s%s", session.name, query);
	if (lp_uri_parse(&uri, text) < 0 || lp_uri_read(&uri, &lp_mcu_params, &settings) < 0)
		return -1;
	return lp_mcu_join(&session.connections, session.loop, &uri, &settings, user, mcu);
}

static int setup(void **state)
{
	int line;

	(void)state;
	memset(&session, 0, sizeof(session));
	if (openpty(&session.device, &line, session.name, NULL, NULL) < 0)
		return -1;
	session.user = (struct lp_mcu_user){.found = on_found,
					    .lost = on_lost,
					    .wheel = on_wheel,
					    .ring = on_ring,
					    .fault = on_fault};
	if (lp_loop_create(&session.loop) < 0 || join("", &session.user, &session.mcu) < 0)
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
			session.asked = frame[2];
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

/* Of a protocol that has WheelRequest. */
static void greet_newer(void)
{
	assert_true(until(NULL, 0, ID(HELLO_REQUEST)));
	SAY(hello, HELLO, .protocol_major = 1, .protocol_minor = 1, .boot_count = 1);
	assert_true(until(NULL, 0, ID(RATES)));
	SAY(result, RESULT, .request = ID(RATES));
	assert_true(until(&session.found, 1, 0));
}

static void reply_wheel(uint8_t count, uint8_t phase, int16_t measured_cdeg)
{
	SAY(wheel_reply, WHEEL_REPLY, .count = count, .phase = phase, .token = 9,
	    .measured_cdeg = measured_cdeg, .sigma_cdeg = 60);
}

static void test_a_look_is_one_small_message_each_way(void **state)
{
	(void)state;
	greet_newer();
	say_wheel(1, 1);
	assert_true(until(&session.wheels, 1, 0));
	lp_mcu_look(session.mcu);
	assert_true(until(NULL, 0, ID(WHEEL_REQUEST)));
	reply_wheel(2, 3, 4533); /* 1 was the clock's, after Rates */
	assert_true(until(&session.wheels, 2, 0));
	assert_true(fabsf(session.wheel.state.measured_deg - 45.33F) < 1e-4F);
	assert_int_equal(session.wheel.state.phase, LP_WHEEL_SETTLED);
	const int64_t seen_ns = session.wheel.state.t_seen_ns;

	assert_true(seen_ns > 0);
	/* Answered already, or of a phase whose beginning was not told yet: nothing is told. */
	reply_wheel(2, 3, 4600);
	lp_mcu_look(session.mcu);
	assert_true(until(NULL, 0, ID(WHEEL_REQUEST)));
	reply_wheel(3, 2, 4600);
	say_wheel(2, 2); /* and this is newer than that reply */
	assert_true(until(&session.wheels, 3, 0));
	assert_int_equal(session.wheels, 3);
	assert_true(fabsf(session.wheel.state.measured_deg - 45.12F) < 1e-4F);
	assert_true(session.wheel.state.t_seen_ns > seen_ns);
}

static void test_older_firmware_is_asked_as_it_understands(void **state)
{
	(void)state;
	greet(1);
	lp_mcu_look(session.mcu);
	assert_true(until(NULL, 0, ID(STATUS_REQUEST)));
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

/* A port that can be opened may fail at once again: only an answer ends the fault. */
static void test_what_is_open_is_not_yet_well(void **state)
{
	(void)state;
	greet(1);
	lp_mcu_lost(session.mcu, "receive", "as if unplugged");
	assert_string_equal(session.fault, "mcu-waiting");
	assert_true(until(NULL, 0, ID(HELLO_REQUEST))); /* it is open */
	assert_string_equal(session.fault, "mcu-waiting");
	greet(1);
	assert_string_not_equal(session.fault, "mcu-waiting");
}

/* Wheel and ring name one device, each with keys of its own. */
static void test_keys_of_every_uri_of_a_connection_count(void **state)
{
	struct lp_mcu_user ring = session.user;
	struct capture capture;
	struct lp_mcu *mcu;

	(void)state;
	capture_begin(&capture);
	assert_int_equal(join("?baud=115200", &ring, &mcu), -EINVAL);
	capture_end(&capture);
	assert_contains(capture.text, "give the same values in both");
	assert_int_equal(join("?baud=500000&ring_scans=80", &ring, &mcu), 0);
	assert_ptr_equal(mcu, session.mcu);
	assert_true(until(NULL, 0, ID(HELLO_REQUEST)));
	SAY(hello, HELLO, .protocol_major = 1, .boot_count = 1, .reset_cause = 1);
	assert_true(until(NULL, 0, ID(RATES)));
	assert_int_equal(session.asked, 80);
	lp_mcu_leave(mcu, &ring);
}

static float share_of(const struct lp_ldr_calibration *calibration, int sensor, float ohm)
{
	const struct lp_ldr *ldr = &calibration->sensors[sensor];

	return calibration->divider_ohm / (calibration->divider_ohm + ldr->series_ohm + ohm);
}

static void test_illuminance_of_levels(void **state)
{
	struct lp_ldr_calibration calibration;
	float sigma;

	(void)state;
	lp_ldr_defaults(&calibration);
	/* R10 at 10 lx, wherever it lies in the divider. */
	const float share = share_of(&calibration, 4, 14000);

	assert_true(fabsf(lp_ldr_lux(&calibration, 4, share, &sigma) - 10) < 1e-3F);
	/* At the pivot: what the fit and the drift leave, and a little by the ADC. */
	assert_true(sigma > hypotf(0.4F, 0.15F) && sigma < 1.02F * hypotf(0.4F, 0.15F));
	calibration.sensors[2].gamma = 1;
	calibration.sensors[2].r10_ohm = 33000;
	assert_true(fabsf(lp_ldr_lux(&calibration, 2, share_of(&calibration, 2, 3300), &sigma) -
			  100) < 1e-2F);
	assert_true(isnan(lp_ldr_lux(&calibration, 0, 0, &sigma)));
	assert_true(isnan(sigma));
	assert_true(isnan(lp_ldr_lux(&calibration, 0, 1, &sigma)));
	assert_true(isnan(lp_ldr_lux(&calibration, 0, NAN, &sigma)));
}

static void test_sigma_of_illuminance_grows_with_what_is_not_known(void **state)
{
	struct lp_ldr_calibration calibration;
	float sigma, brighter;

	(void)state;
	lp_ldr_defaults(&calibration);
	/* The series resistance against the LDR's own, to first order. */
	calibration.sensors[0] = (struct lp_ldr){.r10_ohm = 14000,
						 .gamma = 0.7F,
						 .series_ohm = 85,
						 .pivot_lux = 10,
						 .series_sigma_ohm = 20};
	calibration.drift_sigma = 0;
	(void)lp_ldr_lux(&calibration, 0, share_of(&calibration, 0, 200), &sigma);
	assert_true(fabsf(sigma - 20.0F / 200 / 0.7F) < 0.01F);
	/* Less resistance than what is in series has: bright, and hardly known. */
	assert_true(lp_ldr_lux(&calibration, 0, 4080.0F / 4092, &brighter) > 5e4F);
	assert_true(brighter > 1);
}

/* As slow as the data sheet says at 10 lx and above, and slower in the dark. The noise is what one
 * level changes. */
static void test_how_an_ldr_follows_the_light(void **state)
{
	struct lp_ldr_calibration calibration;
	struct lp_ring_sample sample;
	float sigma;

	(void)state;
	lp_ldr_defaults(&calibration);
	lp_ldr_dynamics(&calibration, 0, 500, &sample);
	assert_float_equal(sample.rise_s[0], 0.02F, 1e-6F);
	assert_float_equal(sample.fall_s[0], 0.03F, 1e-6F);
	const float share = share_of(&calibration, 0, 14000 * powf(50, -0.7F));
	const float more = lp_ldr_lux(&calibration, 0, share + 1.0F / 4092, &sigma);

	assert_float_equal(sample.noise_relative[0], more / 500 - 1, 1e-2F * (more / 500 - 1));
	lp_ldr_dynamics(&calibration, 0, 0.1F, &sample);
	assert_float_equal(sample.rise_s[0], 0.2F, 1e-5F);
	assert_float_equal(sample.fall_s[0], 0.3F, 1e-5F);
	assert_true(sample.noise_relative[0] > 0.01F);
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
		cmocka_unit_test_setup_teardown(test_what_is_open_is_not_yet_well, setup, teardown),
		cmocka_unit_test_setup_teardown(test_a_look_is_one_small_message_each_way, setup,
						teardown),
		cmocka_unit_test_setup_teardown(test_older_firmware_is_asked_as_it_understands,
						setup, teardown),
		cmocka_unit_test_setup_teardown(test_keys_of_every_uri_of_a_connection_count, setup,
						teardown),
		cmocka_unit_test(test_illuminance_of_levels),
		cmocka_unit_test(test_how_an_ldr_follows_the_light),
		cmocka_unit_test(test_sigma_of_illuminance_grows_with_what_is_not_known),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
