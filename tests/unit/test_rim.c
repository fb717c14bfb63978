/* SPDX-License-Identifier: Apache-2.0 */
/* The colour of a clipped lamp by its rim. */
#include "vision/lamp/rim.h"

#include <math.h>

#include "include/luminance.h"
#include "lp_test.h"

#define PIXELS 100

static const float full[3] = {2.0F, 2.0F, 2.0F}, dark[3] = {0.02F, 0.02F, 0.02F};
static const float warm[3] = {1.5F, 0.92F, 0.3F};

/* A lamp of this colour that fades out; what is above full scale clips. */
static struct lp_lamp_rim rim_of_lamp(const float tint[3], float peak, int pixels)
{
	struct lp_rim_sums sums = {0};

	for (int p = 0; p < pixels; p++) {
		const float light = peak * expf(-6.0F * (float)p / (float)pixels);
		float rgb[1][3];

		for (int c = 0; c < 3; c++)
			rgb[0][c] = fminf(dark[c] + light * tint[c], full[c]);
		lp_rim_add(&sums, (const float(*)[3])rgb, 1, dark, full);
	}
	return lp_rim_of(&sums);
}

static void test_a_rim_has_the_colour_of_the_lamp(void **state)
{
	const struct lp_lamp_rim rim = rim_of_lamp(warm, 200.0F, 10 * PIXELS);
	const float luminance = lp_luminance(warm);

	(void)state;
	assert_float_equal(rim.trust, 1.0F, 0.0F);
	for (int c = 0; c < 3; c++) {
		assert_float_equal(rim.tint[c], warm[c] / luminance, 1e-3F);
		assert_float_equal(rim.clips[c], 1.0F, 0.0F);
	}
}

static void test_few_pixels_say_nothing(void **state)
{
	(void)state;
	assert_float_equal(rim_of_lamp(warm, 200.0F, PIXELS).trust, 0.0F, 0.0F);
	assert_float_equal(rim_of_lamp(warm, 0.0F, PIXELS).trust, 0.0F, 0.0F);
}

static void test_a_channel_that_does_not_clip_hides_nothing(void **state)
{
	static const float red[3] = {3.0F, 0.4F, 0.05F};
	const struct lp_lamp_rim rim = rim_of_lamp(red, 2.0F, PIXELS);
	float tint[3] = {1.6F, 0.9F, 0.2F}; /* what was seen */

	(void)state;
	assert_float_equal(rim.clips[0], 1.0F, 0.0F);
	assert_float_equal(rim.clips[1], 0.0F, 0.0F);
	assert_float_equal(rim.clips[2], 0.0F, 0.0F);
	lp_lamp_rim_apply(&rim, tint);
	assert_float_equal(lp_luminance(tint), 1.0F, 1e-5F);
	assert_float_equal(tint[1], 0.0F, 0.0F);
	assert_float_equal(tint[2], 0.0F, 0.0F);
}

static void test_between_the_rim_and_what_was_seen(void **state)
{
	const struct lp_lamp_rim half = {.tint = {1.5F, 0.93F, 0.2F},
					 .trust = 0.5F,
					 .clips = {1.0F, 1.0F, 1.0F}};
	const struct lp_lamp_rim nothing = {0};
	float tint[3] = {1.0F, 1.0F, 1.0F}, untouched[3] = {1.2F, 1.0F, 0.4F};

	(void)state;
	lp_lamp_rim_apply(&half, tint);
	assert_float_equal(lp_luminance(tint), 1.0F, 1e-5F);
	assert_float_equal(tint[2] / tint[0], sqrtf(0.2F / 1.5F), 1e-3F);
	lp_lamp_rim_apply(&nothing, untouched);
	assert_float_equal(untouched[0], 1.2F, 0.0F);
	assert_float_equal(untouched[2], 0.4F, 0.0F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_rim_has_the_colour_of_the_lamp),
		cmocka_unit_test(test_few_pixels_say_nothing),
		cmocka_unit_test(test_a_channel_that_does_not_clip_hides_nothing),
		cmocka_unit_test(test_between_the_rim_and_what_was_seen),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
