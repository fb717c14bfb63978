/* SPDX-License-Identifier: Apache-2.0 */
/* A mirror ball: against rays that are traced to it, and as a camera. */
#include "vision/ball/ball.h"

#include <errno.h>
#include <math.h>

#include "include/panorama.h"
#include "lp_test.h"
#include "camera_file_test.h"
#include "scene.h"
#include "vision/camera/camera.h"
#include "vision/camera/remap.h"
#include "vision/picture/cells.h"

static const struct lp_pinhole straight = {320.0, 240.0, 800.0, 810.0, {0.0}};
static const struct lp_pinhole bent = {330.0, 235.0, 800.0, 810.0, {-0.2, 0.05, 1e-3, -2e-3, 0.01}};
static const double centre[3] = {20.0, -15.0, -240.0};
static const double radius = 30.0;

static struct lp_ball new_ball(const struct lp_pinhole *pinhole)
{
	struct lp_ball ball;

	assert_true(lp_ball_init(&ball, pinhole, centre, radius, 1.0));
	ball.index = 1.5;
	return ball;
}

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Where a straight camera's ray comes from, by the sphere's equation and the law of the mirror. */
static bool traced(double x, double y, double direction[3], double *cosine)
{
	double ray[3] = {(x - straight.cx_px) / straight.fx_px,
			 -(y - straight.cy_px) / straight.fy_px, -1.0};
	const double length = sqrt(dot(ray, ray));
	double normal[3];

	for (int a = 0; a < 3; a++)
		ray[a] /= length;
	const double b = dot(ray, centre), under = b * b - dot(centre, centre) + radius * radius;

	if (under < 0.0)
		return false;
	for (int a = 0; a < 3; a++)
		normal[a] = ((b - sqrt(under)) * ray[a] - centre[a]) / radius;
	*cosine = -dot(ray, normal);
	for (int a = 0; a < 3; a++)
		direction[a] = ray[a] + 2.0 * *cosine * normal[a];
	return true;
}

static void test_rays_are_those_of_the_law_of_the_mirror(void **state)
{
	const struct lp_ball ball = new_ball(&straight);
	int seen = 0, hit = 0;

	(void)state;
	for (int k = 0; k < 640 * 480; k++) {
		const double x = k % 640 + 0.5, y = (k / 640) + 0.5;
		double d[3], true_d[3], pixel[2], cosine, reflectance;

		hit += traced(x, y, true_d, &cosine);
		if (!lp_ball_ray(&ball, &straight, x, y, d))
			continue;
		seen++;
		assert_true(traced(x, y, true_d, &cosine));
		for (int a = 0; a < 3; a++)
			assert_float_equal(d[a], true_d[a], 1e-9);
		assert_true(lp_ball_project(&ball, &straight, d, pixel, &reflectance));
		assert_float_equal(pixel[0], x, 1e-6);
		assert_float_equal(pixel[1], y, 1e-6);
		assert_float_equal(reflectance, lp_ball_reflectance(1.5, 0.0, cosine), 1e-9);
	}
	/* about 100 pixels of radius, of which the outermost is not used */
	assert_in_range(hit, 31000, 34000);
	assert_float_equal((double)seen / hit, 0.98, 0.004);
}

static void test_a_lens_that_distorts(void **state)
{
	const struct lp_ball ball = new_ball(&bent);

	(void)state;
	for (int k = 0; k < 500; k++) {
		const double y = 1.0 - (k + 0.5) / 250.0, s = sqrt(1.0 - y * y);
		const double d[3] = {s * cos(2.4 * k), y, s * sin(2.4 * k)};
		double pixel[2], reflectance, back[3];

		if (!lp_ball_project(&ball, &bent, d, pixel, &reflectance))
			continue;
		assert_true(lp_ball_ray(&ball, &bent, pixel[0], pixel[1], back) ||
			    lp_ball_sigma_deg(&ball, d) >= 0.0);
		for (int a = 0; a < 3; a++)
			assert_float_equal(back[a], d[a], 1e-7);
	}
}

/* All pixels together mirror all but the cone behind the ball. */
static void test_solid_angles_add_up(void **state)
{
	const struct lp_ball ball = new_ball(&straight);
	const double incidence = asin(ball.rim_sine);
	const double theta = 2.0 * incidence - asin(ball.ratio * ball.rim_sine);
	const double shown = 2.0 * M_PI * (1.0 - cos(theta));
	double sum = 0.0;

	(void)state;
	for (int k = 0; k < 4 * 640 * 480; k++)
		sum += 0.25 * lp_ball_pixel_sr(&ball, &straight, (k % 1280 + 0.5) / 2.0,
					       (k / 1280 + 0.5) / 2.0);
	assert_float_equal(sum / shown, 1.0, 3e-3);
	assert_float_equal(shown / (4.0 * M_PI), 0.96, 0.01);
}

static void test_reflectance(void **state)
{
	(void)state;
	assert_float_equal(lp_ball_reflectance(1.5, 0.0, 1.0), 0.04, 1e-9);
	assert_float_equal(lp_ball_reflectance(3.18, 3.31, 1.0), 0.5526, 1e-3);
	assert_float_equal(lp_ball_reflectance(1.5, 0.0, 0.0), 1.0, 1e-9);
	/* at Brewster's angle only the light square to the plane of incidence is mirrored */
	const double s = (1.5 * 1.5 - 1.0) / (1.5 * 1.5 + 1.0);

	assert_float_equal(lp_ball_reflectance(1.5, 0.0, cos(atan(1.5))), 0.5 * s * s, 1e-9);
}

/* Half a pixel of 100 is 0.57 degrees of the mirrored direction for each way it can be off. */
static void test_sigma_grows_towards_the_rim(void **state)
{
	struct lp_ball ball = new_ball(&straight);
	double ahead[3], aside[3], cosine;

	(void)state;
	ball.outline_px = 0.5;
	assert_true(traced(387.0, 290.0, ahead, &cosine));
	assert_true(traced(478.0, 290.0, aside, &cosine));
	assert_float_equal(lp_ball_sigma_deg(&ball, ahead), 0.81, 0.03);
	assert_in_range(100.0 * lp_ball_sigma_deg(&ball, aside), 160, 250);
	ball.rotation_deg = 3.0;
	assert_float_equal(lp_ball_sigma_deg(&ball, ahead), hypot(0.81, 3.0), 0.03);
}

static void test_what_is_no_ball(void **state)
{
	struct lp_ball ball;
	const double behind[3] = {0.0, 0.0, 240.0};

	(void)state;
	assert_false(lp_ball_init(&ball, &straight, behind, 30.0, 1.0));
	assert_false(lp_ball_init(&ball, &straight, centre, 300.0, 1.0));
	assert_false(lp_ball_init(&ball, &straight, centre, 0.0, 1.0));
	assert_false(lp_ball_init(&ball, &straight, centre, 30.0, 200.0));
}

#define FILE_OF_BALL                                                     \
	"[camera]\nprojection = ball\nwidth_px = 640\nheight_px = 480\n" \
	"[lens.0]\ncx_px = 320\ncy_px = 240\nfx_px = 800\nfy_px = 810\n" \
	"rotation_wxyz = 1, 1, 0, 0\n"                                   \
	"[ball]\ncentre = 20, -15, -240\nradius = 30\nindex = 1.5\nextinction = 0\n"

static int create(const char *text, struct lp_camera **camera)
{
	struct lp_camera_file *file;
	int ret = read_camera_file(text, &file);

	if (ret < 0)
		return ret;
	ret = lp_camera_create(file, camera);
	lp_camera_file_destroy(file);
	return ret;
}

/* Even light stays even, whatever share of it each part of the ball mirrors; at half the size. */
static void test_panorama_of_even_light(void **state)
{
	struct lp_panorama panorama = new_panorama(240);
	struct lp_cells cells = {0};
	struct lp_camera *camera;
	struct lp_remap *remap;
	int unseen = 0;

	(void)state;
	assert_int_equal(create(FILE_OF_BALL, &camera), 0);
	assert_in_range(lp_camera_circle_px(camera, 640), 300, 340);
	assert_int_equal(lp_remap_create(camera, 320, 240, 1, 240, &remap), 0);
	assert_float_equal(remap->seen_fraction, 0.95, 0.03);
	assert_int_equal(lp_cells_reserve(&cells, 320, 240, 1), 0);
	for (int k = 0; k < 320 * 240; k++) {
		double d[3], cosine, reflectance = 1.0;

		if (traced(2.0 * (k % 320) + 1.0, 2.0 * (k / 320) + 1.0, d, &cosine))
			reflectance = lp_ball_reflectance(1.5, 0.0, cosine);
		for (int c = 0; c < 4; c++)
			cells.radiance[k][c] = (float)reflectance;
	}
	lp_remap_apply(remap, &cells, &panorama);
	double sum = 0.0;

	for (int i = 0; i < 240 * 120; i++) {
		if (panorama.flags[i] & LP_CELL_UNSEEN)
			unseen++;
		else
			sum += fmin(fabs((double)panorama.cells[i][1] - 1.0), 1.0);
	}
	assert_in_range(unseen, 100, 6000);
	assert_true(sum / (240 * 120) < 0.02);
	lp_remap_destroy(remap);
	lp_cells_release(&cells);
	lp_camera_destroy(camera);
	free_panorama(&panorama);
}

static void test_broken_files(void **state)
{
	static const struct {
		const char *text, *says;
	} cases[] = {
		{"[camera]\nprojection = ball\n", "needs width_px"},
		{"[camera]\nprojection = ball\nwidth_px = 64\nheight_px = 64\n", "one [lens.0]"},
		{FILE_OF_BALL "radius = 300\n", "radius"},
		{FILE_OF_BALL "rim_px = 500\n", "rim_px"},
		{FILE_OF_BALL "index = 0\n", "index"},
		{FILE_OF_BALL "distortion = 0, 0, 0, 0, 0, 1\n", "distortion"},
		{FILE_OF_BALL "[lens.1]\ncx_px = 3\n", "one [lens.0]"},
	};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(cases); k++) {
		struct lp_camera *camera = NULL;
		struct capture capture;

		capture_begin(&capture);
		const int ret = create(cases[k].text, &camera);
		const char *said = capture_end(&capture);

		assert_int_equal(ret, -EBADMSG);
		assert_contains(said, cases[k].says);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_rays_are_those_of_the_law_of_the_mirror),
		cmocka_unit_test(test_a_lens_that_distorts),
		cmocka_unit_test(test_solid_angles_add_up),
		cmocka_unit_test(test_reflectance),
		cmocka_unit_test(test_sigma_grows_towards_the_rim),
		cmocka_unit_test(test_what_is_no_ball),
		cmocka_unit_test(test_panorama_of_even_light),
		cmocka_unit_test(test_broken_files),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
