/* SPDX-License-Identifier: Apache-2.0 */
/* The room as clients get it: in the frame of their packets, of the order that they are sent. */
#include "wire.h"

#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "light/math/rotation.h"
#include "light/send/tracker.h"
#include "serve/codec/codec.h"
#include "serve/packets.h"

static uint8_t packet_bytes[LP_PACKET_MAX_BYTES];
static struct lp_packet packet = {.data = packet_bytes, .capacity_bytes = sizeof(packet_bytes)};
static const struct lp_stamp no_stamp;

/* A lamp shines from the middle of the wall at +x; the probe is turned in the app's world. */
static struct lp_light_estimate in_a_room(void)
{
	struct lp_light_estimate e = {
		.t_capture_ns = lp_clock_ns(),
		.light_count = 1,
		.lights = {{.id = 1, .irradiance = {3, 2, 1}, .distance_m = NAN}},
		.orientation = {.known = true, .world = true, .xyzw = {0.64F, 0.0F, 0.48F, 0.6F}},
		.room = {.known = true,
			 .walls_m = {1, 2, 3, 4, 5, 6},
			 .walls_sigma_m = {0, 0.1F, 0.2F, 0.3F, 0.4F, 9},
			 .xyzw = {0, 0.6F, 0, 0.8F},
			 .error_per_m = {0.1F, 0.0502F, 0.0301F, 0.0201F, 0.0052F}},
	};
	const struct lp_rotation box = lp_rotation_of_quaternion((const double[]){0, 0.6, 0, 0.8});

	for (int a = 0; a < 3; a++)
		e.lights[0].direction[a] = (float)box.m[a][0];
	for (int c = 0; c < 3; c++)
		e.sh_total[0][c] = 3.0F;
	return e;
}

static lightprobe_v1_Estimate encode(const struct lp_light_estimate *estimate, int sh_order)
{
	const struct lp_variant variant = {.sh_order = sh_order, .lights = 1};

	assert_int_equal(lp_encode_estimate(estimate, &variant, &no_stamp, &packet), 0);
	return decode_packet(&packet).message.estimate;
}

static void test_the_room_arrives(void **state)
{
	static const uint32_t rounded_up[LP_MAX_SH_ORDER + 1] = {100, 51, 31, 21, 6};
	struct lp_light_estimate e = in_a_room();

	(void)state;
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		const lightprobe_v1_Estimate wire = encode(&e, order);

		assert_true(wire.has_room);
		assert_int_equal(wire.room.walls_m_count, 6);
		assert_memory_equal(wire.room.walls_m, e.room.walls_m, sizeof(e.room.walls_m));
		assert_int_equal(wire.room.walls_sigma_m_count, 6);
		assert_memory_equal(wire.room.walls_sigma_m, e.room.walls_sigma_m,
				    sizeof(e.room.walls_sigma_m));
		assert_int_equal(wire.room.orientation_count, 4);
		assert_memory_equal(wire.room.orientation, e.room.xyzw, sizeof(e.room.xyzw));
		assert_int_equal(wire.room.error_permille_per_m, rounded_up[order]);
	}
	e.room.known = false;
	assert_false(encode(&e, 2).has_room);
}

/* Area lights are in the SH, or listed: each has an error of its own. */
static void test_the_error_is_that_of_what_is_in_the_sh(void **state)
{
	struct lp_light_estimate e = in_a_room();

	(void)state;
	e.room.bare_error_per_m[2] = 0.011F;
	e.area_count = 1;
	assert_int_equal(encode(&e, 2).room.error_permille_per_m, 11);
	e.light_count++; /* one is not in the packet */
	assert_int_equal(encode(&e, 2).room.error_permille_per_m, 31);
}

/* The rest of the estimate arrives without it. */
static void test_a_room_that_is_none_is_left_out(void **state)
{
	struct lp_light_estimate e = in_a_room();
	float *const parts[] = {&e.room.walls_m[3], &e.room.walls_sigma_m[0], &e.room.xyzw[3],
				&e.room.error_per_m[2]};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(parts); i++) {
		const float saved = *parts[i];

		*parts[i] = NAN;
		assert_false(encode(&e, 2).has_room);
		*parts[i] = saved;
	}
	e.room.walls_m[0] = 0.0F; /* the probe is in the wall */
	assert_false(encode(&e, 2).has_room);
}

/* Of the order that they are sent in, with and without area lights. */
static void test_light_that_is_better_not_moved_has_no_room(void **state)
{
	struct lp_light_estimate e = in_a_room();

	(void)state;
	e.room.error_per_m[2] = INFINITY;
	assert_false(encode(&e, 2).has_room);
	assert_true(encode(&e, 4).has_room);
	e.area_count = 1; /* it is listed: the SH are without it */
	e.room.bare_error_per_m[4] = INFINITY;
	assert_true(encode(&e, 2).has_room);
	assert_false(encode(&e, 4).has_room);
}

/* In either frame, momentary or smoothed, the lamp is at the middle of the wall at +x. */
static void test_the_room_is_in_the_frame_of_the_packet(void **state)
{
	struct lp_packets *const packets = lp_packets_create(4, 1);
	struct lp_tracker tracker = {.time_constant_ms = 300.0F};
	const struct lp_demand computed = {.sh_order = 4, .max_lights = 8};
	struct lp_estimates estimates = {.raw = in_a_room()};

	(void)state;
	lp_tracker_update(&tracker, &estimates.raw, &estimates.smoothed);
	for (int k = 0; k < 4; k++) {
		const struct lp_subscription wanted = {.world = k & 1,
						       .raw = k & 2,
						       .sh_order = 4,
						       .max_lights = 4};
		const struct lp_packet *sent =
			lp_packets_estimate(packets, &estimates, &computed, &wanted, &no_stamp);
		const lightprobe_v1_Estimate wire = decode_packet(sent).message.estimate;
		const struct lp_rotation box = lp_rotation_of_quaternion(
			(const double[]){wire.room.orientation[0], wire.room.orientation[1],
					 wire.room.orientation[2], wire.room.orientation[3]});

		assert_true(wire.has_room);
		assert_int_equal(wire.frame, wanted.world);
		assert_int_equal(wire.lights_count, 1);
		for (int a = 0; a < 3; a++)
			assert_float_equal(box.m[a][0], wire.lights[0].direction[a], 1e-5);
		assert_int_equal(fabsf(wire.room.orientation[0]) > 0.01F, wanted.world);
		assert_memory_equal(wire.room.walls_m, estimates.raw.room.walls_m,
				    sizeof(estimates.raw.room.walls_m));
	}
	lp_packets_destroy(packets);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_room_arrives),
		cmocka_unit_test(test_the_error_is_that_of_what_is_in_the_sh),
		cmocka_unit_test(test_a_room_that_is_none_is_left_out),
		cmocka_unit_test(test_light_that_is_better_not_moved_has_no_room),
		cmocka_unit_test(test_the_room_is_in_the_frame_of_the_packet),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
