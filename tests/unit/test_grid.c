/* SPDX-License-Identifier: Apache-2.0 */
#include "light/math/grid.h"

#include <errno.h>
#include <math.h>

#include "lp_test.h"

static void test_solid_angles_cover_the_sphere(void **state)
{
	const int widths[] = {16, 240, 480, 960};

	(void)state;
	for (int k = 0; k < 4; k++) {
		struct lp_grid *grid;
		double sum = 0.0;

		assert_int_equal(lp_grid_create(widths[k], widths[k] / 2, &grid), 0);
		for (int r = 0; r < grid->height; r++)
			sum += (double)grid->row_solid_angle_sr[r] * grid->width;
		assert_float_equal(sum, 4.0 * M_PI, 1e-5);
		lp_grid_destroy(grid);
	}
}

static void test_a_cell_contains_its_own_direction(void **state)
{
	struct lp_grid *grid;

	(void)state;
	assert_int_equal(lp_grid_create(240, 120, &grid), 0);
	for (int i = 0; i < 240 * 120; i++) {
		float d[3];

		lp_grid_direction(grid, i, d);
		assert_float_equal(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1.0, 1e-6);
		assert_int_equal(lp_grid_cell(grid, d), i);
	}
	/* docs/users/conventions.md: the centre is -Z, columns grow to the right (+X), row 0 is up
	 * (+Y)
	 */
	assert_int_equal(lp_grid_cell(grid, (float[]){0.001F, -0.001F, -1.0F}), 60 * 240 + 120);
	assert_int_equal(lp_grid_cell(grid, (float[]){1.0F, -0.001F, -0.001F}), 60 * 240 + 179);
	assert_true(lp_grid_cell(grid, (float[]){0.0F, 1.0F, 0.0F}) < 240);
	assert_true(lp_grid_cell(grid, (float[]){0.0F, -1.0F, 0.0F}) >= 119 * 240);
	lp_grid_destroy(grid);
}

static void test_neighbours_are_mutual_and_near(void **state)
{
	struct lp_grid *grid;

	(void)state;
	assert_int_equal(lp_grid_create(48, 24, &grid), 0);
	for (int i = 0; i < 48 * 24; i++) {
		int around[LP_NEIGHBOURS];
		float d[3];

		lp_grid_neighbours(grid, i, around);
		lp_grid_direction(grid, i, d);
		for (int k = 0; k < LP_NEIGHBOURS; k++) {
			int back[LP_NEIGHBOURS], found = 0;
			float e[3];

			assert_int_not_equal(around[k], i);
			lp_grid_neighbours(grid, around[k], back);
			for (int j = 0; j < LP_NEIGHBOURS; j++)
				found |= back[j] == i;
			assert_true(found);
			/* no neighbour is further than the diagonal of a cell at the equator */
			lp_grid_direction(grid, around[k], e);
			assert_true(d[0] * e[0] + d[1] * e[1] + d[2] * e[2] > cos(1.5 * M_PI / 24));
		}
	}
	lp_grid_destroy(grid);
}

static void test_odd_sizes_are_refused(void **state)
{
	struct lp_grid *grid;

	(void)state;
	assert_int_equal(lp_grid_create(240, 121, &grid), -EINVAL);
	assert_int_equal(lp_grid_create(8, 4, &grid), -EINVAL);
	assert_int_equal(lp_grid_create(242, 121, &grid), -EINVAL);
	assert_int_equal(lp_grid_create(1024, 512, &grid), -EINVAL);
	lp_grid_destroy(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_solid_angles_cover_the_sphere),
		cmocka_unit_test(test_a_cell_contains_its_own_direction),
		cmocka_unit_test(test_neighbours_are_mutual_and_near),
		cmocka_unit_test(test_odd_sizes_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
