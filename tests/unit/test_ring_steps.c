/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/ring/ring_steps.h"

#include <math.h>

#include "light/clipped/ring_fusion.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "lp_test.h"

#define SUN 1000.0F
#define AMBIENT 100.0F
#define SCALE 10.0F
#define SEAT_DEG 2.0
#define DEG (M_PI / 180.0)

static const float toward_sun[3] = {1.0F, 0.0F, 0.0F};

static struct lp_rotation yaw(double deg)
{
	const double vector[3] = {0.0, deg * DEG, 0.0};

	return lp_rotation_of_vector(vector);
}

/* A ring whose seats, one after the other, look to the left and to the right of where they should.
 * `sun`: the share of its strength that it has. */
static struct lp_ring_sample reading(double yaw_deg, float sun, int64_t t_ns)
{
	struct lp_ring_sample sample = {.t_ns = t_ns};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const struct lp_rotation to_anchor = yaw(yaw_deg + (k == 8  ? 0.0
								    : k % 2 ? SEAT_DEG
									    : -SEAT_DEG));
		float n[3];

		lp_ring_direction(k, n);
		lp_rotate_direction(&to_anchor, n);
		sample.illuminance_lux[k] =
			SCALE * (AMBIENT + sun * SUN * fmaxf(n[0] * toward_sun[0], 0.0F));
		sample.sigma_relative[k] = 0.03F;
		sample.noise_relative[k] = 0.003F;
	}
	return sample;
}

static void show(struct lp_ring_steps *steps, double yaw_deg, int64_t t_ns)
{
	const struct lp_rotation to_anchor = yaw(yaw_deg);
	const struct lp_ring_sample now = reading(yaw_deg, 1.0F, t_ns);
	const float white[3] = {SUN, SUN, SUN};
	double total[LP_SH_MAX_COUNT][3] = {{0.0}};
	struct lp_light_estimate estimate = {.t_capture_ns = t_ns, .light_count = 1};

	estimate.lights[0] = (struct lp_light){.id = 1, .irradiance = {SUN, SUN, SUN}};
	for (int a = 0; a < 3; a++)
		estimate.lights[0].direction[a] = toward_sun[a];
	for (int c = 0; c < 3; c++) /* E = pi L00 Y00 */
		total[0][c] = AMBIENT / M_PI * sqrt(4.0 * M_PI);
	lp_sh_add_lamp(LP_SH_MAX_ORDER, toward_sun, white, 0.0, 1.0, total);
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			estimate.sh_total[i][c] = (float)total[i][c];
	lp_ring_steps_frame(steps, &to_anchor, &now, &now, (const double(*)[3])total, &estimate);
}

/* Ratios are learned at one yaw; a reading at another one follows. */
static bool steps_at(double from_deg, double to_deg, float sun)
{
	struct lp_ring_steps steps = {0};
	const struct lp_rotation to_anchor = yaw(to_deg);
	const struct lp_ring_sample now = reading(to_deg, sun, 1020000000);

	show(&steps, from_deg, 1000000000);
	steps.seen.t_capture_ns = 1010000000;
	return lp_ring_steps_reading(&steps, &to_anchor, 0.0F, &now);
}

/* A sensor that the sun has grazed has told nothing of how it reads a sun that it faces. */
static void test_a_turn_is_no_step(void **state)
{
	(void)state;
	for (int from_deg = 0; from_deg < 360; from_deg += 10)
		for (int to_deg = 0; to_deg < 360; to_deg += 10)
			assert_false(steps_at(from_deg, to_deg, 1.0F));
}

static void test_a_sun_that_goes_is_a_step(void **state)
{
	(void)state;
	assert_true(steps_at(0.0, 0.0, 0.5F));
	for (int deg = 0; deg < 360; deg += 10)
		assert_true(steps_at(deg, deg, 0.0F));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_turn_is_no_step),
		cmocka_unit_test(test_a_sun_that_goes_is_a_step),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
