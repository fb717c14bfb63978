/* SPDX-License-Identifier: Apache-2.0 */
/* The filter of lamps at its ends: a probability of existence that goes to 0 and to 1, lamps in one
 * place, none, 10^6 frames, strengths from nothing to 10^30. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "figure.h"
#include "include/light_estimate.h"
#include "include/luminance.h"
#include "light/lamps/existence.h"
#include "light/lamps/flicker.h"
#include "light/lamps/lamp_memory.h"
#include "light/send/listing.h"
#include "random_normal.h"

#define FRAME_S (1.0F / 30.0F)
#define MANY 1000000

static const struct lp_memory_times frame = {.elapsed_s = FRAME_S};
static const float odd[] = {NAN, INFINITY, 0.0F, 1e-45F, 1e-38F, 1e-20F, 1e20F, 1e30F};

/* ---------------------------------------------------------------- existence */

/* What is always seen becomes certain, and no more; what is never seen ends; and both within the
 * time that the same sums in double take. */
static void test_probabilities_near_0_and_1(void **state)
{
	struct lp_clutter clutter = {0};
	struct lp_existence seen = lp_existence_found(&clutter), missed = seen;
	double worst = 0.0;

	(void)state;
	for (int n = 0; n < MANY; n++) {
		lp_clutter_age(&clutter, FRAME_S);
		lp_existence_update(&seen, &clutter, true, FRAME_S);
		lp_existence_update(&missed, &clutter, false, FRAME_S);
		assert_true(isfinite(seen.log_odds) && isfinite(missed.log_odds));
		assert_true(isfinite(clutter.watched_s) && isfinite(clutter.doubted_s));
	}
	assert_true(seen.was_certain && lp_exists(&seen) && !lp_existence_is_over(&seen));
	assert_true(lp_existence_is_over(&missed));
	/* what is certain is given up within so long, also after nine hours */
	float waited_s = 0.0F;

	for (; lp_exists(&seen); waited_s += FRAME_S)
		lp_existence_update(&seen, &clutter, false, FRAME_S);
	worst = fabs((double)(waited_s - lp_existence_missed_s()));
	figure("lamps", "seen for 1e6 frames, then missed", "time until it is none, s", worst, 0.1);
}

static void test_odd_times_of_existence(void **state)
{
	static const float elapsed_s[] = {0.0F, 1e-30F, 1e-3F, 1.0F, 49.0F * 86400.0F, 1e30F};

	(void)state;
	for (int k = 0; k < 6; k++)
		for (int is_seen = 0; is_seen < 2; is_seen++) {
			struct lp_clutter clutter = {0};
			struct lp_existence one = lp_existence_found(&clutter);

			for (int n = 0; n < 50; n++) {
				lp_clutter_age(&clutter, elapsed_s[k]);
				lp_existence_update(&one, &clutter, is_seen, elapsed_s[k]);
				if (n % 7 == 6)
					lp_existence_end(&one, &clutter);
				const struct lp_existence next = lp_existence_found(&clutter);

				assert_false(isnan(one.log_odds) || isnan(next.log_odds));
			}
			assert_true(k == 0 || elapsed_s[k] < 1.0F || lp_exists(&one) == is_seen);
		}
}

/* ---------------------------------------------------------------- memory */

static struct lp_lamp_sighting sighting(const float direction[3], float strength)
{
	struct lp_lamp lamp = {.irradiance = {strength, strength, strength, strength},
			       .solid_angle_sr = 1e-3F,
			       .direction_sigma_deg = 0.05F,
			       .peak = 100.0F};

	memcpy(lamp.direction, direction, sizeof(lamp.direction));
	memcpy(lamp.centroid, direction, sizeof(lamp.centroid));
	return (struct lp_lamp_sighting){.on_grid = lamp,
					 .pixels = lamp,
					 .refined = true,
					 .enters = true,
					 .strength_sigma = 0.02F,
					 .scale = 1.0F};
}

static int assert_memory(const struct lp_lamp_memory *memory)
{
	int count = 0;

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];
		double length = 0.0;

		if (!m->id)
			continue;
		count++;
		ASSERT_FINITE(m->lamp.direction);
		ASSERT_FINITE(m->lamp.irradiance);
		for (int a = 0; a < 3; a++)
			length += (double)m->lamp.direction[a] * m->lamp.direction[a];
		assert_float_equal(length, 1.0, 1e-5);
		assert_true(m->lamp.irradiance[LP_LUMINANCE] >= 0.0F);
		assert_true(m->direction_variance >= 0.0F && m->strength_variance >= 0.0F);
		assert_false(isnan(m->hidden) || isnan(m->lamp.direction_sigma_deg));
		for (int q = 0; q < p; q++)
			assert_int_not_equal(memory->list[q].id, m->id);
	}
	return count;
}

/* As many as there is room for in one place, in 64 frames each time twice as many new ones. */
static void test_lamps_in_one_cell(void **state)
{
	static const float here[3] = {0.0F, 1.0F, 0.0F};
	struct lp_lamp_memory memory = {0};
	struct lp_lamp_sighting s[LP_MAX_LAMPS];

	(void)state;
	for (int n = 0; n < 300; n++) {
		for (int k = 0; k < LP_MAX_LAMPS; k++) {
			s[k] = sighting(here, 1.0F + (float)(k % 2));
			s[k].on_grid.irradiance[0] += (float)(n % 3);
		}
		lp_lamp_memory_update(&memory, s, LP_MAX_LAMPS, &frame);
		assert_true(assert_memory(&memory) <= LP_MAX_LAMPS);
	}
	for (int n = 0; n < 3000; n++) { /* and then none */
		lp_lamp_memory_update(&memory, NULL, 0, &frame);
		(void)assert_memory(&memory);
	}
	assert_int_equal(assert_memory(&memory), 0);
}

/* Lamps at random, as strong as they can be or as dim, for a long time: 10^6 sightings. */
static void test_a_million_sightings(void **state)
{
	struct lp_lamp_memory memory = {0};

	(void)state;
	srand(5);
	for (int n = 0; n < MANY / LP_MAX_LAMPS / 4; n++) {
		struct lp_lamp_sighting s[LP_MAX_LAMPS];
		const int count = rand() % (LP_MAX_LAMPS + 1);

		for (int k = 0; k < count; k++) {
			const float a = 0.2F * (float)k + 1e-3F * (float)(rand() % 100);
			const float d[3] = {sinf(a), 0.0F, -cosf(a)};

			s[k] = sighting(d, powf(10.0F, (float)(rand() % 20 - 10)));
			s[k].pixels.flags = rand() % 5 ? 0U : LP_LIGHT_CLIPPED;
			s[k].refined = rand() % 4;
			s[k].came = rand() % 30 ? 0.0F : 1.0F;
		}
		lp_lamp_memory_update(&memory, s, count, &frame);
		(void)assert_memory(&memory);
	}
}

/* Sigmas of nothing, of everything and of no number; light of no strength. */
static void test_odd_sightings(void **state)
{
	static const float d[3] = {0.6F, 0.8F, 0.0F};

	(void)state;
	for (size_t o = 0; o < LP_COUNT(odd); o++)
		for (int field = 0; field < 5; field++) {
			struct lp_lamp_memory memory = {0};

			for (int n = 0; n < 120; n++) {
				struct lp_lamp_sighting s = sighting(d, 5.0F);
				float *const fields[] = {&s.strength_sigma,
							 &s.pixels.direction_sigma_deg, &s.scale,
							 &s.pixels.solid_angle_sr, &s.width_deg};

				if (n == 30)
					*fields[field] = odd[o];
				lp_lamp_memory_update(&memory, &s, 1, &frame);
				for (int p = 0; p < LP_MAX_LAMPS; p++)
					if (memory.list[p].id) {
						ASSERT_FINITE(memory.list[p].lamp.direction);
						ASSERT_FINITE(memory.list[p].lamp.irradiance);
					}
			}
			for (int p = 0; p < LP_MAX_LAMPS; p++)
				if (memory.list[p].id && memory.list[p].seen &&
				    (isnan(memory.list[p].strength_variance) ||
				     isnan(memory.list[p].direction_variance)))
					fail_msg("field %d, %g: it is remembered", field,
						 (double)odd[o]);
		}
}

/* ---------------------------------------------------------------- flicker, lists */

static void test_flicker_of_any_strength(void **state)
{
	static const float strengths[] = {1e-30F, 1e-10F, 1.0F, 1e10F, 1e30F};

	(void)state;
	for (int k = 0; k < 5; k++) {
		struct lp_flicker steady = {0}, mains = {0};

		for (int n = 0; n < 600; n++) {
			const struct lp_lamp_strength a = {strengths[k], 0.01F, 1.0F, false};
			struct lp_lamp_strength b = a;

			b.strength *= 1.0F + 0.3F * (float)(n % 3 - 1);
			lp_flicker_add(&steady, &a);
			lp_flicker_add(&mains, &b);
			assert_true(isfinite(mains.mean) && isfinite(mains.sigma));
		}
		assert_false(steady.flickers);
		assert_true(mains.flickers);
		assert_float_equal(mains.mean / strengths[k], 1.0, 0.02);
	}
}

/* Eight lamps of equal strength, all light in them or next to none, listed for 10^5 frames. */
static void test_lists_of_equals(void **state)
{
	static const float strengths[] = {0.0F, 1e-45F, 1e-38F, 1.0F, 1e30F};
	double worst = 0.0;

	(void)state;
	for (int k = 0; k < 5; k++) {
		struct lp_listing listing = {0};
		const struct lp_listing_limits limits = {.sh_order = 2, .lights = 4};

		for (int n = 0; n < 20000; n++) {
			struct lp_light_estimate e = {.t_capture_ns = 1 + n * INT64_C(33333333),
						      .light_count = LP_MAX_LIGHTS},
						 listed;

			for (int i = 0; i < LP_MAX_LIGHTS; i++)
				e.lights[i] = (struct lp_light){
					.id = 1 + (uint32_t)((i + n) % LP_MAX_LIGHTS),
					.direction = {0.0F, 1.0F, 0.0F},
					.irradiance = {strengths[k], strengths[k], strengths[k]}};
			for (int c = 0; c < 3; c++)
				e.sh_total[0][c] = strengths[k];
			(void)lp_listing_update(&listing, &e, &limits, &listed);
			assert_true(listed.light_count <= 4);
			for (int i = 0; i < listed.light_count; i++) {
				ASSERT_FINITE(listed.lights[i].irradiance);
				if (n > 100 && strengths[k] >= 1e-38F)
					worst = fmax(worst,
						     fabs((double)listed.lights[i].irradiance[0] /
								  strengths[k] -
							  1.0));
			}
		}
	}
	figure("lamps", "8 alike for 4 places, light 0 … 1e30, 2e4 frames", "share that changes",
	       worst, 0.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_probabilities_near_0_and_1),
		cmocka_unit_test(test_odd_times_of_existence),
		cmocka_unit_test(test_lamps_in_one_cell),
		cmocka_unit_test(test_a_million_sightings),
		cmocka_unit_test(test_odd_sightings),
		cmocka_unit_test(test_flicker_of_any_strength),
		cmocka_unit_test(test_lists_of_equals),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
