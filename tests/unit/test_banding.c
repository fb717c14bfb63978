/* SPDX-License-Identifier: Apache-2.0 */
/* Bands of flicker across a rolling shutter's frame. */
#include "vision/doubt/banding.h"

#include <math.h>
#include <stdint.h>

#include "lp_test.h"

#define COUNT 1500
#define READ_OUT_S 0.019F

static struct lp_banding_samples samples;

/* -1..1 (Numerical Recipes' linear congruential generator). */
static float uniform(void)
{
	static uint32_t chance;

	chance = 1664525U * chance + 1013904223U;
	return (float)chance / 2147483648.0F - 1.0F;
}

/* A wave, over a scene that is a little too bright below, in noise of 5 %. */
static void draw(float hz, float amplitude, float phase)
{
	samples.count = COUNT;
	for (int k = 0; k < COUNT; k++) {
		const float t_s = READ_OUT_S * (float)k / COUNT;
		const float x = t_s / READ_OUT_S;

		samples.t_s[k] = t_s;
		samples.log_ratio[k] = amplitude * sinf(2.0F * (float)M_PI * hz * t_s + phase) +
				       0.05F * x * x + 0.087F * uniform();
		samples.weight[k] = 400.0F;
	}
}

static struct lp_banding after(int frames, float hz, float amplitude, float phase)
{
	struct lp_banding banding = {0};

	for (int n = 0; n < frames; n++) {
		draw(hz, amplitude, phase);
		lp_banding_look(&banding, &samples);
	}
	return banding;
}

static void test_bands_of_both_mains(void **state)
{
	(void)state;
	for (int k = 0; k < 8; k++) {
		const struct lp_banding banding =
			after(30, k % 2 ? 100.0F : 120.0F, 0.1F, (float)k);

		assert_true(banding.found);
		assert_float_equal(banding.amplitude, 0.1, 0.03);
	}
}

static void test_no_bands(void **state)
{
	(void)state;
	assert_false(after(200, 100.0F, 0.0F, 0.0F).found);
	assert_false(after(60, 210.0F, 0.1F, 0.0F).found); /* no lamp does this */
	assert_false(after(3, 100.0F, 0.1F, 0.0F).found);  /* a few frames are chance */
}

static void test_bands_end(void **state)
{
	struct lp_banding banding = after(30, 100.0F, 0.1F, 0.0F);

	(void)state;
	for (int n = 0; n < 30; n++) {
		draw(100.0F, 0.0F, 0.0F);
		lp_banding_look(&banding, &samples);
	}
	assert_false(banding.found);
}

static void test_few_samples_tell_nothing(void **state)
{
	struct lp_banding banding = {0};

	(void)state;
	draw(100.0F, 0.3F, 0.0F);
	samples.count = 100;
	for (int n = 0; n < 30; n++)
		lp_banding_look(&banding, &samples);
	assert_false(banding.found);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_bands_of_both_mains),
		cmocka_unit_test(test_no_bands),
		cmocka_unit_test(test_bands_end),
		cmocka_unit_test(test_few_samples_tell_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
