/* SPDX-License-Identifier: Apache-2.0 */
/* From pictures through the real pipeline to the bytes of a reflection map. */
#include "serve/reflection_maps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "estimate/pipeline.h"
#include "estimate/surroundings.h"
#include "light/send/cube.h"
#include "light/send/model.h"
#include "normals.h"
#include "scene.h"
#include "wire.h"

/* Root mean square over the normals, relative to the largest irradiance on any surface. */
#define FLUX_TOLERANCE 0.005
/* Of a window, of which the estimate knows its SH alone: these end at order 4. */
#define TRUNCATION 0.01

static const int sizes[] = {16, 32, 64};
static const struct disc lamps[] = {{30, 20, 2, 400}, {180, 50, 0.3, 2e4}, {-60, -30, 6, 40}};

static struct lp_estimates estimates;
static struct lp_surroundings surroundings;
static struct lp_packets *packets;
static struct lp_reflection_maps *maps;
static struct lp_pipeline *pipeline;

static int setup(void **state)
{
	const struct lp_pipeline_options options = {.preset = LP_PRESET_BALANCED,
						    .max_lights = 8,
						    .sh_order = 4,
						    .smoothing_ms = 100.0F,
						    .ttl_ms = 1000.0F,
						    .reflection_size = 64};

	(void)state;
	estimates = (struct lp_estimates){.surroundings = &surroundings};
	packets = lp_packets_create(8, 0);
	maps = lp_reflection_maps_create(64, 4);
	return packets && maps ? lp_pipeline_create(&options, &pipeline) : -1;
}

static int teardown(void **state)
{
	(void)state;
	lp_pipeline_destroy(pipeline);
	lp_reflection_maps_destroy(maps);
	lp_packets_destroy(packets);
	return 0;
}

static void look(const struct disc *discs, int count, double radiance, int size)
{
	const struct lp_demand demand = {.sh_order = 4, .max_lights = 8, .reflection_size = size};
	float command_us;

	surroundings.size = 0;
	assert_int_equal(lp_pipeline_process(pipeline,
					     scene_frame(1920, 960, discs, count, radiance),
					     &demand, &estimates, &command_us),
			 0);
}

/* ---------------------------------------------------------------- what a client does */

struct picture {
	struct lp_cube_grid *grid;
	float (*rgb)[3];
};

static bool read_texels(pb_istream_t *stream, const pb_field_t *field, void **argument)
{
	(void)field;
	return pb_read(stream, *argument, stream->bytes_left);
}

static struct picture read_map(const struct lp_packet *packet, int size)
{
	const int texels = LP_CUBE_TEXELS(size);
	uint8_t *bytes = malloc(4 * (size_t)texels);
	lightprobe_v1_ReflectionMap map = lightprobe_v1_ReflectionMap_init_zero;
	struct picture picture;
	pb_istream_t whole = pb_istream_from_buffer(packet->data, packet->size_bytes);
	pb_istream_t part;
	pb_wire_type_t type;
	uint32_t length, tag;
	bool at_end;

	assert_int_equal(packet->kind, LP_PACKET_PICTURE);
	assert_true(pb_decode_varint32(&whole, &length) && length == whole.bytes_left);
	assert_true(pb_decode_tag(&whole, &type, &tag, &at_end) && tag == 6);
	assert_true(pb_make_string_substream(&whole, &part));
	map.texels.funcs.decode = read_texels;
	map.texels.arg = bytes;
	assert_true(pb_decode(&part, lightprobe_v1_ReflectionMap_fields, &map));
	assert_int_equal(map.size, size);
	assert_int_equal(lp_cube_grid_create(size, &picture.grid), 0);
	picture.rgb = calloc((size_t)texels, sizeof(*picture.rgb));
	for (int i = 0; i < texels; i++) {
		const uint8_t *at = bytes + 4 * (size_t)i;
		const uint32_t bits = at[0] | at[1] << 8 | at[2] << 16 | (uint32_t)at[3] << 24;

		for (int c = 0; c < 3; c++)
			picture.rgb[i][c] = map.scale * ldexpf((float)(bits >> (9 * c) & 511),
							       (int)(bits >> 27) - 24);
	}
	free(bytes);
	return picture;
}

static void free_picture(struct picture *picture)
{
	lp_cube_grid_destroy(picture->grid);
	free(picture->rgb);
}

static struct picture make(const struct lp_subscription *wanted, struct lp_choice *choice)
{
	const struct lp_demand computed = {.sh_order = 4, .max_lights = 8};
	const struct lp_stamp stamp = {.boot_id = 7};
	struct lp_packet *packet;

	*choice = lp_packets_choose(packets, &estimates, &computed, wanted);
	packet =
		lp_reflection_maps_packet(maps, &surroundings, choice, &wanted->reflection, &stamp);
	assert_non_null(packet);
	return read_map(packet, wanted->reflection.size);
}

static void forget(struct picture *picture)
{
	free_picture(picture);
	lp_reflection_maps_forget(maps);
	lp_packets_forget(packets);
}

static double lit_by_map(const struct picture *picture, const float normal[3])
{
	double sum = 0.0;
	float d[3];

	for (int i = 0; i < picture->grid->texels; i++) {
		lp_cube_direction(picture->grid->size, i, d);
		sum += (double)picture->rgb[i][1] * picture->grid->solid_angle_sr[i] *
		       cosine(d, normal);
	}
	return sum;
}

/* By all that is known: every light as such, and the rest by its SH. A packet that lists fewer
 * lights says the same within the truncation of its SH. */
static double lit_by_estimate(const struct lp_choice *choice, bool total, const float normal[3])
{
	const struct lp_light_estimate *all = choice->all, *listed = choice->listed;
	const int lamp_count = all->light_count - all->area_count;
	float rest[LP_MAX_SH_COUNT][3], rgb[3];
	double sum;

	lp_model_ambient(all, LP_MAX_SH_ORDER, lamp_count, rest);
	lp_sh_irradiance(LP_MAX_SH_ORDER, (const float(*)[3])rest, normal, rgb);
	sum = rgb[1];
	for (int k = 0; k < lamp_count; k++)
		sum += (double)all->lights[k].irradiance[1] *
		       cosine(all->lights[k].direction, normal);
	for (int k = 0; !total && k < choice->variant.lights; k++)
		sum -= (double)listed->lights[k].irradiance[1] *
		       cosine(listed->lights[k].direction, normal);
	return sum;
}

static void check_flux(const struct picture *picture, const struct lp_choice *choice, bool total,
		       double tolerance)
{
	double sum = 0.0, largest = 0.0;
	float n[3];

	for (int k = 0; k < NORMALS; k++) {
		normal_of(k, n);
		const double expected = lit_by_estimate(choice, total, n);
		const double off = lit_by_map(picture, n) - expected;

		sum += off * off;
		largest = fmax(largest, expected);
	}
	print_message("%d texels, %s, %d lights: %.2f %% of the largest irradiance\n",
		      picture->grid->size, total ? "TOTAL" : "AMBIENT", choice->variant.lights,
		      100.0 * sqrt(sum / NORMALS) / largest);
	assert_true(sqrt(sum / NORMALS) / largest < tolerance);
}

static float brightest(const struct picture *picture, float direction[3])
{
	int best = 0;

	for (int i = 0; i < picture->grid->texels; i++)
		if (picture->rgb[i][1] > picture->rgb[best][1])
			best = i;
	lp_cube_direction(picture->grid->size, best, direction);
	return picture->rgb[best][1];
}

/* ---------------------------------------------------------------- tests */

/* The light of the map is that of the packet beside it, whatever that lists. */
static void test_flux_is_that_of_the_packet(void **state)
{
	(void)state;
	look(lamps, 3, 1.5, 64);
	assert_int_equal(estimates.raw.light_count, 3);
	assert_int_equal(surroundings.kept_count, 0);
	for (unsigned int s = 0; s < LP_COUNT(sizes); s++)
		for (int lights = 0; lights <= 3; lights++)
			for (int total = 0; total < 2; total++)
				for (int raw = 0; raw < 2; raw++) {
					const struct lp_subscription wanted = {
						.sh_order = 2,
						.max_lights = lights,
						.raw = raw,
						.reflection = {sizes[s], 5, total}};
					struct lp_choice choice;
					struct picture picture = make(&wanted, &choice);

					check_flux(&picture, &choice, total, FLUX_TOLERANCE);
					forget(&picture);
				}
}

static void test_lamps_are_in_total_alone(void **state)
{
	const struct lp_subscription total = {.sh_order = 2,
					      .max_lights = 4,
					      .raw = true,
					      .reflection = {32, 5, true}};
	const struct lp_subscription ambient = {.sh_order = 2,
						.max_lights = 4,
						.raw = true,
						.reflection = {32, 5, false}};
	struct lp_choice choice;
	double lamp[3];
	float d[3];

	(void)state;
	look(lamps, 1, 1.5, 32);
	disc_direction(&lamps[0], lamp);
	struct picture picture = make(&total, &choice);

	assert_true(brightest(&picture, d) > 100.0F);
	assert_true(angle_between_deg(lamp, d) < 90.0 / 32);
	forget(&picture);
	picture = make(&ambient, &choice);
	assert_true(brightest(&picture, d) < 1.5F * 1.1F);
	forget(&picture);
}

/* A map is of the camera's frame, and lamps go where the picture is. */
static void test_wide_lights_keep_their_picture(void **state)
{
	const struct disc window[] = {{90, 0, 20, 30}};
	struct lp_subscription wanted = {.sh_order = 2,
					 .max_lights = 4,
					 .raw = true,
					 .reflection = {32, 5, true}};
	const float right[3] = {1, 0, 0}, edge[3] = {0.955F, 0.296F, 0}; /* 17 degrees up */
	struct lp_choice choice;

	(void)state;
	look(window, 1, 1.0, 32);
	struct picture picture = make(&wanted, &choice);

	check_flux(&picture, &choice, true, TRUNCATION);
	assert_float_equal(picture.rgb[lp_cube_texel(32, right)][1] / 30, 1, 0.1);
	assert_float_equal(picture.rgb[lp_cube_texel(32, edge)][1] / 30, 1, 0.1);
	forget(&picture);
	wanted.area_lights = true; /* listed as an area light, it leaves AMBIENT */
	wanted.reflection.total = false;
	picture = make(&wanted, &choice);
	assert_int_equal(choice.variant.lights, 1);
	assert_true(picture.rgb[lp_cube_texel(32, right)][1] < 4.0F);
	forget(&picture);
}

/* Smoothed light lags behind; the map is as bright as the packet that it goes with. */
static void test_the_map_follows_smoothed_light(void **state)
{
	const struct lp_subscription wanted = {.sh_order = 2,
					       .max_lights = 4,
					       .reflection = {32, 5, true}};
	struct lp_choice choice;

	(void)state;
	look(lamps, 3, 1.5, 32);
	look(lamps, 2, 15.0, 32);
	struct picture picture = make(&wanted, &choice);

	check_flux(&picture, &choice, true, FLUX_TOLERANCE);
	forget(&picture);
	look(lamps, 0, 0.02, 32);
	picture = make(&wanted, &choice);
	check_flux(&picture, &choice, true, FLUX_TOLERANCE);
	forget(&picture);
}

static void test_black_is_black(void **state)
{
	const struct lp_subscription wanted = {.sh_order = 2,
					       .max_lights = 4,
					       .raw = true,
					       .reflection = {16, 5, true}};
	struct lp_choice choice;
	float d[3];

	(void)state;
	look(NULL, 0, 0.0, 16);
	struct picture picture = make(&wanted, &choice);

	assert_true(brightest(&picture, d) == 0.0F);
	forget(&picture);
}

static void test_nothing_is_made_that_nobody_wants(void **state)
{
	(void)state;
	look(lamps, 1, 1.0, 0);
	assert_int_equal(surroundings.size, 0);
}

/* The same map is made once; a smaller one is made of the larger. */
static void test_same_wishes_share_a_map(void **state)
{
	const struct lp_demand computed = {.sh_order = 4, .max_lights = 8};
	struct lp_subscription wanted = {.sh_order = 2, .max_lights = 4, .raw = true};
	const struct lp_reflection_wish total = {32, 5, true}, ambient = {32, 1, false},
					larger = {64, 5, true};
	const struct lp_stamp one = {.subscription = 1}, two = {.subscription = 2},
			      three = {.subscription = 3};

	(void)state;
	look(lamps, 2, 1.0, 32);
	struct lp_choice choice = lp_packets_choose(packets, &estimates, &computed, &wanted);
	struct lp_packet *const held = lp_packet_hold(
		lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &one));
	const struct lp_packet *first = held;
	struct picture before = read_map(first, 32);

	assert_ptr_equal(lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &one),
			 first);
	assert_ptr_equal(lp_reflection_maps_packet(maps, &surroundings, &choice, &larger, &one),
			 first); /* there is no more */
	assert_ptr_not_equal(lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &two),
			     first);
	/* composed once: for another number of a subscription nothing is looked at again */
	surroundings.rgb[0][0] *= 100.0F;
	surroundings.rgb[1][7] = NAN;
	const struct lp_packet *again =
		lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &three);

	assert_non_null(again);
	struct picture picture = read_map(again, 32);

	for (int i = 0; i < picture.grid->texels; i++)
		assert_memory_equal(picture.rgb[i], before.rgb[i], sizeof(before.rgb[i]));
	free_picture(&picture);
	free_picture(&before);
	lp_packet_drop(held);
	surroundings.rgb[0][0] /= 100.0F;
	surroundings.rgb[1][7] = surroundings.rgb[1][8];
	first = lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &one);
	const struct lp_packet *second =
		lp_reflection_maps_packet(maps, &surroundings, &choice, &ambient, &one);

	assert_ptr_not_equal(second, first);
	wanted.max_lights = 1; /* another list: another AMBIENT, the same TOTAL */
	choice = lp_packets_choose(packets, &estimates, &computed, &wanted);
	assert_ptr_equal(lp_reflection_maps_packet(maps, &surroundings, &choice, &total, &one),
			 first);
	assert_ptr_not_equal(lp_reflection_maps_packet(maps, &surroundings, &choice, &ambient,
						       &one),
			     second);
	/* more kinds than are remembered: each is made for itself, and none is lost */
	for (uint32_t k = 10; k < 30; k++)
		assert_non_null(
			lp_reflection_maps_packet(maps, &surroundings, &choice, &ambient,
						  &(const struct lp_stamp){.subscription = k}));
	lp_reflection_maps_forget(maps);
	lp_packets_forget(packets);
}

/* Byte by byte what proto/golden holds, and other languages decode; `drawn`: the errors in it. */
static void compare_bytes(const char *path, struct lp_drawn drawn)
{
	const struct lp_reflection_header header = {.size = 16,
						    .total = true,
						    .scale = 0.25F,
						    .drawn = drawn};
	const struct lp_stamp stamp = {.boot_id = 305419896, .subscription = 300};
	static uint8_t texels[4 * LP_CUBE_TEXELS(16)], expected[8192], large[8192];
	struct lp_packet packet = {.data = large, .capacity_bytes = sizeof(large)};
	struct lp_light_estimate estimate = {.sequence = 12,
					     .orientation = {.known = true,
							     .xyzw = {0.5F, -0.5F, 0.5F, 0.5F}}};
	FILE *file = fopen(path, "rb");

	assert_non_null(file);
	const size_t size = fread(expected, 1, sizeof(expected), file);

	fclose(file);
	texels[1] = texels[2] = 1;
	texels[3] = 129;
	memset(texels + sizeof(texels) - 4, 255, 4);
	lp_clock_simulate(1);
	estimate.t_capture_ns = 1700000000123456789 - lp_clock_unix_ns(0);
	lp_encode_reflection_map(&estimate, &header, texels, &stamp, &packet);
	lp_clock_simulate(0);
	assert_int_equal(packet.size_bytes, size);
	assert_memory_equal(large, expected, size);
}

static void test_bytes_are_the_frozen_ones(void **state)
{
	const struct lp_drawn unknown = {{NAN, NAN, NAN, NAN}},
			      known = {{NAN, NAN, 0.003F, 0.1085F}};

	(void)state;
	compare_bytes("proto/golden/reflection_map.bin", unknown);
	compare_bytes("proto/golden/reflection_map_drawn.bin", known);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_flux_is_that_of_the_packet, setup, teardown),
		cmocka_unit_test_setup_teardown(test_lamps_are_in_total_alone, setup, teardown),
		cmocka_unit_test_setup_teardown(test_wide_lights_keep_their_picture, setup,
						teardown),
		cmocka_unit_test_setup_teardown(test_the_map_follows_smoothed_light, setup,
						teardown),
		cmocka_unit_test_setup_teardown(test_black_is_black, setup, teardown),
		cmocka_unit_test_setup_teardown(test_nothing_is_made_that_nobody_wants, setup,
						teardown),
		cmocka_unit_test_setup_teardown(test_same_wishes_share_a_map, setup, teardown),
		cmocka_unit_test(test_bytes_are_the_frozen_ones),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
