/* SPDX-License-Identifier: Apache-2.0 */
/* A panorama seen from a turned frame: where its cells lie, and which are marked. */
#include "vision/map/lookup.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/panorama.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "light/turn/shear.h"
#include "lp_test.h"

/* A small grid whose half turn is no multiple of four columns, and that of the daemon. */
static const int widths[] = {20, 240};

struct turned {
	struct lp_grid *grid;
	struct lp_lookup *lookup;
	struct lp_rotation rotation;
};

static double uniform(void)
{
	return (double)rand() / RAND_MAX - 0.5;
}

static struct turned begin(int width)
{
	struct turned t;
	const double vector[3] = {6.0 * uniform(), 6.0 * uniform(), 6.0 * uniform()};

	assert_int_equal(lp_grid_create(width, width / 2, &t.grid), 0);
	assert_int_equal(lp_lookup_create(t.grid, &t.lookup), 0);
	t.rotation = lp_rotation_of_vector(vector);
	lp_lookup_set(t.lookup, &t.rotation);
	return t;
}

static void end(struct turned *t)
{
	lp_lookup_destroy(t->lookup);
	lp_grid_destroy(t->grid);
}

/* Each cell is found where the rotation takes its direction, by the plain formula. */
static void test_places(void **state)
{
	(void)state;
	for (int n = 0; n < 20; n++) {
		struct turned t = begin(widths[n % 2]);
		const int width = t.grid->width, height = t.grid->height;

		for (int i = 0; i < width * height; i++) {
			float d[3];

			lp_grid_direction(t.grid, i, d);
			lp_rotate_direction(&t.rotation, d);
			const double row = acos((double)d[1]) * height / M_PI - 0.5;
			const double column =
				(atan2(d[0], -d[2]) / (2.0 * M_PI) + 0.5) * width - 0.5;
			const int left = t.lookup->left[i], right = t.lookup->right[i];
			const double found_row = left / width + (double)t.lookup->down[i];
			const double found_column = left % width + (double)t.lookup->across[i];

			assert_true(left >= 0 && left / width <= height - 2);
			assert_int_equal(right, left / width * width + (left % width + 1) % width);
			assert_true(fabs(found_row - fmin(fmax(row, 0.0), height - 1.0)) < 5e-3);
			/* columns crowd at the poles, and float cannot tell them apart there */
			assert_true(fabs(remainder(found_column - column, width)) *
					    t.grid->row_sin[left / width] <
				    5e-3);
		}
		end(&t);
	}
}

/* Of a picture whose rows were exposed one after the other, each cell is found where the camera
 * looked while that row was. */
static void test_places_of_a_rolling_shutter(void **state)
{
	const double degree = M_PI / 180.0;

	(void)state;
	for (int n = 0; n < 10; n++) {
		struct turned t = begin(240);
		const int width = t.grid->width, cells = width * width / 2;
		float *row_share = calloc((size_t)cells, sizeof(*row_share));
		const struct lp_shear shear = {.grid = t.grid,
					       .row_share = row_share,
					       .turn = {6.0 * degree * uniform(),
							6.0 * degree * uniform(),
							6.0 * degree * uniform()}};

		for (int i = 0; i < cells; i++)
			row_share[i] = (float)((i / width + 0.5) / (width / 2.0) - 0.5);
		lp_lookup_set_sheared(t.lookup, &t.rotation, &shear);
		for (int i = 0; i < cells; i++) {
			const double down = t.lookup->left[i] / width + (double)t.lookup->down[i];
			const double across =
				t.lookup->left[i] % width + (double)t.lookup->across[i];
			const double theta = M_PI * (down + 0.5) / (width / 2.0);
			const double lambda = 2.0 * M_PI * ((across + 0.5) / width - 0.5);
			const double share = (down + 0.5) / (width / 2.0) - 0.5;
			const double turn[3] = {share * shear.turn[0], share * shear.turn[1],
						share * shear.turn[2]};
			const struct lp_rotation then = lp_rotation_of_vector(turn);
			float found[3] = {(float)(sin(theta) * sin(lambda)), (float)cos(theta),
					  (float)(-sin(theta) * cos(lambda))};
			float wanted[3];

			if (down < 0.01 || down > width / 2.0 - 1.01)
				continue; /* at a pole places are held within the grid */
			lp_rotate_direction(&then, found);
			lp_grid_direction(t.grid, i, wanted);
			lp_rotate_direction(&t.rotation, wanted);
			for (int a = 0; a < 3; a++)
				assert_float_equal(found[a], wanted[a], 0.001);
		}
		free(row_share);
		end(&t);
	}
}

/* There and back again. */
static void test_a_sheared_direction_returns(void **state)
{
	struct turned t = begin(240);
	float *row_share = calloc((size_t)240 * 120, sizeof(*row_share));
	const struct lp_shear shear = {.grid = t.grid,
				       .row_share = row_share,
				       .turn = {0.01, 0.05, -0.02}};
	const struct lp_shear none = {.grid = t.grid, .turn = {0.01, 0.05, -0.02}};

	(void)state;
	for (int i = 0; i < 240 * 120; i++)
		row_share[i] = (float)((i / 240 + 0.5) / 120.0 - 0.5);
	for (int i = 0; i < 240 * 120; i += 7) {
		float begun[3], d[3];

		lp_grid_direction(t.grid, i, begun);
		memcpy(d, begun, sizeof(d));
		lp_shear_to_middle(&none, d);
		assert_memory_equal(d, begun, sizeof(d));
		lp_shear_to_middle(&shear, d);
		lp_shear_from_middle(&shear, d);
		for (int a = 0; a < 3; a++)
			assert_float_equal(d[a], begun[a], 0.002);
	}
	free(row_share);
	end(&t);
}

/* Columns to either side that span half a row's height. */
static int reach(const struct lp_grid *grid, int row)
{
	const int columns = (int)(0.5F / grid->row_sin[row]);

	return columns < 1 ? 1 : columns < grid->width / 2 - 1 ? columns : grid->width / 2 - 1;
}

/* All marks within a row and the reach of `cell`. */
static uint8_t marks_near(const struct lp_grid *grid, const uint8_t *marks, int cell)
{
	const int width = grid->width, row = cell / width, column = cell % width;
	uint8_t all = 0;

	for (int r = row - 1; r <= row + 1; r++)
		for (int k = 0; r >= 0 && r < grid->height && k <= 2 * reach(grid, r); k++)
			all |= marks[r * width + (column - reach(grid, r) + k + width) % width];
	return all;
}

/* Those of the four cells around, all of them; beside those BESIDE, and BESIDE_DARK where one of
 * them is not seen; else none. */
static void test_marks(void **state)
{
	(void)state;
	for (int n = 0; n < 20; n++) {
		struct turned t = begin(widths[n % 2]);
		const int width = t.grid->width, cells = width * t.grid->height;
		uint8_t *from = calloc(cells, 1), *to = calloc(cells, 1);

		for (int k = 0; k < n / 2; k++) /* none at first; some at the poles */
			from[k % 3 ? rand() % cells : rand() % width] = LP_CELL_CLIPPED;
		from[cells - 1] = n > 10 ? LP_CELL_UNSEEN : 0;
		for (int k = 0; k < n / 5; k++) /* as bright as what is beside it */
			from[rand() % cells] |= LP_CELL_FILLED;
		lp_lookup_marks(t.lookup, from, to);
		for (int i = 0; i < cells; i++) {
			const int l = t.lookup->left[i], r = t.lookup->right[i];
			const int around[4] = {l, r, l + width, r + width};
			uint8_t own = 0, near = 0, beside = 0;

			for (int k = 0; k < 4; k++) {
				own |= from[around[k]];
				near |= marks_near(t.grid, from, around[k]);
			}
			if (near & ~LP_CELL_FILLED)
				beside = LP_CELL_BESIDE;
			if (near & LP_CELL_UNSEEN)
				beside |= LP_CELL_BESIDE_DARK;
			assert_int_equal(to[i], own ? own : beside);
		}
		free(to);
		free(from);
		end(&t);
	}
}

/* What is the same everywhere stays so, also where rows are averaged; and has no slope. */
static void test_an_even_picture_stays_even(void **state)
{
	(void)state;
	for (int n = 0; n < 4; n++) {
		struct turned t = begin(widths[n % 2]);
		const int cells = t.grid->width * t.grid->height;
		float(*from)[4] = calloc(cells, sizeof(*from)),
		(*to)[4] = calloc(cells, sizeof(*to));
		float *step2 = calloc(cells, sizeof(*step2));

		for (int i = 0; i < cells; i++)
			for (int c = 0; c < 4; c++)
				from[i][c] = (float)(c + 1);
		lp_lookup_radiance(t.lookup, (const float(*)[4])from, to, step2);
		for (int i = 0; i < cells; i++) {
			for (int c = 0; c < 4; c++)
				assert_float_equal(to[i][c], (float)(c + 1), 1e-5F);
			assert_float_equal(step2[i], 0.0F, 1e-9F);
		}
		free(step2);
		free(to);
		free(from);
		end(&t);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_places),
		cmocka_unit_test(test_places_of_a_rolling_shutter),
		cmocka_unit_test(test_a_sheared_direction_returns),
		cmocka_unit_test(test_marks),
		cmocka_unit_test(test_an_even_picture_stays_even),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
