/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <math.h>

#include "base/clock.h"
#include "serve/health.h"

static const struct lp_histogram none;

static void test_quantiles_within_six_percent(void **state)
{
	struct lp_histogram histogram = {0};

	(void)state;
	assert_int_equal(lp_histogram_quantile(&none, &none, 0.5), 0);
	for (uint32_t i = 1; i <= 10000; i++)
		lp_histogram_add(&histogram, i);
	for (int percent = 1; percent <= 100; percent++) {
		const double value = lp_histogram_quantile(&histogram, &none, percent / 100.0);

		assert_true(fabs(value / (100.0 * percent) - 1) < 0.07);
	}
}

static void test_extremes_have_a_bin(void **state)
{
	(void)state;
	for (int bit = 0; bit < 32; bit++) {
		struct lp_histogram histogram = {0};
		const uint32_t value = UINT32_C(1) << bit;

		lp_histogram_add(&histogram, value);
		assert_true(fabs(lp_histogram_quantile(&histogram, &none, 0.5) / (double)value -
				 1) < 0.07);
	}
	for (uint32_t value = 0; value < 16; value++) {
		struct lp_histogram histogram = {0};

		lp_histogram_add(&histogram, value);
		assert_int_equal(lp_histogram_quantile(&none, &histogram, 0.99), value);
	}
	struct lp_histogram histogram = {0};

	lp_histogram_add(&histogram, UINT32_MAX);
	assert_true(lp_histogram_quantile(&histogram, &none, 1) > 0xf0000000U);
}

static void test_rates_over_a_window(void **state)
{
	struct lp_health health;
	const int64_t start_ns = lp_clock_ns();

	(void)state;
	lp_health_init(&health, start_ns);
	for (int i = 0; i < 60; i++)
		lp_health_add_latency(&health, 5 * LP_NS_PER_MS);
	lp_health_add_latency(&health, -1);
	lp_health_add_latency(&health, INT64_MAX);
	health.report.estimates = 60;
	lp_health_update(&health, start_ns + 2 * LP_NS_PER_S);
	assert_true(fabsf(health.report.estimates_per_s - 30) < 0.01F);
	assert_int_equal(health.report.uptime_ms, 2000);
	assert_true(health.report.rss_kib > 500);
	assert_true(health.report.cpu_percent >= 0);
	assert_true(fabs(health.report.latency_p50_us / 5000.0 - 1) < 0.07);

	/* Nobody asks for two windows: nothing of the first is left. */
	for (int64_t ms = 2000; ms <= 21000; ms += 100)
		lp_health_tick(&health, start_ns + ms * LP_NS_PER_MS);
	lp_health_update(&health, start_ns + 21 * LP_NS_PER_S);
	assert_int_equal(health.report.latency_p50_us, 0);
	assert_true(health.report.estimates_per_s == 0);

	/* A window that has only begun does not hide the rate of the one before. */
	health.report.estimates += 300;
	lp_health_tick(&health, start_ns + 30 * LP_NS_PER_S);
	lp_health_update(&health, start_ns + 30 * LP_NS_PER_S + 100 * LP_NS_PER_MS);
	assert_true(fabsf(health.report.estimates_per_s - 30) < 0.01F);
}

static void test_faults_come_and_go_by_name(void **state)
{
	static const char *const names[] = {"a", "b", "c", "d", "e", "f", "g", "h", "i"};
	struct lp_health health;
	const struct lp_health_report *report = &health.report;

	(void)state;
	lp_health_init(&health, lp_clock_ns());
	lp_health_fault(&health, "a", NULL);
	assert_int_equal(report->fault_count, 0);
	lp_health_fault(&health, "a", "first");
	lp_health_fault(&health, "b", "second");
	lp_health_fault(&health, "a", "again");
	assert_int_equal(report->fault_count, 2);
	assert_string_equal(report->faults[0].text, "again");
	lp_health_fault(&health, "a", NULL);
	assert_int_equal(report->fault_count, 1);
	assert_string_equal(report->faults[0].id, "b");
	lp_health_camera_fault(&health, "b", 1, "of another camera");
	assert_int_equal(report->fault_count, 2);
	lp_health_camera_fault(&health, "b", 1, NULL);
	assert_int_equal(report->fault_count, 1);
	assert_string_equal(report->faults[0].text, "second");
	for (size_t i = 0; i < LP_COUNT(names); i++)
		lp_health_fault(&health, names[i], "many");
	assert_int_equal(report->fault_count, LP_MAX_FAULTS);
	for (size_t i = 0; i < LP_COUNT(names); i++)
		lp_health_fault(&health, names[i], NULL);
	assert_int_equal(report->fault_count, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_quantiles_within_six_percent),
		cmocka_unit_test(test_extremes_have_a_bin),
		cmocka_unit_test(test_rates_over_a_window),
		cmocka_unit_test(test_faults_come_and_go_by_name),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
