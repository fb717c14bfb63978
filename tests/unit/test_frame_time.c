/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include "base/clock.h"
#include "include/frame.h"
#include "vision/turn/frame_time.h"

#define READ_NS (10 * LP_NS_PER_S)

static double middle_ms(const struct lp_frame *frame, float exposure_us)
{
	return (double)(lp_frame_time(frame, exposure_us).middle_ns - READ_NS) / 1e6;
}

static void test_what_is_known(void **state)
{
	const struct lp_frame at_once = {.t_read_ns = READ_NS,
					 .period_us = 33333,
					 .height_px = 960};
	struct lp_frame rolling = at_once;

	(void)state;
	rolling.row_time_us = 20;
	assert_float_equal(middle_ms(&at_once, 8000), -4, 1e-6);
	assert_float_equal(middle_ms(&rolling, 8000), -4 + 9.6, 1e-6);
	assert_float_equal(lp_frame_time(&rolling, 8000).read_out_s, 0.0192, 1e-6);
	assert_float_equal(lp_frame_time(&at_once, 8000).sigma_s,
			   lp_frame_time(&rolling, 100).sigma_s, 0);
}

/* Of all exposures that the period leaves room for, the stated middle is the mean, and the stated
 * sigma the root mean square of what it is off by. */
static void test_an_unknown_exposure_is_anything_within_the_period(void **state)
{
	static const float periods_us[] = {NAN, 33333, 16667, 8333, 1e6F};

	(void)state;
	for (size_t i = 0; i < sizeof(periods_us) / sizeof(*periods_us); i++) {
		const struct lp_frame frame = {.t_read_ns = READ_NS, .period_us = periods_us[i]};
		const double longest_us = fmin(periods_us[i], LP_LONGEST_EXPOSURE_US);
		const struct lp_frame_time found = lp_frame_time(&frame, NAN);
		const double known_s = (double)lp_frame_time(&frame, 1).sigma_s;
		const double stated_ms = middle_ms(&frame, NAN);
		double sum = 0, sum2 = 0;

		for (int k = 0; k < 1000; k++) {
			const double off_ms =
				middle_ms(&frame, (float)(longest_us * (k + 0.5) / 1000)) -
				stated_ms;

			sum += off_ms / 1000;
			sum2 += off_ms * off_ms / 1000;
		}
		assert_float_equal(sum, 0, 1e-3);
		assert_float_equal(sqrt(sum2) / 1e3,
				   sqrt((double)found.sigma_s * found.sigma_s - known_s * known_s),
				   1e-5);
	}
}

static void test_unknown_rows_are_read_within_the_period(void **state)
{
	const struct lp_frame frame = {.t_read_ns = READ_NS,
				       .period_us = 20000,
				       .height_px = 480,
				       .row_time_us = NAN};

	(void)state;
	assert_float_equal(middle_ms(&frame, 2000), -1 + 5, 1e-6);
	assert_true(lp_frame_time(&frame, 2000).sigma_s > 0.0028F);
	assert_float_equal(lp_frame_time(&frame, 2000).read_out_s, 0, 0);
}

static void test_the_start_is_never_too_late(void **state)
{
	const struct lp_frame unknown = {.t_read_ns = READ_NS,
					 .exposure_us = NAN,
					 .period_us = 10000};
	const struct lp_frame known = {.t_read_ns = READ_NS,
				       .exposure_us = 4000,
				       .period_us = 10000};

	(void)state;
	assert_int_equal(lp_frame_start_ns(&unknown), READ_NS - 10 * LP_NS_PER_MS);
	assert_int_equal(lp_frame_start_ns(&known), READ_NS - 4 * LP_NS_PER_MS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_what_is_known),
		cmocka_unit_test(test_an_unknown_exposure_is_anything_within_the_period),
		cmocka_unit_test(test_unknown_rows_are_read_within_the_period),
		cmocka_unit_test(test_the_start_is_never_too_late),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
