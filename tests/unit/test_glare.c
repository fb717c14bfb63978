/* SPDX-License-Identifier: Apache-2.0 */
/* Veiling glare: how light is spread, and that no lens loses or makes any. */
#include "vision/glare/glare.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "include/panorama.h"
#include "light/math/grid.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera.h"
#include "vision/glare/spread.h"
#include "vision/map/radiance_map.h"
#include "vision/map/residual.h"

#define WIDTH 240
#define CELLS (WIDTH * WIDTH / 2)

static void node_direction(int node, double d[3])
{
	const double t = M_PI * (node / LP_VEIL_WIDTH + 0.5) / LP_VEIL_HEIGHT;
	const double l = 2.0 * M_PI * ((node % LP_VEIL_WIDTH + 0.5) / LP_VEIL_WIDTH - 0.5);

	d[0] = sin(t) * sin(l);
	d[1] = cos(t);
	d[2] = -sin(t) * cos(l);
}

/* Against the sum over all pairs of nodes, of any light. */
static void test_spread_is_the_sum_over_all(void **state)
{
	static const float widths_deg[] = {1.0F, 10.0F, 90.0F};
	static float from[LP_VEIL_NODES][4], to[LP_VEIL_NODES][4];

	(void)state;
	srand(3);
	for (int n = 0; n < LP_VEIL_NODES; n++)
		for (int c = 0; c < 4; c++)
			from[n][c] = (float)(rand() % 1000) / 1000.0F;
	for (size_t k = 0; k < LP_COUNT(widths_deg); k++) {
		struct lp_spread *spread;

		assert_int_equal(lp_spread_create(widths_deg[k], &spread), 0);
		lp_spread_apply(spread, (const float(*)[4])from, to);
		for (int i = 0; i < LP_VEIL_NODES; i += 37) {
			double a[3], b[3], sum[4] = {0.0};

			node_direction(i, a);
			for (int j = 0; j < LP_VEIL_NODES; j++) {
				node_direction(j, b);
				const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
				const double angle_deg =
					acos(fmin(fmax(dot, -1.0), 1.0)) / TEST_DEG;
				const double gain =
					pow(1.0 + pow(angle_deg / (double)widths_deg[k], 2.0),
					    -1.5);

				for (int c = 0; c < 4; c++)
					sum[c] += gain * (double)from[j][c];
			}
			for (int c = 0; c < 4; c++)
				assert_float_equal(to[i][c] / sum[c], 1.0, 2e-4);
		}
		lp_spread_destroy(spread);
	}
	lp_spread_destroy(NULL);
}

/* Cameras of every kind: a panorama, a part of one, one lens, two lenses. */
static struct lp_camera *new_camera(int kind)
{
	struct lp_camera *camera;

	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	camera->glare = (struct lp_glare_shares){0.05F, 0.1F, 10.0F};
	if (kind == 1)
		camera->crop = (struct lp_crop){0.25F, 0.25F, 0.5F, 0.5F};
	if (kind < 2)
		return camera;
	camera->projection = LP_FISHEYE;
	camera->width_px = 800;
	camera->height_px = 400;
	camera->lens_count = kind - 1;
	for (int k = 0; k < camera->lens_count; k++) {
		const float sign = k ? -1.0F : 1.0F;

		camera->lens[k] = (struct lp_lens){.cx_px = 200.0F + 400.0F * (float)k,
						   .cy_px = 200.0F,
						   .fx_px = 110.0F,
						   .fy_px = 110.0F,
						   .max_theta_rad = 1.7F};
		camera->lens[k].rotation[0][0] = camera->lens[k].rotation[2][2] = sign;
		camera->lens[k].rotation[1][1] = 1.0F;
	}
	return camera;
}

/* A picture before an empty map. */
struct look {
	struct lp_grid *grid;
	struct lp_radiance_map *map;
	float (*cells)[4];
	uint8_t *flags;
	struct lp_glare *glare;
};

static struct look look_through(const struct lp_camera *camera)
{
	struct look l;

	assert_int_equal(lp_grid_create(WIDTH, WIDTH / 2, &l.grid), 0);
	assert_int_equal(lp_radiance_map_create(l.grid, &l.map), 0);
	assert_int_equal(lp_glare_create(camera, WIDTH, &l.glare), 0);
	l.cells = calloc(CELLS + 16, sizeof(*l.cells));
	l.flags = calloc(CELLS + 16, 1);
	for (int i = 0; i < CELLS; i++) {
		float direction[3];
		double d[3], pixel[2], share, illumination;
		bool sees = false;

		lp_grid_direction(l.grid, i, direction);
		for (int a = 0; a < 3; a++)
			d[a] = (double)direction[a];
		for (int k = 0; k < camera->lens_count; k++)
			sees |= lp_camera_project(camera, k, 800, 400, d, pixel, &share,
						  &illumination);
		l.flags[i] = sees ? 0 : LP_CELL_UNSEEN;
	}
	return l;
}

static void set(struct look *l, int cell, float light)
{
	for (int c = 0; c < 4; c++)
		l->cells[cell][c] = l->flags[cell] ? 0.0F : light;
}

static void spread(struct look *l)
{
	const struct lp_residual frame = {.map = l->map,
					  .seen = {.radiance = (const float(*)[4])l->cells,
						   .flags = l->flags,
						   .scale = 1.0F}};

	lp_glare_look(l->glare, &frame, NULL);
}

static void end(struct look *l)
{
	lp_glare_destroy(l->glare);
	lp_radiance_map_destroy(l->map);
	lp_grid_destroy(l->grid);
	free(l->flags);
	free(l->cells);
}

static double light_of(const struct look *l)
{
	double sum = 0.0;

	for (int i = 0; i < CELLS; i++)
		sum += (double)l->cells[i][1] * (double)lp_grid_solid_angle_sr(l->grid, i);
	return sum;
}

/* Even light stays even: what a lens spreads it gets back. */
static void test_even_light_stays_even(void **state)
{
	(void)state;
	for (int kind = 0; kind < 4; kind++) {
		struct lp_camera *camera = new_camera(kind);
		struct look l = look_through(camera);

		for (int i = 0; i < CELLS; i++)
			set(&l, i, 2.0F);
		spread(&l);
		lp_glare_take_off(l.glare, (const float(*)[4])l.cells, l.flags, 0.0F, l.cells);
		/* at the rim of a picture nodes are seen in part */
		for (int i = 0; i < CELLS; i += 11)
			if (!l.flags[i])
				assert_float_equal(l.cells[i][1], 2.0, kind ? 0.06 : 0.006);
		assert_float_equal(l.glare->allowed, 1.0, 0.0);
		end(&l);
		lp_camera_destroy(camera);
	}
}

/* A lamp's veil is its share of light, in all; and largest around it. */
static void test_a_lamp_is_spread_and_nothing_is_lost(void **state)
{
	(void)state;
	for (int kind = 0; kind < 4; kind++) {
		struct lp_camera *camera = new_camera(kind);
		struct look l = look_through(camera);
		const int lamp = 58 * WIDTH + 118, far = 50 * WIDTH + 85;
		float near[4], away[4];
		float direction[3];

		for (int i = 0; i < CELLS; i++)
			set(&l, i, i == lamp ? 1000.0F : 0.0F);
		const double light = light_of(&l);

		spread(&l);
		lp_grid_direction(l.grid, lamp, direction);
		lp_glare_at(l.glare, direction, near);
		lp_grid_direction(l.grid, far, direction);
		lp_glare_at(l.glare, direction, away);
		assert_true(near[1] > 3.0F * away[1] && away[1] > 0.0F);
		double veil = 0.0;

		for (int i = 0; i < CELLS; i++) {
			float at[4];

			if (l.flags[i])
				continue;
			lp_grid_direction(l.grid, i, direction);
			lp_glare_at(l.glare, direction, at);
			veil += (double)at[1] * (double)lp_grid_solid_angle_sr(l.grid, i);
		}
		assert_float_equal(veil / light, 0.15, 0.012);
		end(&l);
		lp_camera_destroy(camera);
	}
}

/* A tenth of the picture is too dark for the veil: so much less is believed, and told by sigma. */
static void test_darkness_contradicts(void **state)
{
	struct lp_camera *camera = new_camera(0);
	struct look l = look_through(camera);
	float *picture = calloc(CELLS + 16, sizeof(*l.cells));

	(void)state;
	camera->glare.around = 0.0F;
	for (int round = 0; round < 4; round++) {
		for (int i = 0; i < CELLS; i++)
			set(&l, i, i / WIDTH < 12 ? 0.02F : 1.0F);
		memcpy(picture, l.cells, CELLS * sizeof(*l.cells));
		spread(&l);
		lp_glare_take_off(l.glare, (const float(*)[4])picture, l.flags, 0.0F, l.cells);
	}
	assert_true(l.glare->believed < 0.5F && l.glare->believed > 0.05F);
	assert_true(l.glare->sigma > 0.05F);
	for (int i = 0; i < CELLS; i++)
		assert_true(l.cells[i][1] >= 0.0F);
	free(picture);
	end(&l);
	lp_camera_destroy(camera);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_spread_is_the_sum_over_all),
		cmocka_unit_test(test_even_light_stays_even),
		cmocka_unit_test(test_a_lamp_is_spread_and_nothing_is_lost),
		cmocka_unit_test(test_darkness_contradicts),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
