/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>

#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/param.h"
#include "drivers/wheel/timed.h"

#define STEP_NS LP_NS_PER_MS

/* A servo with its wheel, under a model that sees its edges only. */
static struct world {
	struct lp_timed timed;
	int64_t now_ns;
	float wheel_deg;
	float servo_deg_s, off_deg; /* of the servo's zero */
	bool stuck, dark, lying;
	float asked_deg[64]; /* the lag */
} world;

static int setup(void **state)
{
	(void)state;
	world = (struct world){.now_ns = LP_NS_PER_S, .wheel_deg = 100, .servo_deg_s = 400};
	lp_param_defaults(&lp_timed_keys, &world.timed.params);
	lp_timed_init(&world.timed);
	return 0;
}

static int below(float angle_deg)
{
	const int count = (int)ceilf((angle_deg + 16.5F) / 6);

	return count < 0 ? 0 : count > 34 ? 34 : count;
}

static void step(void)
{
	const float pulse_us = lp_timed_pulse_us(&world.timed, world.now_ns);
	const int at = (int)(world.now_ns / STEP_NS % 64);
	const int before = below(world.wheel_deg);
	const float most_deg = world.servo_deg_s * 1e-3F;

	world.asked_deg[at] = pulse_us > 0 ? (pulse_us - 800) / 7.407F - world.off_deg : NAN;
	const float asked_deg = world.asked_deg[(at + 64 - 40) % 64];

	if (!world.stuck && !isnan(asked_deg))
		world.wheel_deg += fminf(fmaxf(asked_deg - world.wheel_deg, -most_deg), most_deg);
	world.now_ns += STEP_NS;
	for (int k = abs(below(world.wheel_deg) - before); k > 0 && !world.dark; k--)
		lp_timed_edge(&world.timed, world.now_ns);
	if (world.lying && world.timed.step == LP_TIMED_UP &&
	    world.now_ns - world.timed.t_step_ns > LP_NS_PER_S / 7)
		lp_timed_edge(&world.timed, world.now_ns);
	lp_timed_tick(&world.timed, world.now_ns, false);
}

/* Until it rests or fails; the angle that it claims is the true one, all the way. */
static struct lp_wheel_state run(float seconds)
{
	struct lp_wheel_state state;

	for (int i = 0; i < (int)(seconds * 1000); i++) {
		step();
		lp_timed_state(&world.timed, world.now_ns, &state);
		assert_true(isnan(state.measured_deg) ||
			    fabsf(state.measured_deg - world.wheel_deg) <= 3 * state.sigma_deg);
	}
	return state;
}

static void move(float target_deg)
{
	const char *reason;

	assert_int_equal(lp_timed_move(&world.timed, target_deg, world.now_ns, &reason), 0);
}

static void test_moves_arrive(void **state)
{
	static const float offsets[] = {0, 4, -4};

	for (size_t i = 0; i < LP_COUNT(offsets); i++) {
		setup(state);
		world.off_deg = offsets[i];
		move(45);
		assert_int_equal(run(0.5F).phase, LP_WHEEL_HOMING);
		assert_int_equal(run(7).phase, LP_WHEEL_SETTLED);
		assert_true(fabsf(world.wheel_deg - 45) < 1);
		for (int target = 0; target <= 180; target += 45) {
			move((float)target);
			assert_int_equal(run(0.2F).phase, LP_WHEEL_MOVING);
			const struct lp_wheel_state there = run(7);

			assert_int_equal(there.phase, LP_WHEEL_SETTLED);
			assert_true(fabsf(world.wheel_deg - (float)target) < 1);
			assert_true(there.sigma_deg < 1.7F);
		}
		/* Let go after a while; what is known stays so. */
		assert_int_equal(run(11).phase, LP_WHEEL_SETTLED);
		assert_true(lp_timed_pulse_us(&world.timed, world.now_ns) == 0);
	}
}

static void test_targets_that_nothing_proves_are_refused(void **state)
{
	static const float bad[] = {-20, -11, 1.4F, 184, 200};
	const char *reason;

	(void)state;
	for (size_t i = 0; i < LP_COUNT(bad); i++)
		assert_int_equal(lp_timed_move(&world.timed, bad[i], world.now_ns, &reason),
				 -ERANGE);
}

static void expect_fault(const char *name)
{
	assert_int_equal(run(8).phase, LP_WHEEL_FAULT);
	assert_string_equal(world.timed.fault, name);
	assert_true(lp_timed_pulse_us(&world.timed, world.now_ns) == 0);
}

static void test_faults_have_names_and_end(void **state)
{
	static const struct {
		const char *name;
		struct world fault;
	} cases[] = {
		{"INDEX_NEVER", {.stuck = true, .servo_deg_s = 400}},
		{"INDEX_NEVER", {.dark = true, .servo_deg_s = 400}},
		{"WHEEL_SLOW", {.servo_deg_s = 40}},
		{"WHEEL_SLOW", {.servo_deg_s = 400, .off_deg = 8}},
		{"WHEEL_SLIP", {.servo_deg_s = 400, .off_deg = -8}},
		{"WHEEL_TOO_FAST", {.stuck = true, .lying = true, .servo_deg_s = 400}},
	};

	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		setup(state);
		move(45);
		assert_int_equal(run(7).phase, LP_WHEEL_SETTLED);
		world.stuck = cases[i].fault.stuck;
		world.dark = cases[i].fault.dark;
		world.lying = cases[i].fault.lying;
		world.servo_deg_s = cases[i].fault.servo_deg_s;
		world.off_deg = cases[i].fault.off_deg;
		world.timed.again.first_ns = 60 * LP_NS_PER_S;
		move(135);
		expect_fault(cases[i].name);
		world.stuck = world.dark = world.lying = false;
		world.servo_deg_s = 400;
		world.off_deg = 0;
		assert_int_equal(run(65).phase, LP_WHEEL_SETTLED); /* tries again by itself */
		assert_null(world.timed.fault);
		assert_true(fabsf(world.wheel_deg - 135) < 1);
	}
}

static void test_stuck_on_its_way_and_slipping_at_rest(void **state)
{
	(void)state;
	move(45);
	(void)run(7);
	world.timed.again.first_ns = 60 * LP_NS_PER_S;
	move(135);
	while (world.timed.step != LP_TIMED_UP || world.wheel_deg < 60)
		step();
	world.stuck = true;
	expect_fault("WHEEL_STUCK");
	setup(state);
	move(45);
	(void)run(7);
	world.timed.again.first_ns = 60 * LP_NS_PER_S;
	world.stuck = true;
	world.wheel_deg = 56;
	lp_timed_edge(&world.timed, world.now_ns);
	assert_string_equal(world.timed.fault, "WHEEL_SLIP");
}

/* It has settled at 45 degrees, and jams on its way to 135. */
static void jam_on_the_way(void)
{
	move(45);
	(void)run(7);
	move(135);
	while (world.timed.step != LP_TIMED_UP || world.wheel_deg < 60)
		step();
	world.stuck = true;
}

/* Before it was given up, a bus that comes back does not hide the fault while it is homed again. */
static void test_a_fault_outlives_the_bus(void **state)
{
	(void)state;
	jam_on_the_way();
	while (!world.timed.fault)
		step();
	lp_timed_forget(&world.timed, world.now_ns);
	world.stuck = false;
	while (world.timed.step != LP_TIMED_REST) {
		assert_string_equal(world.timed.fault, "WHEEL_STUCK");
		step();
	}
	assert_null(world.timed.fault);
}

/* Nobody mends it: the first name stays, and after three more tries the servo is left alone. */
static void test_a_jam_keeps_its_name_and_is_tried_three_times(void **state)
{
	int starts = 0;
	enum lp_timed_step before = LP_TIMED_UP;

	(void)state;
	jam_on_the_way();
	for (int i = 0; i < 300 * 1000; i++) {
		step();
		starts += world.timed.step == LP_TIMED_DOWN && before == LP_TIMED_FAULT;
		before = world.timed.step;
		if (world.timed.fault)
			assert_string_equal(world.timed.fault, "WHEEL_STUCK");
	}
	assert_int_equal(starts, 3);
	assert_true(world.timed.stopped);
	assert_int_equal(world.timed.step, LP_TIMED_FAULT);
	assert_true(lp_timed_pulse_us(&world.timed, world.now_ns) == 0);
	/* The bus is lost and comes back, as a stalled servo may make it: it is not turned again.
	 */
	world.stuck = false;
	lp_timed_forget(&world.timed, world.now_ns);
	assert_int_equal(run(80).phase, LP_WHEEL_FAULT);
	assert_string_equal(world.timed.fault, "WHEEL_STUCK");
}

/* Whatever the geometry: a servo driven beyond its stop burns. */
static void test_no_pulse_is_outside_of_the_servos_limits(void **state)
{
	static const float zeros_us[] = {320, 800, 1500, 2680},
			   gains[] = {-20, -7.407F, 7.407F, 20};
	const char *reason;

	for (size_t i = 0; i < LP_COUNT(zeros_us) * LP_COUNT(gains); i++) {
		setup(state);
		world.timed.params.servo_zero_us = zeros_us[i % LP_COUNT(zeros_us)];
		world.timed.params.servo_us_per_deg = gains[i / LP_COUNT(zeros_us)];
		for (int target = 0; target <= 180; target += 45)
			(void)lp_timed_move(&world.timed, (float)target, world.now_ns, &reason);
		for (int k = 0; k < 9000; k++) {
			const float pulse_us = lp_timed_pulse_us(&world.timed, world.now_ns);

			assert_true(pulse_us == 0 || (pulse_us >= 500 && pulse_us <= 2500));
			step();
		}
	}
}

static void test_targets_beyond_the_servos_pulses_are_refused(void **state)
{
	const char *reason;

	(void)state;
	world.timed.params.servo_max_us = 1800;
	assert_int_equal(lp_timed_move(&world.timed, 180, world.now_ns, &reason), -ERANGE);
	assert_string_equal(reason, "beyond the servo's pulses");
	move(90);
	assert_true(lp_timed_check(&world.timed.params, "test"));
	world.timed.params.servo_min_us = 1800;
	assert_false(lp_timed_check(&world.timed.params, "test"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_moves_arrive, setup),
		cmocka_unit_test_setup(test_targets_that_nothing_proves_are_refused, setup),
		cmocka_unit_test_setup(test_faults_have_names_and_end, setup),
		cmocka_unit_test_setup(test_stuck_on_its_way_and_slipping_at_rest, setup),
		cmocka_unit_test_setup(test_a_fault_outlives_the_bus, setup),
		cmocka_unit_test_setup(test_a_jam_keeps_its_name_and_is_tried_three_times, setup),
		cmocka_unit_test_setup(test_no_pulse_is_outside_of_the_servos_limits, setup),
		cmocka_unit_test_setup(test_targets_beyond_the_servos_pulses_are_refused, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
