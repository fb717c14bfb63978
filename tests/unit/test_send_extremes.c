/* SPDX-License-Identifier: Apache-2.0 */
/* What is sent, at its ends: light of 1e-38 and 1e30, RGB9E5 from its least to its largest number,
 * packets whose fields are all as large as they can be. */
#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "figure.h"
#include "include/light_estimate.h"
#include "light/math/sh.h"
#include "light/send/cube.h"
#include "light/send/key.h"
#include "light/send/model.h"
#include "proto/ranges.h"
#include "random_normal.h"
#include "serve/codec/codec.h"
#include "wire.h"

#define SIZE 16
#define TEXELS LP_CUBE_TEXELS(SIZE)

/* ---------------------------------------------------------------- reflection maps */

static struct lp_cube new_cube(void)
{
	struct lp_cube_grid *grid;
	struct lp_cube cube;

	assert_int_equal(lp_cube_grid_create(SIZE, &grid), 0);
	cube.grid = grid;
	for (int c = 0; c < 3; c++) {
		cube.rgb[c] = aligned_alloc(16, TEXELS * sizeof(float));
		assert_non_null(cube.rgb[c]);
	}
	return cube;
}

static void free_cube(struct lp_cube *cube)
{
	for (int c = 0; c < 3; c++)
		free(cube->rgb[c]);
	lp_cube_grid_destroy((struct lp_cube_grid *)cube->grid);
}

/* One channel of a texel, in double: 9 bits of mantissa, an exponent of 5 bits (OpenGL 4.6, 8.5.2).
 */
static double decoded(const uint8_t *texel, float scale, int channel)
{
	const uint32_t bits = texel[0] | texel[1] << 8 | texel[2] << 16 | (uint32_t)texel[3] << 24;

	return scale * ldexp(bits >> (9 * channel) & 511, (int)(bits >> 27) - 24);
}

/* A cube whose brightest texel is `most`, the others down to 10^-12 of it. */
static void fill(struct lp_cube *cube, double most)
{
	for (int c = 0; c < 3; c++)
		for (int i = 0; i < TEXELS; i++)
			cube->rgb[c][i] =
				(float)(most * pow(10.0, -(i % 121) / 10.0) * (c == 1 ? 1.0 : 0.5));
}

static void test_texels_of_any_light(void **state)
{
	static const double brightest[] = {1e-45,   1e-42,   1e-38, 1e-30, 1e-6,  1.0,
					   65408.0, 65536.0, 1e10,  1e30,  3.4e38};
	struct lp_cube cube = new_cube();
	uint8_t texels[4 * TEXELS];
	double worst = 0.0;

	(void)state;
	for (size_t k = 0; k < LP_COUNT(brightest); k++) {
		fill(&cube, brightest[k]);
		const float scale = lp_cube_encode(&cube, texels);

		assert_true(scale > 0.0F && isfinite(scale));
		/* the least step: 2^-24 of the scale, and what a float itself rounds to */
		const double step = (double)scale * 0x1p-24 + 1.5e-45;

		for (int i = 0; i < TEXELS; i++) {
			const double largest =
				fmax(fmax((double)cube.rgb[0][i], cube.rgb[1][i]), cube.rgb[2][i]);

			for (int c = 0; c < 3; c++) {
				const double off = fabs(decoded(texels + 4 * (size_t)i, scale, c) -
							(double)cube.rgb[c][i]);

				worst = fmax(worst, fmax(off - step, 0.0) / largest);
			}
		}
	}
	figure("reflection maps", "RGB9E5, light 1e-45 … 3.4e38", "texel, of its largest channel",
	       worst, 1.0 / 512.0);
	for (int bad = 0; bad < 3; bad++) {
		fill(&cube, 1.0);
		cube.rgb[bad][7] = bad == 0 ? NAN : bad == 1 ? INFINITY : -INFINITY;
		assert_true(lp_cube_encode(&cube, texels) == -1.0F);
	}
	free_cube(&cube);
}

/* Lamps go into the map, and out of it, with all of their light, from denormal to 1e30. */
static void test_lamps_in_maps(void **state)
{
	static const float strengths[] = {1e-38F, 1e-30F, 1e-6F, 1.0F, 1e30F};
	static const float radii_deg[] = {0.0F, 1e-6F, 0.27F, 5.0F, 60.0F, 90.0F};
	struct lp_cube cube = new_cube();
	double worst = 0.0;

	(void)state;
	for (int k = 0; k < 5; k++)
		for (int r = 0; r < 6; r++)
			for (int corner = 0; corner < 4; corner++) {
				static const float at[4][3] = {{0.0F, 1.0F, 0.0F},
							       {0.57735F, 0.57735F, -0.57735F},
							       {-0.70711F, 0.0F, 0.70711F},
							       {0.0F, -1.0000001F, 1e-20F}};
				const struct lp_light light = {.direction = {at[corner][0],
									     at[corner][1],
									     at[corner][2]},
							       .angular_radius_deg = radii_deg[r]};
				const float irradiance[3] = {strengths[k], strengths[k] / 2.0F,
							     0.0F};
				double sum = 0.0;

				for (int c = 0; c < 3; c++)
					memset(cube.rgb[c], 0, TEXELS * sizeof(float));
				lp_cube_add_light(&cube, &light, irradiance);
				for (int i = 0; i < TEXELS; i++)
					sum += (double)cube.rgb[0][i] *
					       cube.grid->solid_angle_sr[i];
				worst = fmax(worst, fabs(sum / strengths[k] - 1.0));
				lp_cube_take_light(&cube, &light, irradiance);
				for (int c = 0; c < 3; c++)
					for (int i = 0; i < TEXELS; i++)
						assert_true(isfinite(cube.rgb[c][i]) &&
							    cube.rgb[c][i] >= 0.0F);
			}
	figure("reflection maps", "lamps of 1e-38 … 1e30, 0 … 90° wide, at poles and corners",
	       "flux, relative", worst, 1e-4);
	free_cube(&cube);
}

/* Pictures of 1e-30 … 1e30 brought to SH that they hardly have. */
static void test_fits(void **state)
{
	static const double lights[] = {1e-44, 1e-30, 1e-6, 1.0, 1e15, 1e30};
	struct lp_cube cube = new_cube();
	double worst = 0.0;

	(void)state;
	for (int k = 0; k < 6; k++)
		for (int way = 0; way < 4; way++) {
			double sh[LP_CUBE_BANDS][3] = {{0.0}}, found[LP_CUBE_BANDS][3] = {{0.0}};

			fill(&cube, way == 1 ? 0.0 : lights[k]);
			lp_cube_project(&cube, 1.0, sh);
			for (int c = 0; c < 3; c++) {
				sh[0][c] += way == 3 ? 0.0 : lights[k];
				sh[1][c] += way == 2 ? 1e6 * lights[k] : 0.1 * lights[k];
			}
			lp_cube_fit(&cube, (const double(*)[3])sh);
			for (int c = 0; c < 3; c++)
				for (int i = 0; i < TEXELS; i++)
					if (!(cube.rgb[c][i] >= 0.0F && isfinite(cube.rgb[c][i])))
						fail_msg("light %g, way %d: a texel is %g",
							 lights[k], way, (double)cube.rgb[c][i]);
			lp_cube_project(&cube, 1.0, found);
			if (way == 0 && lights[k] > 1e-35)
				for (int i = 0; i < LP_CUBE_BANDS; i++)
					worst = fmax(worst,
						     fabs(found[i][1] - sh[i][1]) / sh[0][1]);
		}
	figure("reflection maps", "brought to SH, light 1e-30 … 1e30", "SH, of their mean", worst,
	       1e-3);
	free_cube(&cube);
}

/* ---------------------------------------------------------------- KEY */

static void test_key_of_any_light(void **state)
{
	static const float lights[] = {0.0F,   1e-45F, 1e-40F, 1e-30F, 1e-22F, 1e-20F,
				       1e-10F, 1.0F,   1e10F,  1e20F,  1e30F,  1e37F};
	double worst = 0.0;

	(void)state;
	for (size_t k = 0; k < LP_COUNT(lights); k++)
		for (int trial = 0; trial < 30; trial++) {
			float sh[4][3], length = 0.0F;

			for (int i = 0; i < 4; i++)
				for (int c = 0; c < 3; c++)
					sh[i][c] = lights[k] *
						   (i == 0 ? 1.0F : random_normal() / 3.0F);
			const struct lp_light key = lp_key_light((const float(*)[3])sh);

			for (int a = 0; a < 3; a++)
				length += key.direction[a] * key.direction[a];
			worst = fmax(worst, fabs(sqrt((double)length) - 1.0));
			for (int c = 0; c < 3; c++)
				assert_true(key.irradiance[c] >= 0.0F &&
					    isfinite(key.irradiance[c]));
		}
	figure("wire", "KEY, light 1e-45 … 1e37", "length of its direction", worst, 1e-6);
}

/* ---------------------------------------------------------------- packets */

static uint8_t packet_bytes[LP_PACKET_MAX_BYTES];
static struct lp_packet packet = {.data = packet_bytes, .capacity_bytes = sizeof(packet_bytes)};

/* All that may be told, with eight lamps, a room, an orientation. */
static struct lp_light_estimate full_estimate(float light)
{
	struct lp_light_estimate e = {.t_capture_ns = lp_clock_ns(),
				      .sequence = UINT32_MAX,
				      .flags = UINT32_MAX & ~LP_ESTIMATE_NO_LIGHT,
				      .light_count = LP_MAX_LIGHTS,
				      .area_count = 4,
				      .relighting_sigma = 0.1F,
				      .exposure_us = 1e4F,
				      .exposure_count = 3,
				      .scale_sigma = 0.1F,
				      .cd_m2_per_unit = 100.0F,
				      .cd_m2_per_unit_sigma = 0.1F,
				      .wheel_deg = 45.0F,
				      .wheel_sigma_deg = 0.1F,
				      .orientation = {.known = true,
						      .world = true,
						      .xyzw = {0.0F, 0.0F, 0.0F, 1.0F},
						      .sigma_deg = 0.1F,
						      .has_position = true},
				      .room = {.known = true,
					       .xyzw = {0.0F, 0.0F, 0.0F, 1.0F},
					       .error_per_m = {0.1F, 0.1F, 0.1F, 0.1F, 0.1F},
					       .bare_error_per_m = {0.1F, 0.1F, 0.1F, 0.1F, 0.1F}}};

	for (int w = 0; w < 6; w++)
		e.room.walls_m[w] = e.room.walls_sigma_m[w] = 1.0F;
	for (int i = 0; i < LP_MAX_SH_COUNT; i++)
		for (int c = 0; c < 3; c++)
			e.sh_total[i][c] = light * (i == 0 ? 1.0F : 0.1F);
	for (int k = 0; k < LP_MAX_LIGHTS; k++)
		e.lights[k] = (struct lp_light){.id = UINT32_MAX,
						.direction = {0.6F, 0.8F, 0.0F},
						.axis = {0.0F, 0.0F, 1.0F},
						.irradiance = {light, light, light},
						.angular_radius_deg = 180.0F,
						.half_angle_deg = {90.0F, 90.0F},
						.direction_sigma_deg = 0.1F,
						.irradiance_sigma = 0.1F,
						.colour_sigma = 0.1F,
						.distance_m = 1.0F,
						.distance_sigma = 0.1F,
						.flags = UINT32_MAX,
						.polarization = {true, true, 1.0F, 1.0F, 180.0F,
								 0.1F, 90.0F}};
	return e;
}

static int send(const struct lp_light_estimate *estimate, struct lp_variant variant)
{
	const struct lp_stamp stamp = {.boot_id = UINT32_MAX,
				       .ttl_ms = UINT32_MAX,
				       .subscription = UINT32_MAX,
				       .t_send_ns = estimate->t_capture_ns + (INT64_C(1) << 52)};

	return lp_encode_estimate(estimate, &variant, &stamp, &packet);
}

static const struct lp_variant everything = {.key = true,
					     .world = true,
					     .sh_order = LP_MAX_SH_ORDER,
					     .lights = LP_MAX_LIGHTS};

/* Light as dim and as bright as floats are: every field at its end, in the largest packet. */
static void test_the_largest_packet(void **state)
{
	static const float lights[] = {0.0F, 1e-45F, 1e-38F, 1.0F, 1e30F, 1e36F};
	uint32_t largest = 0;

	(void)state;
	for (size_t k = 0; k < LP_COUNT(lights); k++) {
		const struct lp_light_estimate e = full_estimate(lights[k]);

		assert_int_equal(send(&e, everything), 0);
		lightprobe_v1_FromProbe message = decode_packet(&packet);

		assert_null(lp_keep_Estimate(&message.message.estimate));
		assert_int_equal(message.message.estimate.lights_count, LP_MAX_LIGHTS);
		assert_int_equal(message.message.estimate.send_delay_us, UINT32_MAX);
		largest = packet.size_bytes > largest ? packet.size_bytes : largest;
	}
	figure("wire", "largest packet", "bytes", largest, LP_PACKET_MAX_BYTES);
}

/* A sigma may be anything. However large, it does not keep the light from being told; what is not
 * known is not stated as 0. */
static void test_any_sigma_is_told(void **state)
{
	static const float sigmas[] = {0.0F,   1e-45F, 1e-3F, 90.0F,	179.0F,
				       181.0F, 1e6F,   3e38F, INFINITY, NAN};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(sigmas); k++)
		for (int field = 0; field < 16; field++) {
			struct lp_light_estimate e = full_estimate(1.0F);
			struct lp_light *light = &e.lights[0];
			float *const fields[] = {&light->direction_sigma_deg,
						 &light->irradiance_sigma,
						 &light->colour_sigma,
						 &light->distance_sigma,
						 &light->polarization.dolp_sigma,
						 &light->polarization.aolp_sigma_deg,
						 &light->polarization.reflection,
						 &light->distance_m,
						 &light->nearest_m,
						 &e.relighting_sigma,
						 &e.scale_sigma,
						 &e.cd_m2_per_unit_sigma,
						 &e.wheel_sigma_deg,
						 &e.orientation.sigma_deg,
						 &e.room.walls_sigma_m[2],
						 &e.room.bare_error_per_m[4]};

			*fields[field] = sigmas[k];
			if (send(&e, everything) != 0)
				fail_msg("field %d, %g: not sent", field, (double)sigmas[k]);
			lightprobe_v1_FromProbe message = decode_packet(&packet);
			lightprobe_v1_Estimate *const wire = &message.message.estimate;

			assert_null(lp_keep_Estimate(wire));
			if (!isnan(sigmas[k]))
				continue;
			const bool stated[] = {wire->lights[0].has_direction_sigma_deg,
					       wire->lights[0].has_irradiance_sigma_permille,
					       wire->lights[0].has_colour_sigma_permille,
					       wire->lights[0].has_distance_sigma_permille,
					       wire->lights[0].has_dolp_sigma_permille,
					       wire->lights[0].has_aolp_sigma_deg,
					       wire->lights[0].has_reflection_percent,
					       wire->lights[0].has_distance_m,
					       wire->lights[0].has_nearest_m,
					       wire->has_relighting_sigma_permille,
					       wire->has_scale_sigma_permille,
					       wire->has_cd_m2_per_unit_sigma_permille,
					       wire->has_wheel_sigma_deg,
					       wire->has_orientation_sigma_deg,
					       wire->has_room,
					       wire->has_room};

			if (stated[field])
				fail_msg("field %d is stated, and is no number", field);
		}
}

/* Light, directions and places that are no numbers are never sent. */
static void test_what_is_no_number(void **state)
{
	static const float bad[] = {NAN, INFINITY, -INFINITY};

	(void)state;
	for (int k = 0; k < 3; k++)
		for (int field = 0; field < 9; field++) {
			struct lp_light_estimate e = full_estimate(1.0F);
			float *const fields[] = {&e.lights[7].direction[0],
						 &e.lights[7].irradiance[2],
						 &e.lights[7].angular_radius_deg,
						 &e.lights[7].axis[1],
						 &e.lights[7].half_angle_deg[1],
						 &e.sh_total[24][2],
						 &e.orientation.xyzw[1],
						 &e.orientation.position_m[2],
						 &e.cd_m2_per_unit};

			*fields[field] = bad[k];
			if (send(&e, everything) != 0)
				continue;
			lightprobe_v1_FromProbe message = decode_packet(&packet);

			assert_true(field == 8);
			assert_null(lp_keep_Estimate(&message.message.estimate));
			assert_false(message.message.estimate.has_cd_m2_per_unit);
		}
}

/* The model that is chosen, and the shares that are stated, of light at its ends. */
static void test_models_of_any_light(void **state)
{
	static const float lights[] = {0.0F, 1e-45F, 1e-38F, 1e-20F, 1.0F, 1e20F, 1e36F};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(lights); k++) {
		struct lp_light_estimate e = full_estimate(lights[k]);
		double total[LP_SH_MAX_COUNT][3] = {{0.0}};
		int order, count;

		for (int i = 0; i < LP_MAX_SH_COUNT; i++)
			for (int c = 0; c < 3; c++)
				total[i][c] = e.sh_total[i][c];
		lp_model_predict((const double(*)[3])total, &e);
		ASSERT_FINITE(e.predicted_error);
		lp_model_choose(&e, LP_MAX_SH_ORDER, LP_MAX_LIGHTS, 0.01F, &order, &count);
		assert_in_range(order, 0, LP_MAX_SH_ORDER);
		assert_in_range(count, 0, LP_MAX_LIGHTS);
		for (int i = 0; i < LP_MAX_LIGHTS; i++) {
			const float share = lp_facing_share(&e, i);
			const float shadow =
				lp_shadow_strength(&e.lights[i], lp_upward_irradiance(&e));

			assert_true(share >= 0.0F && share <= 1.0F);
			assert_true(isnan(shadow) || (shadow >= 0.0F && shadow <= 1.0F));
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_texels_of_any_light),
		cmocka_unit_test(test_lamps_in_maps),
		cmocka_unit_test(test_fits),
		cmocka_unit_test(test_key_of_any_light),
		cmocka_unit_test(test_the_largest_packet),
		cmocka_unit_test(test_any_sigma_is_told),
		cmocka_unit_test(test_what_is_no_number),
		cmocka_unit_test(test_models_of_any_light),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
