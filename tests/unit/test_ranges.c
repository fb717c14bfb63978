/* SPDX-License-Identifier: Apache-2.0 */
/* Whatever the estimator hands over, nothing leaves that proto/ranges.toml forbids. */
#include "wire.h"

#include <errno.h>
#include <math.h>
#include <float.h>
#include <string.h>

#include "base/clock.h"
#include "include/polarization_grid.h"
#include "include/publisher.h"
#include "light/send/cube.h"
#include "proto/ranges.h"
#include "serve/codec/codec.h"
#include "serve/health.h"

static uint8_t packet_bytes[LP_PACKET_LARGE_BYTES];
static struct lp_packet packet = {.data = packet_bytes, .capacity_bytes = sizeof(packet_bytes)};
static const struct lp_stamp no_stamp;
static const float wrong[] = {NAN,  INFINITY, -INFINITY, -FLT_MAX, -1.0F,  -1e-3F, 0.0F,
			      0.9F, 1.1F,     4.5F,	 181.0F,   361.0F, 1e7F,   FLT_MAX};

static struct lp_light_estimate good_estimate(void)
{
	struct lp_light_estimate estimate = {.t_capture_ns = lp_clock_ns(),
					     .light_count = 2,
					     .area_count = 1,
					     .exposure_us = 33333,
					     .exposure_count = 4,
					     .cd_m2_per_unit = 3,
					     .cd_m2_per_unit_sigma = 0.1F,
					     .wheel_deg = 30,
					     .wheel_sigma_deg = 1,
					     .orientation = {.known = true, .xyzw = {0, 0, 0, 1}},
					     .room = {.known = true,
						      .walls_m = {1, 2, 3, 4, 5, 6},
						      .xyzw = {0, 0, 0, 1}}};

	for (int i = 0; i < 2; i++)
		estimate.lights[i] =
			(struct lp_light){.id = 1 + (uint32_t)i,
					  .direction = {0.6F, 0.8F, 0},
					  .irradiance = {3, 2, 1},
					  .angular_radius_deg = 1.5F,
					  .half_angle_deg = {3, 2},
					  .axis = {0, 0, 1},
					  .colour_sigma = 0.1F,
					  .distance_m = NAN,
					  .polarization = {.judged = true, .known = true}};
	estimate.lights[1].flags = LP_LIGHT_EXTENDED;
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			estimate.sh_total[i][c] = i == 0 ? 9.0F : 0.1F;
	return estimate;
}

/* What has been encoded is as it would be after another look at the table. */
static void assert_keeps(void)
{
	lightprobe_v1_FromProbe message = decode_packet(&packet), again = message;
	const char *told = message.which_message == lightprobe_v1_FromProbe_health_tag
				   ? lp_keep_Health(&again.message.health)
				   : lp_keep_Estimate(&again.message.estimate);

	if (told)
		fail_msg("sent: %s", told);
	assert_memory_equal(&message, &again, sizeof(message));
}

/* Puts every wrong number into every float of a part; gives how often nothing could be sent. */
static int spoil(float *part, size_t bytes, int (*encode)(void *), void *all)
{
	int refused = 0;

	for (size_t i = 0; i < bytes / sizeof(float); i++) {
		const float saved = part[i];

		for (size_t j = 0; j < LP_COUNT(wrong); j++) {
			part[i] = wrong[j];
			const int ret = encode(all);

			assert_true(ret == 0 || ret == -ERANGE);
			if (ret == 0)
				assert_keeps();
			refused += ret != 0;
		}
		part[i] = saved;
	}
	assert_int_equal(encode(all), 0);
	return refused;
}

static int encode_estimate(void *estimate)
{
	for (int total = 0; total < 2; total++) {
		const struct lp_variant variant = {.total = total,
						   .key = !total,
						   .sh_order = 2,
						   .lights = 2};
		const int ret = lp_encode_estimate(estimate, &variant, &no_stamp, &packet);

		if (ret != 0 || total)
			return ret;
		assert_keeps();
	}
	return 0;
}

#define SPOIL(member) spoil((float *)&(member), sizeof(member), encode_estimate, &estimate)

static void test_an_estimate_holds_what_is_allowed(void **state)
{
	struct lp_light_estimate estimate = good_estimate();

	(void)state;
	for (int i = 0; i < 2; i++) {
		struct lp_light *light = &estimate.lights[i];

		assert_true(SPOIL(light->direction) > 0);
		assert_true(SPOIL(light->irradiance) > 0);
		assert_true(SPOIL(light->angular_radius_deg) > 0);
		assert_int_equal(SPOIL(light->half_angle_deg) > 0, i == 1);
		assert_int_equal(SPOIL(light->axis) > 0, i == 1);
		assert_int_equal(SPOIL(light->direction_sigma_deg), 0);
		assert_int_equal(SPOIL(light->irradiance_sigma), 0);
		assert_int_equal(SPOIL(light->colour_sigma), 0);
		assert_int_equal(SPOIL(light->distance_m), 0);
		assert_int_equal(SPOIL(light->polarization.reflection), 0);
		assert_int_equal(SPOIL(light->polarization.dolp), 0);
		assert_int_equal(SPOIL(light->polarization.aolp_deg), 0);
		assert_int_equal(SPOIL(light->polarization.dolp_sigma), 0);
		assert_int_equal(SPOIL(light->polarization.aolp_sigma_deg), 0);
	}
	assert_true(SPOIL(estimate.sh_total) > 0);
	assert_int_equal(SPOIL(estimate.predicted_error), 0);
	assert_int_equal(SPOIL(estimate.relighting_sigma), 0);
	assert_int_equal(SPOIL(estimate.exposure_us), 0);
	assert_int_equal(SPOIL(estimate.scale_sigma), 0);
	assert_int_equal(SPOIL(estimate.cd_m2_per_unit), 0);
	assert_int_equal(SPOIL(estimate.cd_m2_per_unit_sigma), 0);
	assert_int_equal(SPOIL(estimate.wheel_deg), 0);
	assert_int_equal(SPOIL(estimate.wheel_sigma_deg), 0);
	assert_true(SPOIL(estimate.orientation.xyzw) > 0);
	assert_int_equal(SPOIL(estimate.orientation.sigma_deg), 0);
	assert_int_equal(SPOIL(estimate.room.walls_m), 0); /* it is left out */
	assert_int_equal(SPOIL(estimate.room.walls_sigma_m), 0);
	assert_int_equal(SPOIL(estimate.room.xyzw), 0);
	assert_int_equal(SPOIL(estimate.room.error_per_m), 0);
}

static int encode_health(void *report)
{
	return lp_encode_health(report, &packet);
}

#define SPOIL_HEALTH(member) spoil((float *)&(member), sizeof(member), encode_health, &report)

static void test_health_holds_what_is_allowed(void **state)
{
	static struct lp_health_report report = {.has_wheel = true, .has_ring = true};

	(void)state;
	assert_int_equal(SPOIL_HEALTH(report.ring.illuminance_lux), 0); /* NaN: not usable */
	assert_true(SPOIL_HEALTH(report.ring.samples_per_s) > 0);
	assert_true(SPOIL_HEALTH(report.estimates_per_s) > 0);
	assert_true(SPOIL_HEALTH(report.cpu_percent) > 0);
	assert_int_equal(SPOIL_HEALTH(report.wheel.state.commanded_deg), 0);
	assert_int_equal(SPOIL_HEALTH(report.wheel.state.measured_deg), 0);
	assert_int_equal(SPOIL_HEALTH(report.wheel.state.sigma_deg), 0);
	assert_int_equal(SPOIL_HEALTH(report.wheel.state.clock_sigma_us), 0);
}

static void test_maps_hold_what_is_allowed(void **state)
{
	static struct lp_polarization_grid grid;
	static uint8_t texels[4 * LP_CUBE_TEXELS(16)];
	struct lp_light_estimate estimate = good_estimate();
	struct lp_reflection_header header = {.size = 16, .scale = 0.25F};

	(void)state;
	assert_int_equal(lp_encode_reflection_map(&estimate, &header, texels, &no_stamp, &packet),
			 0);
	for (size_t j = 0; j < LP_COUNT(wrong); j++) {
		const bool holds = wrong[j] > 0.0F && isfinite(wrong[j]);

		header.scale = grid.s0_unit = wrong[j];
		assert_int_equal(lp_encode_reflection_map(&estimate, &header, texels, &no_stamp,
							  &packet),
				 holds ? 0 : -ERANGE);
		assert_int_equal(lp_encode_polarization(&grid, 0, &packet), holds ? 0 : -ERANGE);
	}
	header.scale = 1;
	estimate.orientation.xyzw[0] = 0.5F;
	assert_int_equal(lp_encode_reflection_map(&estimate, &header, texels, &no_stamp, &packet),
			 -ERANGE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_an_estimate_holds_what_is_allowed),
		cmocka_unit_test(test_health_holds_what_is_allowed),
		cmocka_unit_test(test_maps_hold_what_is_allowed),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
