/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/sh_project.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "light/math/sh.h"
#include "lp_test.h"
#include "scene.h"

static const int widths[] = {16, 48, 240, 480, 960};

/* White furnace: a uniform sphere gives its radiance and nothing else, at any scale. */
static void test_white_furnace(void **state)
{
	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(widths); k++)
		for (float level = 1e-6F; level < 1e7F; level *= 1e4F) {
			struct lp_panorama p = new_panorama(widths[k]);
			struct lp_sh_projector *projector;
			double sh[LP_SH_MAX_COUNT][3];

			for (int i = 0; i < p.width * p.height; i++)
				for (int c = 0; c < 4; c++)
					p.cells[i][c] = level;
			assert_int_equal(lp_sh_projector_create(p.width, p.height, 8, &projector),
					 0);
			lp_sh_project(projector, &p, 8, sh);
			for (int c = 0; c < 3; c++)
				assert_float_equal(sh[0][c] / level / sqrt(4.0 * M_PI), 1.0, 3e-6);
			for (int i = 1; i < LP_SH_MAX_COUNT; i++)
				assert_float_equal(sh[i][1] / level, 0.0, 1e-5);
			lp_sh_projector_destroy(projector);
			free_panorama(&p);
		}
}

/* Random cells against 3 x 3 Gauss-Legendre quadrature of the basis over each cell. */
static void test_against_quadrature(void **state)
{
	const double node[3] = {-0.7745966692414834, 0.0, 0.7745966692414834};
	const double weight[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
	struct lp_panorama p = new_panorama(48);
	struct lp_sh_projector *projector;
	double sh[LP_SH_MAX_COUNT][3], expected[LP_SH_MAX_COUNT][3] = {{0.0}}, largest = 0.0;

	(void)state;
	srand(5);
	for (int i = 0; i < p.width * p.height; i++)
		for (int c = 0; c < 3; c++)
			p.cells[i][c] = (float)(rand() % 1000) * (i % 11 ? 1.0F : 100.0F);
	for (int i = 0; i < p.width * p.height; i++)
		for (int s = 0; s < 9; s++) {
			const double t = M_PI * (i / p.width + 0.5 + 0.5 * node[s / 3]) / p.height;
			const double l = 2 * M_PI *
					 ((i % p.width + 0.5 + 0.5 * node[s % 3]) / p.width - 0.5);
			const double d[3] = {sin(t) * sin(l), cos(t), -sin(t) * cos(l)};
			const double w = weight[s / 3] * weight[s % 3] * sin(t) * M_PI / p.height *
					 2 * M_PI / p.width;
			double y[LP_SH_MAX_COUNT];

			lp_sh_basis(8, d, y);
			for (int k = 0; k < LP_SH_MAX_COUNT; k++)
				for (int c = 0; c < 3; c++)
					expected[k][c] += w * y[k] * p.cells[i][c];
		}
	assert_int_equal(lp_sh_projector_create(p.width, p.height, 8, &projector), 0);
	for (int order = 0; order <= 8; order++) {
		lp_sh_project(projector, &p, order, sh);
		for (int k = 0; k < (order + 1) * (order + 1); k++)
			for (int c = 0; c < 3; c++) {
				largest = fmax(largest, fabs(expected[k][c]));
				assert_float_equal(sh[k][c], expected[k][c], 2e-6 * largest);
			}
	}
	lp_sh_projector_destroy(projector);
	free_panorama(&p);
}

/* One bright cell is a lamp where that cell is: seam and poles included. */
static void test_one_cell(void **state)
{
	struct lp_panorama p = new_panorama(240);
	struct lp_sh_projector *projector;
	const int cells[] = {0, 239, 119 * 240, 60 * 240, 60 * 240 + 239, 60 * 240 + 120, 12345};

	(void)state;
	assert_int_equal(lp_sh_projector_create(240, 120, 8, &projector), 0);
	for (unsigned int k = 0; k < LP_COUNT(cells); k++) {
		const int row = cells[k] / 240, column = cells[k] % 240;
		const double t = M_PI * (row + 0.5) / 120,
			     l = 2 * M_PI * ((column + 0.5) / 240 - 0.5);
		const double d[3] = {sin(t) * sin(l), cos(t), -sin(t) * cos(l)};
		const double omega =
			2 * M_PI / 240 * (cos(M_PI * row / 120) - cos(M_PI * (row + 1) / 120));
		double sh[LP_SH_MAX_COUNT][3], y[LP_SH_MAX_COUNT];

		p.cells[cells[k]][1] = 1e5F;
		lp_sh_project(projector, &p, 8, sh);
		lp_sh_basis(8, d, y);
		for (int i = 0; i < LP_SH_MAX_COUNT;
		     i++) /* a cell is no point: and at a pole its middle is not its centre */
			assert_float_equal(sh[i][1] / (1e5 * omega), y[i], 0.02);
		p.cells[cells[k]][1] = 0.0F;
	}
	lp_sh_projector_destroy(projector);
	free_panorama(&p);
}

static void test_bad_sizes(void **state)
{
	struct lp_sh_projector *projector;

	(void)state;
	assert_int_equal(lp_sh_projector_create(20, 10, 4, &projector), -EINVAL);
	assert_int_equal(lp_sh_projector_create(0, 0, 4, &projector), -EINVAL);
	assert_int_equal(lp_sh_projector_create(16, 8, 9, &projector), -EINVAL);
	assert_int_equal(lp_sh_projector_create(16, 8, -1, &projector), -EINVAL);
	lp_sh_projector_destroy(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_white_furnace),
		cmocka_unit_test(test_against_quadrature),
		cmocka_unit_test(test_one_cell),
		cmocka_unit_test(test_bad_sizes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
