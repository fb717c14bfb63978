/* SPDX-License-Identifier: Apache-2.0 */
/* What frames carry of their orientation, and what they show: which of the two is believed. */
#include <math.h>

#include "light/math/rotation.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera.h"
#include "vision/imager.h"

#define FRAME_NS INT64_C(33333333)

static struct lp_camera *camera;
static struct lp_imager *imager;
static int64_t t_ns;
static uint32_t told_by;

static int setup(void **state)
{
	const struct lp_imager_options options = {.panorama_width = 240,
						  .decode = LP_DECODE_BLOCKS,
						  .divisor = 1,
						  .follow_turns = true,
						  .use_orientation = true};

	(void)state;
	t_ns = 1000000000;
	told_by = 1;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	return lp_imager_create(camera, &options, &imager);
}

static int teardown(void **state)
{
	(void)state;
	lp_imager_destroy(imager);
	lp_camera_destroy(camera);
	return 0;
}

/* A frame of a camera that has turned to the left by yaw_deg, in a room with some discs; told_deg:
 * what the frame carries (NAN: nothing). */
static void show(double yaw_deg, double told_deg, float brightness)
{
	struct disc discs[] = {{10, 20, 6, 9},	 {70, -10, 9, 5},   {130, 40, 12, 3},
			       {-40, -30, 7, 6}, {-100, 15, 10, 4}, {-160, -5, 8, 8}};

	for (size_t k = 0; k < LP_COUNT(discs); k++) {
		discs[k].azimuth_deg += yaw_deg;
		discs[k].radiance *= brightness;
	}
	struct lp_frame *frame = scene_frame(480, 240, discs, LP_COUNT(discs), brightness);

	t_ns += FRAME_NS;
	frame->t_read_ns = t_ns;
	for (int i = 0; i < 4; i++)
		frame->orientation[i] = NAN;
	frame->orientation_sigma_deg = NAN;
	if (!isnan(told_deg)) {
		frame->orientation[0] = frame->orientation[2] = 0.0F;
		frame->orientation[1] = (float)sin(told_deg * TEST_DEG / 2);
		frame->orientation[3] = (float)cos(told_deg * TEST_DEG / 2);
		frame->orientation_sigma_deg = 0.1F;
		frame->orientation_by = told_by;
	}
	assert_int_equal(lp_imager_add(imager, frame), 0);
}

static double yaw_found_deg(void)
{
	const struct lp_rotation *r = lp_imager_rotation(imager);

	return atan2(r->m[0][2], r->m[2][2]) / TEST_DEG;
}

static struct lp_imager_status status(void)
{
	struct lp_imager_status s;

	lp_imager_status(imager, &s);
	return s;
}

/* The world of an app jumps; the room has not moved, and the camera holds still to the bit. */
static void test_a_jump_that_the_pictures_do_not_show(void **state)
{
	(void)state;
	for (int n = 0; n < 10; n++)
		show(0.0, 33.0, 1.0F);
	assert_true(lp_imager_told(imager).known);
	show(0.0, 45.0, 1.0F);
	assert_true(lp_rotation_is_identity(lp_imager_rotation(imager)));
	assert_true(lp_imager_told(imager).left_out);
	for (int n = 0; n < 10; n++) {
		show(0.0, 45.0, 1.0F);
		assert_true(lp_rotation_is_identity(lp_imager_rotation(imager)));
	}
}

/* The app has left; the next one has a world of its own, and is believed from its first pose on. */
static void test_after_a_jump_the_next_one_is_believed(void **state)
{
	(void)state;
	for (int n = 0; n < 10; n++)
		show(0.0, n < 5 ? 33.0 : 123.0, 1.0F);
	assert_true(lp_imager_told(imager).left_out);
	told_by = 2;
	for (int n = 0; n < 10; n++) {
		show(n, 70.0 + n, 1.0F);
		assert_false(lp_imager_told(imager).left_out);
		assert_float_equal(yaw_found_deg(), n, 0.3);
	}
	show(9.0, 99.0, 1.0F); /* and found out likewise */
	assert_true(lp_imager_told(imager).left_out);
}

/* More than a camera turns between two frames, so that the pictures alone do not find it. */
static void test_a_turn_that_is_too_fast_for_the_pictures(void **state)
{
	(void)state;
	for (int n = 0; n < 10; n++)
		show(0.0, 33.0, 1.0F);
	show(30.0, 63.0, 1.0F);
	assert_float_equal(yaw_found_deg(), 30.0, 0.3);
	assert_false(lp_imager_told(imager).left_out);
	assert_false(status().rotation_is_unknown);
	assert_true(status().changed < 0.02F);
	show(62.0, 95.0, 1.0F);
	assert_float_equal(yaw_found_deg(), 62.0, 0.3);
	assert_false(lp_imager_told(imager).left_out);
}

/* In the dark the pictures tell nothing: what is told counts, and is less sure from frame to frame.
 */
static void test_a_turn_in_the_dark(void **state)
{
	float before;

	(void)state;
	for (int n = 0; n < 10; n++)
		show(0.0, 33.0, 1.0F);
	for (int n = 1; n <= 3; n++)
		show(n, 33.0 + n, 1.0F);
	before = lp_imager_turn(imager).sigma_deg;
	for (int n = 4; n <= 12; n++) {
		show(n, 33.0 + n, 0.0F);
		assert_float_equal(yaw_found_deg(), n, 0.3);
		assert_true(lp_imager_turn(imager).sigma_deg > before);
		before = lp_imager_turn(imager).sigma_deg;
	}
	assert_false(lp_imager_told(imager).left_out);
}

/* What is missing for a while is no contradiction, and counts again when it is back. */
static void test_gaps(void **state)
{
	(void)state;
	for (int n = 0; n < 60; n++) {
		show(n, n % 3 ? 33.0 + n : NAN, 1.0F);
		assert_float_equal(yaw_found_deg(), n, 0.3);
		assert_int_equal(lp_imager_told(imager).known, n % 3 != 0);
		assert_false(lp_imager_told(imager).left_out);
	}
}

/* A camera that holds still may turn in the dark. */
static void test_in_the_dark_nobody_knows_whether_the_camera_turns(void **state)
{
	(void)state;
	for (int n = 0; n < 60; n++) {
		show(0.0, NAN, 1.0F);
		assert_true(lp_imager_turn(imager).unseen_rate_deg_per_s == 0.0F);
	}
	for (int n = 0; n < 60; n++)
		show(0.0, NAN, 0.0F);
	assert_true(lp_imager_turn(imager).unseen_rate_deg_per_s > 30.0F);
	for (int n = 0; n < 60; n++)
		show(0.0, NAN, 1.0F);
	assert_true(lp_imager_turn(imager).unseen_rate_deg_per_s == 0.0F);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_a_jump_that_the_pictures_do_not_show),
		TEST(test_after_a_jump_the_next_one_is_believed),
		TEST(test_a_turn_that_is_too_fast_for_the_pictures),
		TEST(test_a_turn_in_the_dark),
		TEST(test_gaps),
		TEST(test_in_the_dark_nobody_knows_whether_the_camera_turns),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
