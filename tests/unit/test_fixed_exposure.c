/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <math.h>
#include <stdbool.h>

#include "app/options/fixed_exposure.h"
#include "include/source.h"

static struct {
	int count;
	float exposure_us, gain;
} commanded;

static int set_exposure(struct lp_source *source, float exposure_us, float gain)
{
	(void)source;
	commanded.count++;
	commanded.exposure_us = exposure_us;
	commanded.gain = gain;
	return 0;
}

static const struct lp_source_ops camera_ops = {.set_exposure = set_exposure}, file_ops;
static struct lp_source camera = {.ops = &camera_ops}, file = {.ops = &file_ops};

static const struct lp_source_caps known = {.exposure_settable = true,
					    .exposure_min_us = 100,
					    .exposure_max_us = 33000,
					    .gain_min = 1,
					    .gain_max = 8};
static const struct lp_source_caps gain_is_fixed = {.exposure_settable = true,
						    .exposure_min_us = 100,
						    .exposure_max_us = 33000,
						    .gain_min = 1,
						    .gain_max = 1};
static const struct lp_source_caps unknown = {.exposure_settable = true,
					      .exposure_min_us = NAN,
					      .exposure_max_us = NAN,
					      .gain_min = NAN,
					      .gain_max = NAN};

/* What is said while a fixed exposure is commanded. */
static const char *said(struct lp_source *source, const struct lp_source_caps *caps,
			float exposure_us, float gain, const char *object)
{
	static struct capture capture;

	commanded.count = 0;
	capture_begin(&capture);
	lp_fixed_exposure_command(source, caps, exposure_us, gain, object);
	return capture_end(&capture);
}

static void test_what_is_offered_is_commanded_without_a_word(void **state)
{
	(void)state;
	assert_string_equal(said(&camera, &known, 2500, 8, "a:"), "");
	assert_int_equal(commanded.count, 1);
	assert_true(commanded.exposure_us == 2500 && commanded.gain == 8);
	assert_string_equal(said(&camera, &known, 33000, 0, "a:"), "");
	assert_true(commanded.gain == 1);
	assert_string_equal(said(&camera, &unknown, 1e6F, 1000, "a:"), "");
	assert_true(commanded.gain == 1000);
}

static void test_what_is_not_offered_is_said(void **state)
{
	(void)state;
	assert_contains(said(&camera, &known, 2500, 9, "b:"),
			"error b:: gain: 9 is not offered — --gain is within 1..8\n");
	assert_contains(said(&camera, &known, 40000, 0, "b:"),
			"warning b:: exposure: 40000 us is not offered: the nearest is taken — "
			"--exposure-us is within 100..33000\n");
	assert_int_equal(commanded.count, 1);
	assert_contains(said(&camera, &gain_is_fixed, 2500, 4, "c:"),
			"error c:: gain: 4: this camera's gain is not set");
	assert_true(commanded.gain == 1);
	assert_contains(said(&file, &unknown, 2500, 0, "d:"),
			"warning d:: exposure: this source's exposure cannot be set: "
			"--exposure-us has no effect\n");
	assert_int_equal(commanded.count, 0);
}

static void test_gain_of_a_series(void **state)
{
	struct capture capture;

	(void)state;
	assert_true(lp_gain_is_offered(&known, 0, "e:"));
	assert_true(lp_gain_is_offered(&gain_is_fixed, 1, "e:"));
	capture_begin(&capture);
	assert_false(lp_gain_is_offered(&gain_is_fixed, 2, "e:"));
	assert_contains(capture_end(&capture), "leave --gain out");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_what_is_offered_is_commanded_without_a_word),
		cmocka_unit_test(test_what_is_not_offered_is_said),
		cmocka_unit_test(test_gain_of_a_series),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
