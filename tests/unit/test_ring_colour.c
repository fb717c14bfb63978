/* SPDX-License-Identifier: Apache-2.0 */
/* The colour of hidden light by a ring that sees colours. */
#include "light/ring/ring_colour.h"

#include <math.h>
#include <stdlib.h>

#include "include/luminance.h"
#include "lp_test.h"

#define SCALE 100.0F

/* Two parts, to the right and above; an even surround of 1 in each colour. */
static struct {
	struct lp_ring_view views[3];
	struct lp_ring_sample sample;
	struct lp_ring_fusion luminance;
	struct lp_clipped_parts parts;
	struct lp_ring_colour colour;
} s;

static void look(const float tints[2][3], const float white[3], float noise)
{
	static const float directions[2][3] = {{1.0F, 0.0F, 0.0F}, {0.0F, 0.8F, 0.6F}};
	unsigned int seed = 1;

	memset(&s, 0, sizeof(s));
	lp_ring_colour_init(&s.colour);
	s.parts.count = 2;
	s.luminance.verdict = LP_RING_AGREES;
	s.luminance.scale = (struct lp_ring_scale){SCALE, 0.02F};
	s.luminance.excess[0] = 5.0F;
	s.luminance.excess[1] = 3.0F;
	s.sample.colour_sigma = 0.03F;
	for (int j = 0; j < 2; j++)
		for (int c = 0; c < 3; c++)
			s.parts.list[j].tint[c] = 1.0F; /* clips in all channels: white */
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		float n[3];

		lp_ring_direction(k, n);
		for (int c = 0; c < 3; c++) {
			struct lp_ring_view *view = &s.views[c];
			float light = (float)M_PI;

			view->count = 2;
			view->seen[k] = light;
			view->seen_sigma = 0.01F;
			for (int j = 0; j < 2; j++) {
				const float *d = directions[j];
				const float facing = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];

				view->parts[j].weight[k] = fmaxf(facing, 0.0F);
				light += view->parts[j].weight[k] * s.luminance.excess[j] *
					 tints[j][c];
			}
			const float off = (float)rand_r(&seed) / (float)RAND_MAX - 0.5F;

			s.sample.rgb[k][c] = SCALE * white[c] * light * (1.0F + noise * off);
		}
	}
}

static void update(bool learns)
{
	lp_ring_colour_update(&s.colour, s.views, &s.sample, &s.luminance, &s.parts, learns);
}

static const float candle_and_sky[2][3] = {{1.6F, 0.88F, 0.42F}, {0.8F, 1.02F, 1.39F}};
static const float one[3] = {1.0F, 1.0F, 1.0F};

static void test_two_tints_are_told_apart(void **state)
{
	(void)state;
	look(candle_and_sky, one, 0.05F);
	update(false);
	for (int j = 0; j < 2; j++) {
		assert_float_equal(lp_luminance(s.colour.tint[j]), 1.0F, 1e-4F);
		for (int c = 0; c < 3; c++)
			assert_float_equal(s.colour.tint[j][c], candle_and_sky[j][c], 0.12F);
	}
}

/* Another balance of its colours than the camera's is found, and kept when it may be. */
static void test_the_balance_is_learned(void **state)
{
	static const float white[3] = {1.2F, 1.0F, 0.85F};

	(void)state;
	look(candle_and_sky, white, 0.0F);
	update(false);
	assert_float_equal(s.colour.white[0].lux_per_unit, 1.0F, 0.0F);
	for (int c = 0; c < 3; c++)
		assert_float_equal(s.colour.tint[0][c], candle_and_sky[0][c], 0.15F);
	for (int i = 0; i < 40; i++)
		update(true);
	for (int c = 0; c < 3; c++)
		assert_float_equal(s.colour.white[c].lux_per_unit, white[c], 0.03F);
}

static void test_sensors_that_do_not_count_change_nothing(void **state)
{
	(void)state;
	look(candle_and_sky, one, 0.0F);
	s.sample.rgb[0][0] = NAN;
	s.sample.rgb[8][1] = 1e6F;
	s.luminance.wrong = 1U << 8;
	update(false);
	for (int c = 0; c < 3; c++)
		assert_float_equal(s.colour.tint[0][c], candle_and_sky[0][c], 0.12F);
}

static void test_without_colours_it_is_as_it_looks(void **state)
{
	(void)state;
	look(candle_and_sky, one, 0.0F);
	s.parts.list[0].tint[0] = 2.0F;
	lp_ring_colour_as_seen(&s.colour, &s.parts, &s.luminance);
	assert_float_equal(s.colour.tint[0][0], 2.0F, 1e-5F);
	assert_float_equal(s.colour.tint[1][0], 1.0F, 1e-5F);
	const float unseen_sigma = s.colour.tint_sigma[0];

	update(true);
	assert_true(s.colour.tint_sigma[0] < 0.7F * unseen_sigma);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		for (int c = 0; c < 3; c++)
			s.sample.rgb[k][c] = NAN;
	s.parts.list[0].tint[0] = 1.0F;
	update(true);
	for (int c = 0; c < 3; c++)
		assert_float_equal(s.colour.tint[0][c], 1.0F, 1e-3F);
}

/* 1 sigma of the colour of a whole lamp, of luminance 1, that is seen as white. */
static float colour_sigma(float seen, float hidden, float sigma)
{
	struct lp_clipped_parts parts = {.count = 1};
	struct lp_ring_fusion luminance = {.excess = {hidden}, .sigma = {sigma}};
	struct lp_ring_colour colour;

	parts.list[0].bound[LP_LUMINANCE] = seen;
	lp_ring_colour_as_seen(&colour, &parts, &luminance);
	return colour.tint_sigma[0] * hypotf(hidden, sigma) / (seen + hidden);
}

static void test_a_lamp_that_hardly_clips_may_hide_one_channel(void **state)
{
	const float red[3] = {1.275F, 0.896F, 0.863F}, clip = 0.88F;
	float seen[3], square = 0.0F;

	(void)state;
	for (int c = 0; c < 3; c++)
		seen[c] = fminf(red[c], clip);
	for (int c = 0; c < 3; c++)
		square += powf(seen[c] / lp_luminance(seen) - red[c] / lp_luminance(red), 2.0F);
	const float hidden = lp_luminance(red) - lp_luminance(seen);

	assert_true(sqrtf(square / 3.0F) < 2.0F * colour_sigma(lp_luminance(seen), hidden, 0.01F));
	/* where nearly all is hidden, and where nothing is, and that is known */
	assert_float_equal(colour_sigma(1.0F, 1000.0F, 30.0F), colour_sigma(1.0F, 10000.0F, 300.0F),
			   0.01F);
	assert_true(colour_sigma(1.0F, 1000.0F, 30.0F) > 0.1F);
	assert_true(colour_sigma(1.0F, 0.0F, 0.001F) < 0.003F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_two_tints_are_told_apart),
		cmocka_unit_test(test_the_balance_is_learned),
		cmocka_unit_test(test_sensors_that_do_not_count_change_nothing),
		cmocka_unit_test(test_without_colours_it_is_as_it_looks),
		cmocka_unit_test(test_a_lamp_that_hardly_clips_may_hide_one_channel),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
