/* SPDX-License-Identifier: Apache-2.0 */
/* The governor, on a clock of the test's own. */
#include "app/run/governor.h"

#include <string.h>

#include "base/clock.h"
#include "lp_test.h"

/* A machine on which each preset takes so long, and so much of the processor. */
struct machine {
	struct lp_governor governor;
	float latency_ms[4], cpu_percent[4];
	int64_t now_ns, cpu_ns;
	int changes, lowered;
	char reason[96];
};

/* 30 estimates and 10 ticks a second. Returns the preset in force at the end. */
static int run_s(struct machine *m, int seconds)
{
	for (int tick = 0; tick < 10 * seconds; tick++) {
		const int preset = m->governor.preset;

		m->now_ns += LP_NS_PER_S / 10;
		m->cpu_ns += (int64_t)(m->cpu_percent[preset] / 1000.0F * (float)LP_NS_PER_S);
		for (int k = 0; k < 3; k++)
			lp_governor_estimate(&m->governor, (int64_t)(m->latency_ms[preset] *
								     (float)LP_NS_PER_MS));
		if (lp_governor_tick(&m->governor, m->now_ns, m->cpu_ns, m->reason,
				     sizeof(m->reason))) {
			m->changes++;
			m->lowered += m->governor.preset < preset;
			assert_in_range(m->governor.preset, 0, m->governor.chosen);
		}
	}
	return m->governor.preset;
}

static struct machine machine(float latency_goal_ms, float cpu_budget_percent, int chosen)
{
	struct machine m = {.latency_ms = {2, 4, 9, 30},
			    .cpu_percent = {10, 20, 45, 95},
			    .now_ns = 77 * LP_NS_PER_S};
	const struct lp_governor_goals goals = {.latency_ms = latency_goal_ms,
						.cpu_percent = cpu_budget_percent};

	lp_governor_init(&m.governor, &goals, chosen, m.now_ns, m.cpu_ns);
	return m;
}

static void test_without_goals_nothing_changes(void **state)
{
	struct machine m = machine(0, 0, 3);

	(void)state;
	m.latency_ms[3] = 1e6F;
	m.cpu_percent[3] = 800;
	run_s(&m, 600);
	assert_int_equal(m.changes, 0);
	assert_int_equal(m.governor.preset, 3);
}

static void test_a_goal_that_is_kept_changes_nothing(void **state)
{
	struct machine m = machine(40, 100, 3);

	(void)state;
	run_s(&m, 600);
	assert_int_equal(m.changes, 0);
}

static void test_steps_down_to_what_keeps_the_latency(void **state)
{
	struct machine m = machine(5, 0, 3);

	(void)state;
	assert_int_equal(run_s(&m, 5), 2);
	assert_non_null(strstr(m.reason, "later than 5 ms"));
	assert_int_equal(run_s(&m, 5), 1);
	/* 4 ms are kept, without well below its limits: there it stays */
	assert_int_equal(run_s(&m, 600), 1);
	assert_int_equal(m.changes, 2);
}

static void test_steps_down_to_what_keeps_the_processor(void **state)
{
	struct machine m = machine(0, 30, 2);

	(void)state;
	assert_int_equal(run_s(&m, 5), 1);
	assert_non_null(strstr(m.reason, "45 % of a core"));
	assert_int_equal(run_s(&m, 600), 1);
}

static void test_the_fastest_is_the_end(void **state)
{
	struct machine m = machine(1, 0, 1);

	(void)state;
	assert_int_equal(run_s(&m, 600), 0);
	assert_int_equal(m.changes, 1);
}

static void test_rises_again_when_the_load_has_gone(void **state)
{
	struct machine m = machine(20, 0, 3);

	(void)state;
	m.latency_ms[2] = m.latency_ms[1] = 25; /* another program */
	assert_int_equal(run_s(&m, 14), 0);
	m.latency_ms[3] = 9;
	m.latency_ms[2] = 8;
	m.latency_ms[1] = 4;
	assert_int_equal(run_s(&m, 4), 0); /* not at once */
	assert_int_equal(run_s(&m, 60), 3);
	assert_non_null(strstr(m.reason, "well below its limits"));
}

/* Preset 2 leaves room, 3 does not: raising fails every time, and is tried less and less. */
static void test_does_not_swing(void **state)
{
	struct machine m = machine(20, 0, 3);

	(void)state;
	run_s(&m, 600);
	const int first = m.lowered;

	run_s(&m, 3600);
	assert_in_range(first, 2, 10);
	assert_in_range(m.lowered - first, 1, 14);
}

static void test_one_in_ten_may_be_late(void **state)
{
	struct machine m = machine(10, 0, 2);

	(void)state;
	for (int k = 0; k < 10000; k++) {
		lp_governor_estimate(&m.governor, (k % 12 == 0 ? 50 : 4) * LP_NS_PER_MS);
		m.now_ns += LP_NS_PER_S / 30;
		assert_false(
			lp_governor_tick(&m.governor, m.now_ns, 0, m.reason, sizeof(m.reason)));
	}
}

static void test_silence_judges_nothing(void **state)
{
	struct machine m = machine(5, 10, 3);

	(void)state;
	for (int k = 0; k < 1000; k++) {
		m.now_ns += LP_NS_PER_S;
		m.cpu_ns += LP_NS_PER_S;
		assert_false(lp_governor_tick(&m.governor, m.now_ns, m.cpu_ns, m.reason,
					      sizeof(m.reason)));
	}
	assert_int_equal(m.governor.preset, 3);
}

/* What the worker could not do is not believed, and is tried again. */
static void test_a_preset_that_is_refused(void **state)
{
	struct machine m = machine(5, 0, 3);
	int changes = 0;

	(void)state;
	for (int k = 0; k < 600; k++) {
		lp_governor_estimate(&m.governor, 100 * LP_NS_PER_MS);
		m.now_ns += LP_NS_PER_S / 30;
		if (!lp_governor_tick(&m.governor, m.now_ns, 0, m.reason, sizeof(m.reason)))
			continue;
		changes++;
		assert_int_equal(m.governor.preset, 2);
		lp_governor_refused(&m.governor, 3);
	}
	assert_true(changes > 2);
	assert_int_equal(m.governor.preset, 3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_without_goals_nothing_changes),
		cmocka_unit_test(test_a_goal_that_is_kept_changes_nothing),
		cmocka_unit_test(test_steps_down_to_what_keeps_the_latency),
		cmocka_unit_test(test_steps_down_to_what_keeps_the_processor),
		cmocka_unit_test(test_the_fastest_is_the_end),
		cmocka_unit_test(test_rises_again_when_the_load_has_gone),
		cmocka_unit_test(test_does_not_swing),
		cmocka_unit_test(test_one_in_ten_may_be_late),
		cmocka_unit_test(test_silence_judges_nothing),
		cmocka_unit_test(test_a_preset_that_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
