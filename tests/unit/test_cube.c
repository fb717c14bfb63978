/* SPDX-License-Identifier: Apache-2.0 */
#include "light/send/cube.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "include/light_estimate.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"
#include "lp_test.h"
#include "normals.h"
#include "scene.h"
#include "vision/map/cube_sample.h"

/* Root mean square over the normals, relative to the largest irradiance on any surface. */
#define FLUX_TOLERANCE 0.005
/* The largest of them, in widths of a texel (radians): a lamp that is spread over a texel lights a
 * surface on which it should just have set. */
#define HORIZON_TOLERANCE 0.35

static const int sizes[] = {16, 32, 64};

static struct lp_cube new_cube(int size)
{
	struct lp_cube_grid *grid;
	struct lp_cube cube;

	assert_int_equal(lp_cube_grid_create(size, &grid), 0);
	cube.grid = grid;
	for (int c = 0; c < 3; c++) {
		cube.rgb[c] = aligned_alloc(16, (size_t)grid->texels * sizeof(float));
		assert_non_null(cube.rgb[c]);
		memset(cube.rgb[c], 0, (size_t)grid->texels * sizeof(float));
	}
	return cube;
}

static void free_cube(struct lp_cube *cube)
{
	for (int c = 0; c < 3; c++)
		free(cube->rgb[c]);
	lp_cube_grid_destroy((struct lp_cube_grid *)cube->grid);
}

static double irradiance(const struct lp_cube *cube, int channel, const float normal[3])
{
	double sum = 0.0;
	float d[3];

	for (int i = 0; i < cube->grid->texels; i++) {
		lp_cube_direction(cube->grid->size, i, d);
		sum += (double)cube->rgb[channel][i] * cube->grid->solid_angle_sr[i] *
		       cosine(d, normal);
	}
	return sum;
}

struct errors {
	double rms, most; /* of the irradiance, relative to the largest one expected */
};

static struct errors errors_of(const struct lp_cube *cube, int channel,
			       double (*expected)(const float normal[3]))
{
	double sum = 0.0, most = 0.0, largest = 0.0;
	float n[3];

	for (int k = 0; k < NORMALS; k++) {
		normal_of(k, n);
		const double off = fabs(irradiance(cube, channel, n) - expected(n));

		sum += off * off;
		most = fmax(most, off);
		largest = fmax(largest, expected(n));
	}
	return (struct errors){.rms = sqrt(sum / NORMALS) / largest, .most = most / largest};
}

/* ---------------------------------------------------------------- geometry */

static void test_grid(void **state)
{
	struct lp_cube_grid *grid;

	(void)state;
	assert_int_equal(lp_cube_grid_create(0, &grid), -EINVAL);
	assert_int_equal(lp_cube_grid_create(48, &grid), -EINVAL);
	assert_int_equal(lp_cube_grid_create(128, &grid), -EINVAL);
	lp_cube_grid_destroy(NULL);
	for (unsigned int k = 0; k < LP_COUNT(sizes); k++) {
		double sphere = 0.0;
		float d[3];

		assert_int_equal(lp_cube_grid_create(sizes[k], &grid), 0);
		for (int i = 0; i < grid->texels; i++) {
			sphere += grid->solid_angle_sr[i];
			lp_cube_direction(sizes[k], i, d);
			assert_int_equal(lp_cube_texel(sizes[k], d), i);
			assert_float_equal(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1.0, 1e-6);
		}
		assert_float_equal(sphere, 4.0 * M_PI, 1e-5);
		lp_cube_grid_destroy(grid);
	}
}

/*
 * OpenGL 4.6, table 8.19: with sc, tc, ma of the major axis, s = (sc / |ma| + 1) / 2 is the column
 * and t = (tc / |ma| + 1) / 2 the row. Written down once more, from there.
 */
static void test_faces_are_those_of_opengl(void **state)
{
	const int size = 32;
	float d[3];

	(void)state;
	for (int i = 0; i < LP_CUBE_TEXELS(size); i++) {
		lp_cube_direction(size, i, d);
		const float x = d[0], y = d[1], z = d[2];
		const float ax = fabsf(x), ay = fabsf(y), az = fabsf(z);
		int face;
		float sc, tc, ma;

		if (ax > ay && ax > az) {
			face = x > 0 ? 0 : 1;
			sc = x > 0 ? -z : z;
			tc = -y;
			ma = ax;
		} else if (ay > az) {
			face = y > 0 ? 2 : 3;
			sc = x;
			tc = y > 0 ? z : -z;
			ma = ay;
		} else {
			face = z > 0 ? 4 : 5;
			sc = z > 0 ? x : -x;
			tc = -y;
			ma = az;
		}
		assert_int_equal(i / (size * size), face);
		assert_float_equal((sc / ma + 1) / 2 * size, (i % size) + 0.5, 1e-4);
		assert_float_equal((tc / ma + 1) / 2 * size, (i / size % size) + 0.5, 1e-4);
	}
}

/* ---------------------------------------------------------------- lights */

static struct lp_light lamp_at(float x, float y, float z, float radius_deg)
{
	const float length = sqrtf(x * x + y * y + z * z);

	return (struct lp_light){.direction = {x / length, y / length, z / length},
				 .angular_radius_deg = radius_deg};
}

static struct lp_light lamp; /* of lit_by_lamp() */

/* By many points of its disc: a wide lamp sets slowly. */
static double lit_by_lamp(const float normal[3])
{
	const double radius = lamp.angular_radius_deg * M_PI / 180.0;
	const float *const d = lamp.direction;
	const int least = fabsf(d[0]) < 0.6F ? 0 : 1;
	double sum = 0.0, x[3], y[3];

	for (int a = 0; a < 3; a++)
		x[a] = ((a == least) - d[least] * d[a]) / sqrt(1.0 - d[least] * d[least]);
	for (int a = 0; a < 3; a++)
		y[a] = d[(a + 1) % 3] * x[(a + 2) % 3] - d[(a + 2) % 3] * x[(a + 1) % 3];
	for (int k = 0; k < 1600; k++) {
		const double off = radius * sqrt((k / 40 + 0.5) / 40.0);
		const double turn = 2.0 * M_PI * (k % 40 + 0.5) / 40.0;
		float point[3];

		for (int a = 0; a < 3; a++)
			point[a] = (float)(cos(off) * d[a] +
					   sin(off) * (cos(turn) * x[a] + sin(turn) * y[a]));
		sum += 2.0 * cosine(point, normal);
	}
	return sum / 1600.0;
}

/* At a pole, a face's edge, a corner, and anywhere; small and as wide as lamps are. */
static void test_lamps_keep_flux_and_place(void **state)
{
	const float places[][3] = {{0, 1, 0},	{0, -1, 0},	  {0, 0, -1},	     {1, 1, 0},
				   {0, -1, -1}, {-1, 0, 1},	  {1, 1, 1},	     {-1, -1, 1},
				   {1, -1, -1}, {.3F, .5F, -.4F}, {-.9F, .05F, .86F}};
	const float radii_deg[] = {0.0F, 0.27F, 3.0F, 6.9F};

	(void)state;
	for (unsigned int s = 0; s < LP_COUNT(sizes); s++)
		for (unsigned int p = 0; p < LP_COUNT(places); p++)
			for (unsigned int r = 0; r < LP_COUNT(radii_deg); r++) {
				struct lp_cube cube = new_cube(sizes[s]);

				lamp = lamp_at(places[p][0], places[p][1], places[p][2],
					       radii_deg[r]);
				lp_cube_add_light(&cube, &lamp, (const float[]){1, 2, 4});
				const struct errors e = errors_of(&cube, 1, lit_by_lamp);

				assert_true(e.rms < FLUX_TOLERANCE * 32.0 / fmin(sizes[s], 32));
				assert_true(e.most < HORIZON_TOLERANCE * M_PI / 2 / sizes[s]);
				/* nothing is lost, whatever face it fell on */
				double sh[LP_CUBE_BANDS][3] = {{0.0}};

				lp_cube_project(&cube, 1.0, sh);
				for (int c = 0; c < 3; c++)
					assert_float_equal(sh[0][c] * sqrt(4.0 * M_PI), (1 << c),
							   1e-4);
				free_cube(&cube);
			}
}

static void test_light_is_taken_where_it_is(void **state)
{
	struct lp_light window = lamp_at(0, 0, -1, 0);
	struct lp_cube cube = new_cube(32);
	double sh[LP_CUBE_BANDS][3] = {{0.0}};
	float d[3];

	(void)state;
	window.flags = LP_LIGHT_EXTENDED;
	window.half_angle_deg[0] = 30;
	window.half_angle_deg[1] = 10;
	window.axis[0] = 1;
	for (int c = 0; c < 3; c++)
		for (int i = 0; i < cube.grid->texels; i++)
			cube.rgb[c][i] = 1.0F;
	lp_cube_take_light(&cube, &window, (const float[]){0.1F, 0.2F, 1e9F});
	lp_cube_project(&cube, sqrt(4.0 * M_PI), sh);
	assert_float_equal(sh[0][0], 4 * M_PI - 0.1, 1e-4);
	assert_float_equal(sh[0][1], 4 * M_PI - 0.2, 1e-4);
	for (int i = 0; i < cube.grid->texels; i++) {
		lp_cube_direction(32, i, d);
		const bool inside = d[2] < 0 && fabsf(d[0]) < 0.3F && fabsf(d[1]) < 0.1F;
		const bool outside = d[2] > 0 || fabsf(d[0]) > 0.6F || fabsf(d[1]) > 0.3F;

		if (inside)
			assert_true(cube.rgb[0][i] < 1.0F && cube.rgb[2][i] == 0.0F);
		if (outside)
			assert_true(cube.rgb[0][i] == 1.0F && cube.rgb[2][i] == 1.0F);
	}
	free_cube(&cube);
}

/* ---------------------------------------------------------------- panorama */

static const struct lp_rotation straight = {.m = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

/* A sky that has one formula for its radiance and another for its irradiance. */
static float gradient(const float d[3], int channel)
{
	const float g[3][3] = {{0.2F, 0.7F, -0.3F}, {0, 0.9F, 0}, {-0.5F, 0.1F, 0.6F}};

	return 1.0F + g[channel][0] * d[0] + g[channel][1] * d[1] + g[channel][2] * d[2];
}

static double lit_by_gradient(const float normal[3])
{
	return M_PI *
	       (1.0 + 0.2 * 2 / 3 * normal[0] + 0.7 * 2 / 3 * normal[1] - 0.3 * 2 / 3 * normal[2]);
}

static struct lp_panorama paint(const struct lp_grid *grid, float (*sky)(const float d[3], int c))
{
	struct lp_panorama p = new_panorama(grid->width);
	float d[3];

	for (int i = 0; i < grid->width * grid->height; i++) {
		lp_grid_direction(grid, i, d);
		for (int c = 0; c < 3; c++)
			p.cells[i][c] = sky(d, c);
	}
	return p;
}

static void test_panorama_lies_where_it_looks(void **state)
{
	const struct lp_rotation turn = lp_rotation_of_vector((const double[]){0.4, -1.1, 2.0});
	struct lp_grid *grid;

	(void)state;
	assert_int_equal(lp_grid_create(240, 120, &grid), 0);
	struct lp_panorama p = paint(grid, gradient);

	for (unsigned int s = 0; s < LP_COUNT(sizes); s++)
		for (int turned = 0; turned < 2; turned++) {
			const struct lp_rotation *const rotation = turned ? &turn : &straight;
			struct lp_cube cube = new_cube(sizes[s]);
			float d[3];

			lp_cube_sample(grid, (const float(*)[4])p.cells, rotation, cube.grid->size,
				       cube.rgb);
			for (int i = 0; i < cube.grid->texels; i++) {
				lp_cube_direction(sizes[s], i, d);
				lp_rotate_direction(rotation, d);
				for (int c = 0; c < 3; c++)
					assert_float_equal(cube.rgb[c][i], gradient(d, c), 0.004);
			}
			if (!turned)
				assert_true(errors_of(&cube, 0, lit_by_gradient).most <
					    FLUX_TOLERANCE);
			free_cube(&cube);
		}
	free_panorama(&p);
	lp_grid_destroy(grid);
}

static void test_shrunk_is_as_sampled(void **state)
{
	struct lp_cube fine = new_cube(64), small = new_cube(16), coarse = new_cube(16);
	struct lp_grid *grid;

	(void)state;
	assert_int_equal(lp_grid_create(240, 120, &grid), 0);
	struct lp_panorama p = paint(grid, gradient);

	lp_cube_sample(grid, (const float(*)[4])p.cells, &straight, fine.grid->size, fine.rgb);
	lp_cube_sample(grid, (const float(*)[4])p.cells, &straight, coarse.grid->size, coarse.rgb);
	lp_cube_shrink(&fine, &small);
	for (int c = 0; c < 3; c++)
		for (int i = 0; i < small.grid->texels; i++)
			assert_float_equal(small.rgb[c][i], coarse.rgb[c][i], 1e-3);
	free_cube(&fine);
	free_cube(&small);
	free_cube(&coarse);
	free_panorama(&p);
	lp_grid_destroy(grid);
}

/* ---------------------------------------------------------------- fit */

/* Coefficients of the gradient, in red, with all three channels alike. */
static void gradient_sh(double scale, double sh[LP_CUBE_BANDS][3])
{
	const double band1 = sqrt(4.0 * M_PI / 3.0);

	memset(sh, 0, LP_CUBE_BANDS * sizeof(*sh));
	for (int c = 0; c < 3; c++) {
		sh[0][c] = scale * sqrt(4.0 * M_PI);
		sh[1][c] = scale * 0.7 * band1;
		sh[2][c] = scale * -0.3 * band1;
		sh[3][c] = scale * 0.2 * band1;
	}
}

static double worst_fit(const struct lp_cube *cube, const double (*wanted)[3])
{
	double sh[LP_CUBE_BANDS][3] = {{0.0}}, worst = 0.0;

	lp_cube_project(cube, 1.0, sh);
	for (int c = 0; c < 3; c++)
		for (int k = 0; k < LP_CUBE_BANDS; k++)
			worst = fmax(worst, fabs(sh[k][c] - wanted[k][c]) / fabs(wanted[0][c]));
	return worst;
}

/* Checks and stripes that are brighter or darker by 30 times, whatever light they are fitted to. */
static void test_fit_holds_to_the_coefficients(void **state)
{
	double wanted[LP_CUBE_BANDS][3];

	(void)state;
	for (unsigned int s = 0; s < LP_COUNT(sizes); s++)
		for (double scale = 1e-6; scale < 2e6; scale *= 1e3)
			for (double off = 0.1; off < 10.0; off *= 3.0) {
				struct lp_cube cube = new_cube(sizes[s]);

				for (int c = 0; c < 3; c++)
					for (int i = 0; i < cube.grid->texels; i++)
						cube.rgb[c][i] = (float)(scale * off) *
								 (i / 7 % 3 == c ? 30.0F : 1.0F);
				gradient_sh(scale, wanted);
				lp_cube_fit(&cube, (const double(*)[3])wanted);
				assert_true(worst_fit(&cube, (const double(*)[3])wanted) < 1e-3);
				for (int i = 0; i < cube.grid->texels; i++)
					assert_true(cube.rgb[0][i] > 0.0F);
				free_cube(&cube);
			}
}

/* Light that the cube knows nothing of lies all around; without light it is black. */
static void test_fit_of_the_dark(void **state)
{
	double wanted[LP_CUBE_BANDS][3] = {{0.0}};
	struct lp_cube cube = new_cube(16);

	(void)state;
	lp_cube_fit(&cube, (const double(*)[3])wanted);
	for (int i = 0; i < cube.grid->texels; i++)
		assert_true(cube.rgb[0][i] == 0.0F);
	gradient_sh(3.0, wanted);
	lp_cube_fit(&cube, (const double(*)[3])wanted);
	assert_true(worst_fit(&cube, (const double(*)[3])wanted) < 1e-3);
	for (int c = 0; c < 3; c++)
		wanted[0][c] = -1.0; /* more was taken than there was */
	lp_cube_fit(&cube, (const double(*)[3])wanted);
	for (int i = 0; i < cube.grid->texels; i++)
		assert_true(cube.rgb[1][i] == 0.0F);
	free_cube(&cube);
}

/* ---------------------------------------------------------------- RGB9E5 */

static void decode(const uint8_t *texel, float scale, float rgb[3])
{
	const uint32_t bits = texel[0] | texel[1] << 8 | texel[2] << 16 | (uint32_t)texel[3] << 24;

	for (int c = 0; c < 3; c++)
		rgb[c] = scale * ldexpf((float)(bits >> (9 * c) & 511), (int)(bits >> 27) - 15 - 9);
}

/* From starlight to the sun, within one cube. */
static void test_texels_keep_eight_bits_over_a_huge_range(void **state)
{
	struct lp_cube cube = new_cube(16);
	uint8_t *texels = malloc(4 * LP_CUBE_TEXELS(16));
	float rgb[3];

	(void)state;
	srand(3);
	for (int i = 0; i < cube.grid->texels; i++)
		for (int c = 0; c < 3; c++)
			cube.rgb[c][i] = powf(10.0F, (float)(rand() % 900) / 100.0F - 3.0F);
	cube.rgb[0][5] = cube.rgb[1][5] = cube.rgb[2][5] = 0.0F;
	cube.rgb[1][9] = -1.0F;
	cube.rgb[2][9] = 511.6F; /* rounds up to the next power of 2 */
	const float scale = lp_cube_encode(&cube, texels);

	assert_true(scale > 0.0F);
	for (int i = 0; i < cube.grid->texels; i++) {
		const float most = fmaxf(fmaxf(cube.rgb[0][i], cube.rgb[1][i]), cube.rgb[2][i]);

		decode(texels + 4 * (size_t)i, scale, rgb);
		for (int c = 0; c < 3; c++)
			assert_true(fabsf(rgb[c] - fmaxf(cube.rgb[c][i], 0.0F)) <=
				    most / 512.0F * 1.0001F + scale * ldexpf(1.0F, -25));
	}
	free(texels);
	free_cube(&cube);
}

static void test_encoding_ends(void **state)
{
	const float extremes[] = {0.0F, 1e-38F, 1e-6F, 1.0F, 65408.0F, 1e6F, 1e38F};
	struct lp_cube cube = new_cube(16);
	uint8_t *texels = malloc(4 * LP_CUBE_TEXELS(16));
	float rgb[3];

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(extremes); k++) {
		cube.rgb[1][77] = extremes[k];
		const float scale = lp_cube_encode(&cube, texels);

		decode(texels + 4 * 77, scale, rgb);
		assert_true(fabsf(rgb[1] - extremes[k]) <= extremes[k] / 512.0F);
		assert_true(rgb[0] == 0.0F);
	}
	cube.rgb[1][77] = NAN;
	assert_true(lp_cube_encode(&cube, texels) == -1.0F);
	cube.rgb[1][77] = INFINITY;
	assert_true(lp_cube_encode(&cube, texels) == -1.0F);
	free(texels);
	free_cube(&cube);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_grid),
		cmocka_unit_test(test_faces_are_those_of_opengl),
		cmocka_unit_test(test_lamps_keep_flux_and_place),
		cmocka_unit_test(test_light_is_taken_where_it_is),
		cmocka_unit_test(test_panorama_lies_where_it_looks),
		cmocka_unit_test(test_shrunk_is_as_sampled),
		cmocka_unit_test(test_fit_holds_to_the_coefficients),
		cmocka_unit_test(test_fit_of_the_dark),
		cmocka_unit_test(test_texels_keep_eight_bits_over_a_huge_range),
		cmocka_unit_test(test_encoding_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
