/* SPDX-License-Identifier: Apache-2.0 */
/* One lamp and an even surround, by nine light sensors. */
#include "light/ring/ring_alone.h"

#include <math.h>
#include <stdlib.h>

#include "light/clipped/ring_fusion.h"
#include "lp_test.h"

#define RAD ((float)M_PI / 180.0F)
#define SIGMA 0.03F

static float noise(unsigned int *seed)
{
	float sum = -6.0F;

	for (int i = 0; i < 12; i++)
		sum += (float)rand_r(seed) / (float)RAND_MAX;
	return sum;
}

static struct lp_ring_sample sample_of(const float direction[3], float lamp, float ambient,
				       float sigma, unsigned int *seed)
{
	struct lp_ring_sample sample = {0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		float n[3];

		lp_ring_direction(k, n);
		const float facing =
			n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];

		sample.illuminance_lux[k] = ((float)M_PI * ambient + lamp * fmaxf(facing, 0.0F)) *
					    (1.0F + sigma * noise(seed));
		sample.sigma_relative[k] = SIGMA;
	}
	return sample;
}

static float angle_deg(const float a[3], const float b[3])
{
	const float chord = sqrtf((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
				  (a[2] - b[2]) * (a[2] - b[2]));

	return 2.0F * asinf(fminf(chord / 2.0F, 1.0F)) / RAD;
}

static void direction_of(float azimuth_deg, float elevation_deg, float d[3])
{
	const float a = azimuth_deg * RAD, e = elevation_deg * RAD;

	d[0] = cosf(e) * sinf(a);
	d[1] = sinf(e);
	d[2] = -cosf(e) * cosf(a);
}

static void test_without_noise_it_is_exact(void **state)
{
	unsigned int seed = 1;

	(void)state;
	for (int azimuth = 0; azimuth < 360; azimuth += 15) {
		for (int elevation = 5; elevation <= 80; elevation += 15) {
			struct lp_ring_alone light;
			float d[3];

			direction_of((float)azimuth, (float)elevation, d);
			const struct lp_ring_sample sample =
				sample_of(d, 900.0F, 40.0F, 0.0F, &seed);

			assert_true(lp_ring_alone(&sample, &light));
			assert_true(angle_deg(light.direction, d) < 0.1F);
			assert_float_equal(light.lamp, 900.0F, 1.0F);
			assert_float_equal(light.ambient, 40.0F, 0.3F);
		}
	}
}

static void test_sigmas_hold(void **state)
{
	unsigned int seed = 2;
	int within_1 = 0, within_3 = 0, strength_1 = 0, strength_3 = 0, trials = 0;

	(void)state;
	for (; trials < 1000; trials++) {
		struct lp_ring_alone light;
		float d[3];

		direction_of((float)(trials * 37 % 360), (float)(10 + trials * 7 % 70), d);
		/* the model's own 5 % beside the sensor's 3 % */
		const struct lp_ring_sample sample =
			sample_of(d, 900.0F, 40.0F, hypotf(SIGMA, 0.05F), &seed);

		assert_true(lp_ring_alone(&sample, &light));
		const float off = angle_deg(light.direction, d) / light.direction_sigma_deg;
		const float strength = fabsf(light.lamp - 900.0F) / light.lamp_sigma;

		within_1 += off < 1.0F;
		within_3 += off < 3.0F;
		strength_1 += strength < 1.0F;
		strength_3 += strength < 3.0F;
	}
	assert_true(within_1 > 0.58 * trials && within_1 < 0.78 * trials);
	assert_true(strength_1 > 0.58 * trials && strength_1 < 0.78 * trials);
	assert_true(within_3 > 0.98 * trials && strength_3 > 0.98 * trials);
}

static void test_noise_counts(void **state)
{
	struct lp_ring_alone steady, noisy;
	unsigned int seed = 5;
	float d[3];

	(void)state;
	direction_of(40.0F, 30.0F, d);
	struct lp_ring_sample sample = sample_of(d, 900.0F, 40.0F, 0.0F, &seed);

	assert_true(lp_ring_alone(&sample, &steady));
	for (int k = 0; k < LP_RING_SENSORS; k++)
		sample.noise_relative[k] = 0.2F;
	assert_true(lp_ring_alone(&sample, &noisy));
	assert_true(noisy.lamp_sigma > 2.0F * steady.lamp_sigma);
	assert_true(noisy.direction_sigma_deg > 2.0F * steady.direction_sigma_deg);
}

static void test_no_lamp(void **state)
{
	const float up[3] = {0.0F, 1.0F, 0.0F};
	struct lp_ring_alone light;
	unsigned int seed = 3;

	(void)state;
	const struct lp_ring_sample sample = sample_of(up, 0.0F, 40.0F, 0.0F, &seed);

	assert_true(lp_ring_alone(&sample, &light));
	assert_float_equal(light.ambient, 40.0F, 0.5F);
	assert_true(light.lamp < 3.0F);
}

static void test_too_few_sensors_and_darkness(void **state)
{
	const float up[3] = {0.0F, 1.0F, 0.0F};
	struct lp_ring_alone light;
	unsigned int seed = 4;
	struct lp_ring_sample sample = sample_of(up, 100.0F, 40.0F, 0.0F, &seed);

	(void)state;
	for (int k = 0; k < 4; k++)
		sample.illuminance_lux[k] = NAN;
	assert_true(lp_ring_alone(&sample, &light));
	sample.illuminance_lux[4] = NAN;
	assert_false(lp_ring_alone(&sample, &light));
	sample = sample_of(up, 0.0F, 0.0F, 0.0F, &seed);
	assert_false(lp_ring_alone(&sample, &light));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_without_noise_it_is_exact),
		cmocka_unit_test(test_sigmas_hold),
		cmocka_unit_test(test_noise_counts),
		cmocka_unit_test(test_no_lamp),
		cmocka_unit_test(test_too_few_sensors_and_darkness),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
