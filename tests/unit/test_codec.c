/* SPDX-License-Identifier: Apache-2.0 */
#include "wire.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>

#include "base/clock.h"
#include "include/polarization_grid.h"
#include "include/processing.h"
#include "include/publisher.h"
#include "light/send/model.h"
#include "serve/codec/codec.h"
#include "serve/health.h"

static uint8_t packet_bytes[LP_PACKET_LARGE_BYTES];
static struct lp_packet packet = {.data = packet_bytes, .capacity_bytes = LP_PACKET_MAX_BYTES};
static const struct lp_stamp no_stamp;

/* Every field set, with values as large as a probe that has run for a day would send. */
static struct lp_light_estimate full_estimate(void)
{
	struct lp_light_estimate estimate = {
		.t_capture_ns = lp_clock_ns(),
		.sequence = 30 * 86400 - 1,
		.light_count = LP_MAX_LIGHTS,
		.exposure_us = 33333,
		.exposure_count = 4,
		.cd_m2_per_unit = NAN,
		.cd_m2_per_unit_sigma = NAN,
		.scale_sigma = NAN,
		.wheel_deg = NAN,
		.wheel_sigma_deg = NAN,
		.relighting_sigma = 0.0214F,
	};

	for (int i = 0; i < LP_MAX_LIGHTS; i++)
		estimate.lights[i] = (struct lp_light){
			.id = 100 + (uint32_t)i,
			.direction = {0.6F, 0.8F, 0},
			.irradiance = {3, 2, 1},
			.angular_radius_deg = 1.5F,
			.direction_sigma_deg = 0.1F,
			.irradiance_sigma = 0.999F,
			.colour_sigma = i == 0 ? 0.1874F : 0.0F,
			.distance_m = NAN,
		};
	for (int i = 0; i < LP_MAX_SH_COUNT; i++) {
		for (int c = 0; c < 3; c++)
			estimate.sh_total[i][c] = 1.0F + (float)(3 * i + c);
	}
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		for (int lights = 0; lights <= LP_MAX_LIGHTS; lights++)
			estimate.predicted_error[order][lights] =
				0.9F - 0.1F * (float)order - 0.01F * (float)lights;
	}
	return estimate;
}

static lightprobe_v1_Estimate encode(const struct lp_light_estimate *estimate, bool total,
				     int sh_order, int lights, const struct lp_stamp *stamp)
{
	const struct lp_variant variant = {.total = total, .sh_order = sh_order, .lights = lights};
	lightprobe_v1_FromProbe message;

	assert_int_equal(lp_encode_estimate(estimate, &variant, stamp, &packet), 0);
	assert_int_equal(packet.kind, LP_PACKET_STATE);
	message = decode_packet(&packet);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_estimate_tag);
	return message.message.estimate;
}

static void test_size_budgets(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = 1,
				       .ttl_ms = 1000,
				       .t_send_ns = estimate.t_capture_ns + LP_NS_PER_S};

	(void)state;
	/* The flags that an ordinary picture brings: one byte for the estimate, one for each light.
	 */
	estimate.flags = LP_ESTIMATE_CLIPPED;
	for (int i = 0; i < LP_MAX_LIGHTS; i++)
		estimate.lights[i].flags = LP_LIGHT_CLIPPED;
	encode(&estimate, false, 2, 4, &stamp);
	print_message("order 2, 4 lights: %u bytes\n", packet.size_bytes);
	assert_in_range(packet.size_bytes, 300, 380);
	encode(&estimate, false, 1, 0, &stamp);
	print_message("order 1, no lights: %u bytes\n", packet.size_bytes);
	assert_in_range(packet.size_bytes, 60, 100);
}

/* What the choice of a model counts with is what is sent. */
static void test_bytes_of_a_light_and_of_a_coefficient(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = 1,
				       .ttl_ms = 1000,
				       .t_send_ns = estimate.t_capture_ns + LP_NS_PER_S};
	uint32_t without;

	(void)state;
	for (int i = 0; i < LP_MAX_LIGHTS; i++)
		estimate.lights[i].flags = LP_LIGHT_CLIPPED;
	encode(&estimate, false, 2, 3, &stamp);
	without = packet.size_bytes;
	encode(&estimate, false, 2, 4, &stamp);
	assert_int_equal(packet.size_bytes - without, LP_LIGHT_BYTES);
	/* With lights: the message's own length takes two bytes either way. */
	encode(&estimate, false, 1, 4, &stamp);
	without = packet.size_bytes;
	encode(&estimate, false, 2, 4, &stamp);
	assert_int_equal(packet.size_bytes - without,
			 LP_COEFFICIENT_BYTES * (LP_SH_COUNT(2) - LP_SH_COUNT(1)));
}

/* AMBIENT + lights + KEY = TOTAL in every band that is sent. */
static void test_key(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = 1, .t_send_ns = estimate.t_capture_ns};

	(void)state;
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		const struct lp_variant variant = {.key = true, .sh_order = order, .lights = 3};
		double sum[LP_MAX_SH_COUNT][3] = {{0.0}};

		assert_int_equal(lp_encode_estimate(&estimate, &variant, &stamp, &packet), 0);
		const lightprobe_v1_Estimate e = decode_packet(&packet).message.estimate;

		assert_true(e.has_key && e.key.irradiance[0] > 0.0F);
		assert_int_equal(e.key.id, 0);
		lp_sh_add_lamp(order, e.key.direction, e.key.irradiance, 0.0, 1.0, sum);
		for (int k = 0; k < 3; k++)
			lp_sh_add_lamp(order, e.lights[k].direction, e.lights[k].irradiance, 0.0,
				       1.0, sum);
		for (int i = 0; i < LP_SH_COUNT(order); i++)
			for (int c = 0; c < 3; c++)
				assert_float_equal(e.sh.coefficients[3 * i + c] + sum[i][c],
						   estimate.sh_total[i][c], 1e-4);
	}
	assert_false(encode(&estimate, false, 2, 3, &stamp).has_key);
}

static void test_area_lights_tell_their_ellipse(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = 1, .t_send_ns = estimate.t_capture_ns};
	struct lp_light *area = &estimate.lights[1];

	(void)state;
	area->flags = LP_LIGHT_EXTENDED;
	memcpy(area->half_angle_deg, ((float[]){30.0F, 10.0F}), sizeof(area->half_angle_deg));
	memcpy(area->axis, ((float[]){0.8F, -0.6F, 0.0F}), sizeof(area->axis));
	const lightprobe_v1_Estimate e = encode(&estimate, false, 2, 2, &stamp);

	assert_int_equal(e.lights[0].half_angle_deg_count, 0);
	assert_int_equal(e.lights[0].axis_count, 0);
	assert_int_equal(e.lights[1].half_angle_deg_count, 2);
	assert_int_equal(e.lights[1].axis_count, 3);
	assert_float_equal(e.lights[1].half_angle_deg[1], 10.0, 0.0);
	assert_float_equal(e.lights[1].axis[1], -0.6, 1e-6);
}

static void test_every_variant_fits_a_packet(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = UINT32_MAX,
				       .ttl_ms = UINT32_MAX,
				       .t_send_ns = estimate.t_capture_ns + (INT64_C(1) << 50)};

	(void)state;
	estimate.sequence = UINT32_MAX;
	estimate.flags = UINT32_MAX;
	estimate.exposure_count = INT32_MAX;
	estimate.exposure_us = 1e30F;
	estimate.cd_m2_per_unit = 1e30F;
	for (int i = 0; i < LP_MAX_LIGHTS; i++) {
		estimate.lights[i].id = UINT32_MAX;
		estimate.lights[i].flags = UINT32_MAX;
		estimate.lights[i].irradiance_sigma = 1e30F;
		estimate.lights[i].distance_m = 1e30F;
		estimate.lights[i].half_angle_deg[0] = 90.0F;
		estimate.lights[i].axis[2] = 1.0F;
	}
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		for (int lights = 0; lights <= LP_MAX_LIGHTS; lights++) {
			const struct lp_variant variant = {.key = true,
							   .sh_order = order,
							   .lights = lights};

			assert_int_equal(lp_encode_estimate(&estimate, &variant, &stamp, &packet),
					 0);
			assert_true(packet.size_bytes <= LP_PACKET_MAX_BYTES);
		}
	}
}

static int64_t suspended_ns;

int64_t __wrap_lp_clock_suspended_ns(void);
int64_t __wrap_lp_clock_suspended_ns(void)
{
	return suspended_ns;
}

/* The clock that frames are stamped with stands still while the machine is suspended. */
static void test_an_old_estimate_is_as_old_as_the_sleep(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.t_send_ns = estimate.t_capture_ns + LP_NS_PER_MS};
	const int64_t captured_unix_ns = lp_clock_unix_ns(estimate.t_capture_ns);
	const int64_t jitter_ns = LP_NS_PER_MS;
	lightprobe_v1_Estimate wire;

	(void)state;
	estimate.suspended_ns = 7 * LP_NS_PER_S; /* long before */
	suspended_ns = estimate.suspended_ns + jitter_ns;
	wire = encode(&estimate, false, 0, 0, &stamp);
	assert_int_equal(wire.send_delay_us, 1000);
	suspended_ns = estimate.suspended_ns + 1800 * LP_NS_PER_S;
	wire = encode(&estimate, false, 0, 0, &stamp);
	assert_int_equal(wire.send_delay_us, 1800 * INT64_C(1000000) + 1000);
	assert_true(llabs((int64_t)wire.capture_time_unix_ns - captured_unix_ns +
			  1800 * LP_NS_PER_S) < 60 * LP_NS_PER_S);
	suspended_ns = 0;
}

static void test_what_is_older_than_its_time_to_live_is_stale(void **state)
{
	const struct lp_light_estimate estimate = full_estimate();
	struct lp_stamp stamp = {.ttl_ms = 500,
				 .t_send_ns = estimate.t_capture_ns + 500 * LP_NS_PER_MS};

	(void)state;
	assert_false(encode(&estimate, false, 3, 2, &stamp).flags & LP_ESTIMATE_STALE);
	stamp.t_send_ns += LP_NS_PER_US;
	assert_true(encode(&estimate, false, 3, 2, &stamp).flags & LP_ESTIMATE_STALE);
	stamp.t_send_ns += 30 * LP_NS_PER_S;
	assert_true(encode(&estimate, false, 3, 2, &stamp).flags & LP_ESTIMATE_STALE);
	stamp.lasts = true; /* of a set of pictures, however old */
	assert_false(encode(&estimate, false, 3, 2, &stamp).flags & LP_ESTIMATE_STALE);
}

static void test_values_arrive(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	const struct lp_stamp stamp = {.boot_id = 77,
				       .ttl_ms = 500,
				       .subscription = 3,
				       .t_send_ns = estimate.t_capture_ns + 1234 * LP_NS_PER_US};
	float ambient[LP_MAX_SH_COUNT][3];
	lightprobe_v1_Estimate wire;

	(void)state;
	estimate.cd_m2_per_unit = 42;
	estimate.cd_m2_per_unit_sigma = 0.031F;
	estimate.scale_sigma = 0.045F;
	estimate.wheel_deg = 135;
	estimate.wheel_sigma_deg = 0.5F;
	estimate.flags = LP_ESTIMATE_STALE;
	estimate.lights[1].distance_m = 2.5F;
	estimate.lights[1].polarization = (struct lp_light_polarization){.judged = true,
									 .known = true,
									 .reflection = 0.98F,
									 .dolp = 0.71F,
									 .aolp_deg = 3.5F,
									 .dolp_sigma = 0.0124F,
									 .aolp_sigma_deg = 0.75F};
	wire = encode(&estimate, false, 3, 2, &stamp);
	assert_int_equal(wire.sequence, estimate.sequence);
	assert_int_equal(wire.boot_id, 77);
	assert_int_equal(wire.ttl_ms, 500);
	assert_int_equal(wire.subscription, 3);
	assert_int_equal(wire.send_delay_us, 1234);
	assert_true(llabs((int64_t)wire.capture_time_unix_ns -
			  lp_clock_unix_ns(estimate.t_capture_ns)) < LP_NS_PER_S);
	assert_int_equal(wire.flags, LP_ESTIMATE_STALE | LP_ESTIMATE_MORE_LIGHTS);
	assert_true(wire.has_exposure_us && wire.exposure_us == 33333);
	assert_int_equal(wire.exposure_count, 4);
	assert_true(wire.has_cd_m2_per_unit && wire.cd_m2_per_unit == 42);
	assert_int_equal(wire.cd_m2_per_unit_sigma_permille, 31);
	assert_true(wire.has_scale_sigma_permille && wire.scale_sigma_permille == 45);
	assert_true(wire.has_wheel_deg && wire.wheel_deg == 135);
	assert_true(wire.has_wheel_sigma_deg && wire.wheel_sigma_deg == 0.5F);
	assert_int_equal(wire.predicted_error_permille, 580);
	assert_true(wire.has_relighting_sigma_permille);
	assert_int_equal(wire.relighting_sigma_permille, 21);
	assert_int_equal(wire.lights_count, 2);
	assert_int_equal(wire.lights[1].id, 101);
	assert_true(wire.lights[0].direction[1] == 0.8F && wire.lights[0].irradiance[2] == 1);
	assert_int_equal(wire.lights[0].irradiance_sigma_permille, 999);
	assert_true(wire.lights[0].has_colour_sigma_permille &&
		    wire.lights[0].colour_sigma_permille == 187);
	assert_false(wire.lights[1].has_colour_sigma_permille);
	assert_true(wire.lights[0].has_shadow_strength_permille);
	assert_int_equal(wire.lights[0].shadow_strength_permille,
			 lroundf(1000.0F * lp_shadow_strength(&estimate.lights[0],
							      lp_upward_irradiance(&estimate))));
	assert_false(wire.lights[0].has_distance_m);
	assert_true(wire.lights[1].has_distance_m && wire.lights[1].distance_m == 2.5F);
	assert_false(wire.lights[0].has_dolp_percent || wire.lights[0].has_aolp_deg ||
		     wire.lights[0].has_reflection_percent);
	assert_true(wire.lights[1].has_dolp_percent && wire.lights[1].dolp_percent == 71);
	assert_true(wire.lights[1].has_aolp_deg && wire.lights[1].aolp_deg == 3.5F);
	assert_true(wire.lights[1].has_dolp_sigma_permille &&
		    wire.lights[1].dolp_sigma_permille == 12);
	assert_true(wire.lights[1].has_aolp_sigma_deg && wire.lights[1].aolp_sigma_deg == 0.75F);
	assert_false(wire.lights[0].has_dolp_sigma_permille || wire.lights[0].has_aolp_sigma_deg);
	assert_true(wire.lights[1].has_reflection_percent &&
		    wire.lights[1].reflection_percent == 98);
	assert_int_equal(wire.sh.order, 3);
	assert_int_equal(wire.sh.kind, lightprobe_v1_SphericalHarmonics_Kind_AMBIENT);
	assert_int_equal(wire.sh.coefficients_count, 48);
	lp_model_ambient(&estimate, 3, 2, ambient);
	assert_memory_equal(wire.sh.coefficients, ambient, 48 * sizeof(float));

	wire = encode(&estimate, true, 4, 8, &stamp);
	assert_int_equal(wire.sh.kind, lightprobe_v1_SphericalHarmonics_Kind_TOTAL);
	assert_int_equal(wire.flags, LP_ESTIMATE_STALE);
	assert_memory_equal(wire.sh.coefficients, estimate.sh_total, 75 * sizeof(float));
}

static void test_unknown_is_absent_not_zero(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	lightprobe_v1_Estimate wire;

	(void)state;
	estimate.exposure_us = NAN;
	estimate.lights[0].direction_sigma_deg = NAN;
	estimate.lights[0].irradiance_sigma = NAN;
	estimate.predicted_error[2][1] = NAN;
	estimate.relighting_sigma = NAN;
	for (int i = 0; i < LP_MAX_LIGHTS; i++) /* nothing shines on what faces up */
		estimate.lights[i].direction[1] = -0.8F;
	memset(estimate.sh_total, 0, sizeof(estimate.sh_total));
	wire = encode(&estimate, false, 2, 1, &no_stamp);
	assert_false(wire.has_exposure_us || wire.has_cd_m2_per_unit ||
		     wire.has_cd_m2_per_unit_sigma_permille || wire.has_wheel_deg ||
		     wire.has_wheel_sigma_deg || wire.has_predicted_error_permille ||
		     wire.has_relighting_sigma_permille || wire.has_scale_sigma_permille);
	assert_false(wire.lights[0].has_direction_sigma_deg ||
		     wire.lights[0].has_irradiance_sigma_permille ||
		     wire.lights[0].has_confidence_percent || wire.lights[0].has_distance_m ||
		     wire.lights[0].has_shadow_strength_permille);
}

static void test_what_is_not_finite_is_not_sent(void **state)
{
	struct lp_light_estimate good = full_estimate();
	const struct lp_variant variant = {.total = true, .sh_order = 1, .lights = 1};
	float *const fields[] = {&good.lights[0].direction[2], &good.lights[0].irradiance[0],
				 &good.lights[0].angular_radius_deg, &good.sh_total[3][2]};
	const float bad[] = {NAN, INFINITY, -INFINITY};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(fields); i++) {
		for (size_t j = 0; j < LP_COUNT(bad); j++) {
			const float saved = *fields[i];

			*fields[i] = bad[j];
			assert_int_equal(lp_encode_estimate(&good, &variant, &no_stamp, &packet),
					 -ERANGE);
			*fields[i] = saved;
		}
	}
	good.sh_total[4][0] = NAN; /* not part of order 1 */
	assert_int_equal(lp_encode_estimate(&good, &variant, &no_stamp, &packet), 0);
}

static void test_delays_saturate(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	struct lp_stamp stamp = {.t_send_ns = estimate.t_capture_ns - 1};

	(void)state;
	assert_int_equal(encode(&estimate, false, 0, 0, &stamp).send_delay_us, 0);
	stamp.t_send_ns = estimate.t_capture_ns + 7200 * LP_NS_PER_S;
	assert_int_equal(encode(&estimate, false, 0, 0, &stamp).send_delay_us, UINT32_MAX);
}

static void test_hello_error_health(void **state)
{
	const struct lp_hello hello = {.boot_id = 9,
				       .source = "a-scheme-longer-than-the-field",
				       .preset = "fast",
				       .max_sh_order = 3,
				       .max_lights = 7,
				       .smoothing_ms = 250,
				       .name = "a name",
				       .insecure_lan = true,
				       .max_reflection_size = 32,
				       .processing_on = LP_PROCESSING_BIT(LP_PROCESSING_KINDS) - 1};
	static struct lp_health_report report = {.fault_count = LP_MAX_FAULTS, .preset = "fast"};
	lightprobe_v1_FromProbe message;
	char text[400];

	(void)state;
	lp_encode_hello(&hello, &packet);
	assert_int_equal(packet.kind, LP_PACKET_CONTROL);
	message = decode_packet(&packet);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_hello_tag);
	assert_int_equal(message.message.hello.protocol_major, 1);
	assert_string_equal(message.message.hello.source, "a-sc...he-field");
	assert_string_equal(message.message.hello.software, "lightprobed " LP_VERSION);
	assert_int_equal(message.message.hello.smoothing_time_constant_ms, 250);
	assert_string_equal(message.message.hello.name, "a name");
	assert_true(message.message.hello.insecure_lan);
	assert_int_equal(message.message.hello.max_reflection_map_size, 32);
	assert_int_equal(message.message.hello.processing_count, LP_PROCESSING_KINDS);
	for (int kind = 0; kind < LP_PROCESSING_KINDS; kind++) /* none is cut */
		assert_string_equal(message.message.hello.processing[kind],
				    lp_processing_name(kind));

	/* Too long for the field of 239 bytes: cut between characters, in the middle. */
	memset(text, 'x', 238);
	(void)strcpy(text + 238, "— and more");
	lp_encode_error(-EMSGSIZE, text, &packet);
	message = decode_packet(&packet);
	assert_int_equal(message.message.error.code, -EMSGSIZE);
	assert_int_equal(strlen(message.message.error.text), 239);
	assert_contains(message.message.error.text, "x...x");
	assert_contains(message.message.error.text, "x— and more");

	for (int i = 0; i < LP_MAX_FAULTS; i++) {
		report.faults[i].id = "source-waiting-with-a-rather-long-name";
		memset(report.faults[i].text, 'y', sizeof(report.faults[i].text) - 1);
	}
	memset(&report.frames_received, 0xff, sizeof(uint64_t));
	report.source_state = LP_SOURCE_STALLED;
	lp_encode_health(&report, &packet);
	message = decode_packet(&packet);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_health_tag);
	assert_int_equal(message.message.health.faults_count, LP_MAX_FAULTS);
	assert_int_equal(message.message.health.source_state,
			 lightprobe_v1_Health_SourceState_STALLED);
	assert_true(message.message.health.frames_received == UINT64_MAX);
}

static void test_wheel_and_ring_in_health(void **state)
{
	struct lp_health_report report = {
		.preset = "",
		.has_wheel = true,
		.has_ring = true,
		.wheel = {.state = {.phase = LP_WHEEL_MOVING,
				    .commanded_deg = 45,
				    .measured_deg = NAN,
				    .sigma_deg = NAN,
				    .clock_sigma_us = 12,
				    .reconnects = 2},
			  .moves = 3,
			  .frames_moving = 4},
		.ring = {.illuminance_lux = {1, 2, NAN, 4, 5, 6, 7, 8, 9}, .samples_lost = 7},
	};
	lightprobe_v1_Health wire;

	(void)state;
	lp_encode_health(&report, &packet);
	wire = decode_packet(&packet).message.health;
	assert_true(wire.has_wheel && wire.has_ring);
	assert_int_equal(wire.wheel.phase, lightprobe_v1_Wheel_Phase_MOVING);
	assert_true(wire.wheel.has_commanded_deg && !wire.wheel.has_measured_deg);
	assert_true(wire.wheel.has_clock_sigma_us && wire.wheel.reconnects == 2);
	assert_true(wire.wheel.moves == 3 && wire.wheel.frames_moving == 4);
	assert_int_equal(wire.ring.illuminance_lux_count, 9);
	assert_true(isnan(wire.ring.illuminance_lux[2]) && wire.ring.illuminance_lux[8] == 9);
	assert_true(wire.ring.samples_lost == 7);
	report.has_wheel = report.has_ring = false;
	lp_encode_health(&report, &packet);
	wire = decode_packet(&packet).message.health;
	assert_false(wire.has_wheel || wire.has_ring);
}

static int decode(const lightprobe_v1_Subscription *wire, struct lp_subscription *subscription)
{
	uint8_t data[LP_REQUEST_MAX_BYTES];
	struct lp_request request;
	const char *reason;
	const int ret = lp_decode_request(data, encode_request(wire, data, sizeof(data)), &request,
					  &reason);

	assert_int_equal(request.kind, LP_REQUEST_SUBSCRIBE);
	*subscription = request.subscription;
	return ret;
}

static void test_subscription_defaults_and_values(void **state)
{
	lightprobe_v1_Subscription wire = lightprobe_v1_Subscription_init_zero;
	struct lp_subscription subscription;

	(void)state;
	assert_int_equal(decode(&wire, &subscription), 0);
	assert_int_equal(subscription.sh_order, 2);
	assert_int_equal(subscription.max_lights, 4);
	assert_false(subscription.total || subscription.raw || subscription.leave_out_reflections);
	assert_true(subscription.rate_hz == 0 && subscription.tolerance == 0);
	assert_false(subscription.key_light || subscription.area_lights);

	wire = (lightprobe_v1_Subscription){
		.rate_hz = 12.5F,
		.has_sh_order = true,
		.sh_order = 0,
		.has_max_lights = true,
		.max_lights = 99,
		.kind = lightprobe_v1_SphericalHarmonics_Kind_TOTAL,
		.tolerance_permille = 50,
		.number = 7,
		.leave_out_reflections = true,
		.smoothing = lightprobe_v1_Subscription_Smoothing_RAW,
		.health_period_ms = 1000,
		.quiet_ms = 100000,
		.key_light = true,
		.area_lights = true,
	};
	assert_int_equal(decode(&wire, &subscription), 0);
	assert_true(subscription.key_light && subscription.area_lights);
	assert_int_equal(subscription.sh_order, 0);
	assert_int_equal(subscription.max_lights, LP_MAX_LIGHTS);
	assert_true(subscription.total && subscription.raw && subscription.rate_hz == 12.5F);
	assert_true(fabsf(subscription.tolerance - 0.05F) < 1e-6F);
	assert_int_equal(subscription.number, 7);
	assert_true(subscription.leave_out_reflections);
	assert_int_equal(subscription.health_period_ms, 1000);
	assert_int_equal(subscription.quiet_ms, LP_MOST_QUIET_MS);
}

static void test_reflection_map_wishes(void **state)
{
	const lightprobe_v1_ReflectionMapWish good[] = {{.size = 16},
							{.size = 32, .rate_hz = 1e9F},
							{.size = 64, .rate_hz = 0.5F, .kind = 1}};
	const struct lp_reflection_wish expected[] = {{16, 5, true},
						      {32, 30, true},
						      {64, 0.5F, false}};
	const lightprobe_v1_ReflectionMapWish bad[] = {
		{.size = 8},
		{.size = 33},
		{.size = 128},
		{.size = 32, .rate_hz = -1},
		{.size = 32, .rate_hz = NAN},
		{.size = 32, .rate_hz = INFINITY},
		{.size = 32, .kind = (lightprobe_v1_SphericalHarmonics_Kind)3}};
	lightprobe_v1_Subscription wire = {.has_reflection_map = true};
	struct lp_subscription subscription;

	(void)state;
	assert_int_equal(decode(&wire, &subscription), 0); /* of no size: none */
	assert_int_equal(subscription.reflection.size, 0);
	for (unsigned int k = 0; k < LP_COUNT(good); k++) {
		wire.reflection_map = good[k];
		assert_int_equal(decode(&wire, &subscription), 0);
		assert_int_equal(subscription.reflection.size, expected[k].size);
		assert_true(subscription.reflection.rate_hz == expected[k].rate_hz);
		assert_int_equal(subscription.reflection.total, expected[k].total);
	}
	for (unsigned int k = 0; k < LP_COUNT(bad); k++) {
		wire.reflection_map = bad[k];
		assert_int_equal(decode(&wire, &subscription), -ERANGE);
	}
}

static void test_bad_requests(void **state)
{
	static const uint8_t garbage[] = {0xff, 0xff, 0xff, 0xff};
	static const uint8_t unknown_request[] = {0x7a, 0x00}; /* field 15, empty message */
	lightprobe_v1_Subscription wire = lightprobe_v1_Subscription_init_zero;
	struct lp_subscription subscription;
	struct lp_request request;
	const float rates[] = {-1, NAN, INFINITY};
	const char *reason;

	(void)state;
	assert_int_equal(lp_decode_request(garbage, 4, &request, &reason), -EBADMSG);
	assert_int_equal(lp_decode_request(NULL, 0, &request, &reason), -EOPNOTSUPP);
	assert_int_equal(lp_decode_request(unknown_request, 2, &request, &reason), -EOPNOTSUPP);
	for (size_t i = 0; i < LP_COUNT(rates); i++) {
		wire.rate_hz = rates[i];
		assert_int_equal(decode(&wire, &subscription), -ERANGE);
	}
	wire.rate_hz = 0;
	wire.kind = (lightprobe_v1_SphericalHarmonics_Kind)7;
	assert_int_equal(decode(&wire, &subscription), -ERANGE);
	wire.kind = 0;
	wire.smoothing = (lightprobe_v1_Subscription_Smoothing)7;
	assert_int_equal(decode(&wire, &subscription), -ERANGE);
}

static size_t encode_client(const lightprobe_v1_FromClient *message, uint8_t *data, size_t size)
{
	pb_ostream_t stream = pb_ostream_from_buffer(data, size);

	assert_true(pb_encode(&stream, lightprobe_v1_FromClient_fields, message));
	return stream.bytes_written;
}

static void test_poses_and_pings(void **state)
{
	lightprobe_v1_FromClient wire = {.which_message = lightprobe_v1_FromClient_pose_tag,
					 .message.pose = {.time_ns = -5,
							  .orientation_count = 4,
							  .orientation = {0, 0, 0, 1}}};
	lightprobe_v1_Pose *const pose = &wire.message.pose;
	uint8_t data[LP_REQUEST_MAX_BYTES];
	struct lp_request request;
	const char *reason;

	(void)state;
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_int_equal(request.kind, LP_REQUEST_POSE);
	assert_int_equal(request.pose.time_ns, -5);
	assert_true(request.pose.quaternion[3] == 1.0);
	assert_float_equal(request.pose.sigma_rad, 0.2 * M_PI / 180.0, 1e-9);
	assert_true(isnan(request.pose.position_m[0]));

	const lightprobe_v1_Pose
		good = *pose,
		bad[] = {
			{.time_ns = INT64_MAX, .orientation_count = 4},
			{.time_ns = INT64_MIN, .orientation_count = 4},
			{.orientation_count = 3},
			{.orientation_count = 4, .has_sigma_deg = true, .sigma_deg = 0},
			{.orientation_count = 4, .has_sigma_deg = true, .sigma_deg = NAN},
			{.orientation_count = 4, .position_count = 2},
			{.orientation_count = 4, .position_count = 3, .position = {0, 0, NAN}},
			{.orientation_count = 4, .position_count = 3, .position = {2e6F, 0, 0}},
			{.orientation_count = 4,
			 .position_count = 3,
			 .has_position_sigma_m = true,
			 .position_sigma_m = 0},
		};
	for (size_t i = 0; i < LP_COUNT(bad); i++) {
		*pose = bad[i];
		assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)),
						   &request, &reason),
				 -ERANGE);
		assert_int_equal(request.kind, LP_REQUEST_POSE);
	}
	*pose = good;
	pose->position_count = 3;
	pose->position[1] = 1.5F;
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_true(request.pose.position_m[1] == 1.5);
	assert_float_equal(request.pose.position_sigma_m, 0.005, 1e-9);
	wire = (lightprobe_v1_FromClient){.which_message = lightprobe_v1_FromClient_ping_tag,
					  .message.ping = {.time_ns = 7,
							   .has_pong_time_ns = true,
							   .pong_time_ns = 3}};
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_int_equal(request.kind, LP_REQUEST_PING);
	assert_int_equal(request.ping.time_ns, 7);
	assert_true(request.ping.has_pong_time && request.ping.pong_time_ns == 3);
}

/* The orientation is sent where it is known, and the frame that the variant says. */
static void test_orientation_and_frame(void **state)
{
	struct lp_light_estimate estimate = full_estimate();
	struct lp_variant variant = {.sh_order = 2, .lights = 1};
	lightprobe_v1_Estimate wire = encode(&estimate, false, 2, 1, &no_stamp);

	(void)state;
	assert_int_equal(wire.orientation_count, 0);
	assert_false(wire.has_orientation_sigma_deg);
	assert_int_equal(wire.frame, lightprobe_v1_Estimate_Frame_PROBE);
	estimate.orientation = (struct lp_estimate_orientation){.known = true,
								.xyzw = {0, 0.6F, 0, 0.8F},
								.sigma_deg = 0.25F};
	variant.world = true;
	assert_int_equal(lp_encode_estimate(&estimate, &variant, &no_stamp, &packet), 0);
	wire = decode_packet(&packet).message.estimate;
	assert_int_equal(wire.frame, lightprobe_v1_Estimate_Frame_WORLD);
	assert_int_equal(wire.orientation_count, 4);
	assert_true(wire.orientation[1] == 0.6F && wire.orientation_sigma_deg == 0.25F);
	estimate.orientation.xyzw[2] = NAN;
	assert_int_equal(lp_encode_estimate(&estimate, &variant, &no_stamp, &packet), -ERANGE);
}

static void test_polarization_maps_and_sweeps(void **state)
{
	static struct lp_polarization_grid grid;
	lightprobe_v1_FromClient wire = {.which_message =
						 lightprobe_v1_FromClient_get_polarization_map_tag};
	struct lp_request request;
	uint8_t data[16];
	const char *reason;

	(void)state;
	grid.t_capture_ns = lp_clock_ns();
	grid.s0_unit = 0.5F;
	for (int i = 0; i < LP_POLARIZATION_CELLS; i++)
		for (int k = 0; k < 4; k++)
			grid.cells[i][k] = (uint16_t)(4 * i + k);
	packet.capacity_bytes = sizeof(packet_bytes);
	lp_encode_polarization(&grid, 7, &packet);
	assert_int_equal(packet.kind, LP_PACKET_PICTURE);
	const lightprobe_v1_PolarizationMap map = decode_packet(&packet).message.polarization_map;

	assert_int_equal(map.width * map.height * 8, map.cells.size);
	assert_true(map.s0_unit == 0.5F && map.sweeps == 7);
	for (int i = 0; i < map.cells.size / 2; i++)
		assert_int_equal(map.cells.bytes[2 * i] + 256 * map.cells.bytes[2 * i + 1], i);
	packet.capacity_bytes = LP_PACKET_MAX_BYTES;
	lp_encode_sweep_started(9, &packet);
	assert_int_equal(packet.kind, LP_PACKET_CONTROL);
	assert_int_equal(decode_packet(&packet).message.sweep_started.done_at, 9);
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_int_equal(request.kind, LP_REQUEST_POLARIZATION_MAP);
	wire.which_message = lightprobe_v1_FromClient_start_sweep_tag;
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_int_equal(request.kind, LP_REQUEST_SWEEP);
	lp_encode_stills_asked(2, &packet);
	assert_int_equal(decode_packet(&packet).message.stills_asked.cameras, 2);
	wire.which_message = lightprobe_v1_FromClient_take_stills_tag;
	assert_int_equal(lp_decode_request(data, encode_client(&wire, data, sizeof(data)), &request,
					   &reason),
			 0);
	assert_int_equal(request.kind, LP_REQUEST_STILLS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_size_budgets),
		cmocka_unit_test(test_bytes_of_a_light_and_of_a_coefficient),
		cmocka_unit_test(test_key),
		cmocka_unit_test(test_area_lights_tell_their_ellipse),
		cmocka_unit_test(test_every_variant_fits_a_packet),
		cmocka_unit_test(test_values_arrive),
		cmocka_unit_test(test_what_is_older_than_its_time_to_live_is_stale),
		cmocka_unit_test(test_an_old_estimate_is_as_old_as_the_sleep),
		cmocka_unit_test(test_unknown_is_absent_not_zero),
		cmocka_unit_test(test_what_is_not_finite_is_not_sent),
		cmocka_unit_test(test_delays_saturate),
		cmocka_unit_test(test_hello_error_health),
		cmocka_unit_test(test_wheel_and_ring_in_health),
		cmocka_unit_test(test_subscription_defaults_and_values),
		cmocka_unit_test(test_reflection_map_wishes),
		cmocka_unit_test(test_bad_requests),
		cmocka_unit_test(test_poses_and_pings),
		cmocka_unit_test(test_orientation_and_frame),
		cmocka_unit_test(test_polarization_maps_and_sweeps),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
