/* SPDX-License-Identifier: Apache-2.0 */
/* When the ring speaks for itself, and in which unit. */
#include "estimate/ring/ring_only.h"

#include <math.h>

#include "base/clock.h"
#include "light/clipped/ring_fusion.h"
#include "light/send/model.h"
#include "lp_test.h"

#define MS LP_NS_PER_MS

static const struct lp_ring_scale unknown = {NAN, NAN};
static struct lp_estimates estimates;

/* 100 cd/m^2 all around, and 500 lx from above and behind. */
static struct lp_ring_sample sample_at(int64_t t_ns)
{
	struct lp_ring_sample sample = {.t_ns = t_ns};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		float n[3];

		lp_ring_direction(k, n);
		sample.illuminance_lux[k] =
			(float)M_PI * 100.0F + 500.0F * fmaxf(0.6F * n[2] + 0.8F * n[1], 0.0F);
		sample.sigma_relative[k] = 0.03F;
	}
	return sample;
}

static void test_it_waits_for_the_camera(void **state)
{
	struct lp_light_estimate seen = {.cd_m2_per_unit = NAN};
	struct lp_ring_only ring;
	int64_t now_ns = 5000 * MS;
	int published = 0;

	(void)state;
	lp_ring_only_init(&ring, &unknown, 0.0F, 1000.0F, now_ns);
	for (int i = 0; i < 400; i++, now_ns += 10 * MS) {
		const struct lp_ring_sample sample = sample_at(now_ns);
		const bool speaks = lp_ring_only_sample(&ring, &sample, now_ns, &estimates);

		if (i < 100 || (i >= 200 && i < 299))
			assert_false(speaks);
		published += speaks;
		if (i == 199) /* the camera is there again, once */
			lp_ring_only_camera(&ring, &seen, now_ns);
	}
	/* one of two seconds each time, at 25 a second: every fourth of 100 readings a second */
	assert_in_range(published, 48, 53);
}

static void test_light_in_candela_or_in_the_cameras_unit(void **state)
{
	struct lp_light_estimate seen = {.cd_m2_per_unit = 50.0F, .cd_m2_per_unit_sigma = 0.02F};
	const struct lp_ring_sample sample = sample_at(9000 * MS);
	struct lp_ring_only ring;
	float ambient[LP_MAX_SH_COUNT][3];

	(void)state;
	lp_ring_only_init(&ring, &unknown, 0.0F, 1000.0F, 5000 * MS);
	assert_true(lp_ring_only_sample(&ring, &sample, 9000 * MS, &estimates));
	const struct lp_light_estimate *e = &estimates.raw;

	assert_int_equal(e->flags, LP_ESTIMATE_RING_ONLY);
	assert_float_equal(e->cd_m2_per_unit, 1.0F, 0.0F);
	assert_int_equal(e->light_count, 1);
	assert_int_equal(e->lights[0].flags, LP_LIGHT_RING);
	assert_float_equal(e->lights[0].irradiance[1], 500.0F, 5.0F);
	assert_float_equal(e->lights[0].direction[2], 0.6F, 0.01F);
	lp_model_ambient(e, 2, 1, ambient);
	assert_float_equal(ambient[0][1] / sqrtf(4.0F * (float)M_PI), 100.0F, 1.0F);
	assert_true(e->relighting_sigma > 0.15F && e->relighting_sigma < 0.4F);
	/* what all sensors have in common is in what the light may be off */
	struct lp_ring_sample drifted = sample;
	const float own = e->lights[0].irradiance_sigma;

	drifted.common_sigma = 0.5F;
	assert_true(lp_ring_only_sample(&ring, &drifted, 10000 * MS, &estimates));
	assert_float_equal(e->lights[0].irradiance_sigma, hypotf(own, 0.5F), 1e-3F);
	assert_true(e->relighting_sigma > 0.5F);

	lp_ring_only_camera(&ring, &seen, 9000 * MS);
	assert_true(lp_ring_only_sample(&ring, &sample, 11000 * MS, &estimates));
	assert_float_equal(e->cd_m2_per_unit, 50.0F, 0.0F);
	assert_float_equal(e->lights[0].irradiance[1], 10.0F, 0.1F);
}

static void test_darkness_and_dead_sensors(void **state)
{
	struct lp_ring_only ring;
	struct lp_ring_sample sample = sample_at(9000 * MS);

	(void)state;
	lp_ring_only_init(&ring, &unknown, 200.0F, 1000.0F, 5000 * MS);
	for (int k = 0; k < LP_RING_SENSORS; k++)
		sample.illuminance_lux[k] = k < 5 ? NAN : 0.0F;
	assert_true(lp_ring_only_sample(&ring, &sample, 9000 * MS, &estimates));
	assert_int_equal(estimates.raw.flags, LP_ESTIMATE_RING_ONLY | LP_ESTIMATE_NO_LIGHT);
	assert_int_equal(estimates.raw.light_count, 0);
	assert_float_equal(estimates.raw.sh_total[0][0], 0.0F, 0.0F);
	/* what was NaN is gone as soon as the sensor is there */
	sample = sample_at(9100 * MS);
	assert_true(lp_ring_only_sample(&ring, &sample, 9100 * MS, &estimates));
	assert_int_equal(estimates.smoothed.light_count, 1);
	assert_true(isfinite(estimates.smoothed.sh_total[3][0]));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_it_waits_for_the_camera),
		cmocka_unit_test(test_light_in_candela_or_in_the_cameras_unit),
		cmocka_unit_test(test_darkness_and_dead_sensors),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
