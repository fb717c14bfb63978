/* SPDX-License-Identifier: Apache-2.0 */
/* What the daemon does about latched faults of the microcontroller, at times that the test sets. */
#include "lp_test.h"

#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "drivers/link/mcu_faults.h"
#include "drivers/link/mcu_parts.h"

#define START_NS (1000 * LP_NS_PER_S)
#define BIT(NAME) (UINT32_C(1) << MCU_FAULT_FAULT_##NAME##_CHOICE)

static struct lp_mcu mcu;
static struct lp_mcu_user user;
static uint32_t cleared; /* by the newest FaultClear; 0: none since the last look */
static char faults[32][32], texts[32][900];
static int fault_count;
static int64_t now_ns;

static int on_send(struct lp_link *link, const struct lp_link_message *message)
{
	struct mcu_fault_clear_t clear;

	(void)link;
	if (message->id == LP_MCU_ID(FAULT_CLEAR)) {
		mcu_fault_clear_unpack(&clear, message->payload, sizeof(message->payload));
		cleared = clear.faults;
	}
	return 0;
}

static const struct lp_link_ops ops = {.scheme = "test", .send = on_send};
static struct lp_link carrier = {.ops = &ops};

static int index_of(const char *id)
{
	for (int i = 0; i < fault_count; i++) {
		if (strcmp(faults[i], id) == 0)
			return i;
	}
	return -1;
}

static void on_fault(struct lp_mcu_user *self, const char *id, const char *text)
{
	int at = index_of(id);

	(void)self;
	if (text) {
		if (at < 0)
			at = fault_count++;
		(void)snprintf(faults[at], sizeof(faults[at]), "%s", id);
		(void)snprintf(texts[at], sizeof(texts[at]), "%s", text);
	} else if (at >= 0) {
		fault_count--;
		memmove(faults[at], faults[fault_count], sizeof(faults[at]));
		memmove(texts[at], texts[fault_count], sizeof(texts[at]));
	}
}

static int setup(void **state)
{
	(void)state;
	memset(&mcu, 0, sizeof(mcu));
	user = (struct lp_mcu_user){.fault = on_fault};
	mcu.users = &user;
	mcu.link = &carrier;
	mcu.recovery.clear =
		(struct lp_backoff){.first_ns = 2 * LP_NS_PER_S, .longest_ns = 60 * LP_NS_PER_S};
	(void)snprintf(mcu.object, sizeof(mcu.object), "mcu:test");
	fault_count = 0;
	cleared = 0;
	now_ns = START_NS;
	lp_clock_simulate(now_ns);
	return 0;
}

/* Lets time pass until faults are cleared; gives which, 0 when none were within the time. */
static uint32_t cleared_within(int64_t ns)
{
	cleared = 0;
	for (const int64_t end_ns = now_ns + ns; now_ns < end_ns && !cleared;) {
		now_ns += 20 * LP_NS_PER_MS;
		lp_clock_simulate(now_ns);
		lp_mcu_clear_faults(&mcu, now_ns);
	}
	return cleared;
}

static void test_what_somebody_must_see_is_never_cleared(void **state)
{
	(void)state;
	lp_mcu_set_faults(&mcu, BIT(PARAMS_LOST) | BIT(CAN_BUS_OFF), 0);
	assert_int_equal(fault_count, 2);
	assert_int_equal(cleared_within(3 * LP_NS_PER_S), BIT(CAN_BUS_OFF));
	lp_mcu_set_faults(&mcu, BIT(PARAMS_LOST), 0);
	assert_int_equal(cleared_within(600 * LP_NS_PER_S), 0);
	assert_int_equal(fault_count, 1);
	assert_string_equal(faults[0], "PARAMS_LOST");
}

static void test_only_faults_that_were_told_are_cleared(void **state)
{
	(void)state;
	lp_mcu_set_faults(&mcu, BIT(CAN_ABSENT), 3);
	/* Meanwhile the microcontroller has latched more; the news of it is on its way. */
	assert_int_equal(cleared_within(3 * LP_NS_PER_S), BIT(CAN_ABSENT));
	/* And a bit that this program does not know is nobody's to clear. */
	lp_mcu_set_faults(&mcu, UINT32_C(1) << 30, 0);
	assert_int_equal(cleared_within(600 * LP_NS_PER_S), 0);
	assert_int_equal(index_of("MCU_FAULT") >= 0, 1);
}

static void fail_to_home(uint32_t fault)
{
	lp_mcu_set_faults(&mcu, 0, 0);
	lp_mcu_set_faults(&mcu, fault, 1);
}

static void test_a_jam_keeps_its_name_and_is_tried_three_times(void **state)
{
	(void)state;
	lp_mcu_set_faults(&mcu, BIT(WHEEL_STUCK), -4500);
	for (int i = 0; i < 3; i++) {
		assert_false(lp_mcu_wheel_stopped(&mcu));
		assert_true(cleared_within(60 * LP_NS_PER_S) &
			    (BIT(WHEEL_STUCK) | BIT(INDEX_ALWAYS)));
		fail_to_home(BIT(INDEX_ALWAYS)); /* a tooth in a sensor: that is how homing ends */
		assert_int_equal(fault_count, 1);
		assert_string_equal(faults[0], "WHEEL_STUCK");
		assert_non_null(strstr(texts[0], "WHEEL_STUCK, homed again: INDEX_ALWAYS"));
	}
	assert_true(lp_mcu_wheel_stopped(&mcu));
	assert_non_null(
		strstr(texts[0], "three attempts failed: repair, then restart lightprobed"));
	assert_int_equal(cleared_within(3600 * LP_NS_PER_S), 0);
}

static void test_a_homing_that_succeeds_ends_the_trouble(void **state)
{
	(void)state;
	for (int i = 0; i < 10; i++) { /* again and again, but never three times in a row */
		lp_mcu_set_faults(&mcu, BIT(WHEEL_SLIP), 7);
		assert_int_equal(fault_count, 1);
		assert_int_equal(cleared_within(60 * LP_NS_PER_S), BIT(WHEEL_SLIP));
		lp_mcu_wheel_settled(&mcu); /* said before it failed */
		assert_int_equal(fault_count, 1);
		lp_mcu_set_faults(&mcu, 0, 0);
		assert_int_equal(fault_count, 1); /* cleared is not mended */
		lp_mcu_wheel_settled(&mcu);
		assert_int_equal(fault_count, 0);
		assert_false(lp_mcu_wheel_stopped(&mcu));
	}
}

/* The connection is lost, or the microcontroller was reset: until it says otherwise its faults are
 * as it said last, and nothing is told twice. */
static void test_faults_outlive_the_connection(void **state)
{
	(void)state;
	lp_mcu_set_faults(&mcu, BIT(PARAMS_LOST) | BIT(CAN_ABSENT), 0);
	for (int i = 0; i < 3; i++) {
		lp_mcu_forget_wheel_faults(&mcu);
		lp_mcu_was_reset(&mcu, MCU_HELLO_RESET_CAUSE_WATCHDOG_CHOICE);
		assert_int_equal(fault_count, 2);
		lp_mcu_set_faults(&mcu, BIT(PARAMS_LOST) | BIT(CAN_ABSENT), 0);
		assert_int_equal(fault_count, 2);
	}
	assert_int_equal(cleared_within(60 * LP_NS_PER_S), BIT(CAN_ABSENT));
	lp_mcu_forget_wheel_faults(&mcu);
	lp_mcu_set_faults(&mcu, 0, 0); /* another one was plugged in */
	assert_int_equal(fault_count, 0);
}

static void test_a_reset_by_a_person_allows_more_tries(void **state)
{
	static const struct {
		uint8_t cause;
		bool stays;
	} cases[] = {{MCU_HELLO_RESET_CAUSE_BROWN_OUT_CHOICE, true},
		     {MCU_HELLO_RESET_CAUSE_WATCHDOG_CHOICE, true},
		     {MCU_HELLO_RESET_CAUSE_UNKNOWN_CHOICE, true},
		     {MCU_HELLO_RESET_CAUSE_EXTERNAL_CHOICE, false},
		     {MCU_HELLO_RESET_CAUSE_POWER_ON_CHOICE, false}};

	(void)state;
	lp_mcu_set_faults(&mcu, BIT(WHEEL_STUCK), 0);
	for (int i = 0; i < 3; i++) {
		(void)cleared_within(60 * LP_NS_PER_S);
		fail_to_home(BIT(WHEEL_STUCK));
	}
	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		lp_mcu_forget_wheel_faults(&mcu);
		lp_mcu_was_reset(&mcu, cases[i].cause);
		assert_int_equal(lp_mcu_wheel_stopped(&mcu), cases[i].stays);
		assert_int_equal(fault_count, cases[i].stays);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_what_somebody_must_see_is_never_cleared, setup),
		cmocka_unit_test_setup(test_only_faults_that_were_told_are_cleared, setup),
		cmocka_unit_test_setup(test_a_jam_keeps_its_name_and_is_tried_three_times, setup),
		cmocka_unit_test_setup(test_a_homing_that_succeeds_ends_the_trouble, setup),
		cmocka_unit_test_setup(test_faults_outlive_the_connection, setup),
		cmocka_unit_test_setup(test_a_reset_by_a_person_allows_more_tries, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
