/* SPDX-License-Identifier: Apache-2.0 */
/* Several cameras in one box: each tells of what it sees, all of one map. */
#include <errno.h>
#include <math.h>

#include "include/light_estimate.h"
#include "include/panorama.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera.h"
#include "vision/imager.h"
#include "vision/imager_internal.h"

#define WIDTH 120
#define FORWARD (30 * WIDTH + WIDTH / 2) /* cells of the panorama */
#define BACKWARD (30 * WIDTH)
#define SIDE_PX 240

/* A fisheye lens that sees a bit more than half of the sphere, and looks ahead or back. */
static struct lp_camera module(bool back)
{
	const float sign = back ? -1.0F : 1.0F;
	struct lp_camera camera = {.projection = LP_FISHEYE,
				   .width_px = SIDE_PX,
				   .height_px = SIDE_PX,
				   .lens_count = 1};
	struct lp_lens *lens = &camera.lens[0];

	*lens = (struct lp_lens){.cx_px = SIDE_PX / 2.0F,
				 .cy_px = SIDE_PX / 2.0F,
				 .fx_px = 70.0F,
				 .fy_px = 70.0F,
				 .max_theta_rad = 1.69F};
	lens->rotation[0][0] = lens->rotation[2][2] = sign;
	lens->rotation[1][1] = 1.0F;
	return camera;
}

static struct lp_camera front, back;

static struct lp_imager *new_imager(void)
{
	const struct lp_imager_options options = {.panorama_width = WIDTH,
						  .decode = LP_DECODE_PIXELS,
						  .divisor = 1};
	struct lp_imager *imager;

	front = module(false);
	back = module(true);
	assert_int_equal(lp_imager_create(&front, &options, &imager), 0);
	assert_int_equal(lp_imager_add_camera(imager, &back), 0);
	return imager;
}

/* A picture of even light: 8-bit grey, exposed for so long. */
static struct lp_frame *even(int camera, double radiance, double exposure_s, double t_s)
{
	struct lp_frame *frame =
		new_frame(LP_FORMAT_GREY, SIDE_PX, SIDE_PX, SIDE_PX, (size_t)SIDE_PX * SIDE_PX);
	const double linear = fmin(radiance * exposure_s, 1.0);

	memset((uint8_t *)frame->data,
	       (int)lround(255.0 * (1.055 * pow(linear, 1.0 / 2.4) - 0.055)), frame->size_bytes);
	frame->camera = (uint8_t)camera;
	frame->exposure_us = (float)(exposure_s * 1e6);
	frame->t_read_ns = (int64_t)(t_s * 1e9);
	return frame;
}

static float light(struct lp_imager *imager, int cell)
{
	return lp_imager_panorama(imager)->cells[cell][1];
}

static void test_each_camera_tells_of_what_it_sees(void **state)
{
	struct lp_imager *imager = new_imager();
	uint8_t view[WIDTH * WIDTH / 2];

	(void)state;
	assert_int_equal(lp_imager_add(imager, even(0, 20.0, 0.01, 1.0)), 0);
	assert_float_equal(light(imager, FORWARD), 20.0, 0.4);
	assert_float_equal(lp_imager_panorama(imager)->seen_fraction, 0.56, 0.03);
	assert_true(lp_imager_panorama(imager)->flags[BACKWARD] & LP_CELL_UNSEEN);
	/* at its own time and exposure */
	assert_int_equal(lp_imager_add(imager, even(1, 4.0, 0.03, 1.008)), 0);
	assert_float_equal(light(imager, FORWARD), 20.0, 0.4);
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.1);
	assert_float_equal(lp_imager_panorama(imager)->seen_fraction, 1.0, 1e-6);
	assert_int_equal(lp_imager_current_exposures(imager, 0), 1);
	assert_int_equal(lp_imager_current_exposures(imager, 1), 1);
	lp_imager_view(imager, view);
	assert_int_equal(view[BACKWARD], 1);
	assert_int_equal(view[FORWARD], 0);
	/* there is no third one */
	assert_int_equal(lp_imager_add(imager, even(2, 4.0, 0.03, 1.02)), -EBADMSG);
	lp_imager_destroy(imager);
}

static void test_one_forgets_and_the_other_does_not(void **state)
{
	struct lp_imager *imager = new_imager();

	(void)state;
	assert_int_equal(lp_imager_add(imager, even(0, 20.0, 0.01, 1.0)), 0);
	assert_int_equal(lp_imager_add(imager, even(1, 4.0, 0.03, 1.008)), 0);
	assert_int_equal(lp_imager_load(imager, even(1, 4.0, 0.03, 1.04), NAN), 0);
	lp_imager_forget(imager);
	assert_int_equal(lp_imager_current_exposures(imager, 0), 1);
	assert_int_equal(lp_imager_current_exposures(imager, 1), 0);
	assert_true(lp_imager_panorama(imager)->flags[BACKWARD] & LP_CELL_UNSEEN);
	assert_float_equal(light(imager, FORWARD), 20.0, 0.4);
	assert_int_equal(lp_imager_accept(imager, 30000.0F), 0);
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.1);
	lp_imager_destroy(imager);
}

static void test_a_camera_that_is_away(void **state)
{
	struct lp_imager *imager = new_imager();
	struct lp_imager_status status;

	(void)state;
	assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 1.0)), 0);
	assert_int_equal(lp_imager_add(imager, even(1, 4.0, 0.03, 1.008)), 0);
	lp_imager_status(imager, &status);
	assert_false(status.lost_view);
	assert_float_equal(status.hidden_share, 0.0, 0.0);
	lp_imager_lose(imager, 1);
	assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 3.008)), 0);
	lp_imager_status(imager, &status);
	assert_true(status.lost_view);
	assert_float_equal(status.hidden_share, 0.44, 0.03);
	assert_float_equal(status.hidden_s, 2.015, 0.02);
	/* what it has shown is not thrown away, and it goes on where it was */
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.1);
	lp_imager_begin(imager, 1);
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.1);
	assert_int_equal(lp_imager_add(imager, even(1, 4.0, 0.03, 3.1)), 0);
	lp_imager_status(imager, &status);
	assert_false(status.lost_view);
	assert_float_equal(status.hidden_s, 0.0, 0.0);
	lp_imager_destroy(imager);
}

/* A camera comes back with another exposure, which its first frames do not tell. */
static void test_a_camera_that_comes_back_exposes_otherwise(void **state)
{
	struct lp_imager *imager = new_imager();
	double t_s = 1.0;

	(void)state;
	for (int n = 0; n < 10; n++, t_s += 0.033) {
		assert_int_equal(lp_imager_add(imager, even(0, 20.0, 1e-3, t_s)), 0);
		assert_int_equal(lp_imager_add(imager, even(1, 30.0, 1e-3, t_s + 0.01)), 0);
	}
	lp_imager_lose(imager, 0);
	lp_imager_lose(imager, 1);
	t_s += 2.0;
	for (int camera = 1; camera >= 0; camera--) {
		lp_imager_begin(imager, camera);
		lp_imager_expect_exposure(imager, camera);
		for (int n = 0; n < 6; n++, t_s += 0.033) {
			const double exposure_s = n < 3 ? 16e-3 : 1e-3; /* commanded meanwhile */
			struct lp_frame *frame =
				even(camera, camera ? 30.0 : 20.0, exposure_s, t_s);

			frame->exposure_us = NAN;
			assert_int_equal(lp_imager_add(imager, frame), 0);
			assert_float_equal(light(imager, FORWARD), 20.0, 0.8);
			assert_float_equal(light(imager, BACKWARD), 30.0, 1.0);
		}
	}
	lp_imager_destroy(imager);
}

/* Another preset makes another imager, while a camera is away. */
static void test_another_imager_goes_on(void **state)
{
	struct lp_imager *before = new_imager(), *after;
	struct lp_imager_status status;

	(void)state;
	for (int n = 0; n < 40; n++) {
		assert_int_equal(lp_imager_add(before, even(0, 4.0, 0.03, 1.0 + n / 30.0)), 0);
		assert_int_equal(lp_imager_add(before, even(1, 4.4, 0.03, 1.008 + n / 30.0)), 0);
	}
	after = new_imager();
	lp_imager_lose(before, 0);
	lp_imager_inherit(after, before);
	assert_int_equal(lp_imager_add(after, even(1, 4.4, 0.03, 3.0)), 0);
	assert_float_equal(light(after, BACKWARD), 4.0, 0.04); /* aligned as before */
	lp_imager_status(after, &status);
	assert_float_equal(status.hidden_s, 0.0, 0.0);
	assert_float_equal(lp_imager_panorama(after)->seen_fraction, 0.56, 0.03);
	lp_imager_destroy(before);
	lp_imager_destroy(after);
}

/* What is known of a camera's scale and colours goes on whole, but for what is of the former
 * panorama and of the former response. */
static void test_all_that_is_known_of_a_camera_goes_on(void **state)
{
	struct lp_imager *before = new_imager(), *after = new_imager();

	(void)state;
	for (int k = 0; k < 2; k++) {
		memset(&before->eyes[k].gain, 0x3C + k, sizeof(before->eyes[k].gain));
		memset(&before->eyes[k].overlap, 0x3C + k, sizeof(before->eyes[k].overlap));
		before->eyes[k].gain.count = k ? 9 : 0;
	}
	lp_imager_inherit(after, before);
	for (int k = 0; k < 2; k++) {
		struct lp_gain *gain = &after->eyes[k].gain, *was = &before->eyes[k].gain;
		struct lp_overlap *overlap = &after->eyes[k].overlap;

		assert_true(k ? gain->variance > was->variance : gain->variance == was->variance);
		gain->variance = was->variance;
		assert_int_equal(gain->count, 0);
		gain->count = was->count;
		assert_memory_equal(gain, was, offsetof(struct lp_gain, cells));
		assert_true(overlap->applied[1] == 0.0F);
		memcpy(overlap->applied, before->eyes[k].overlap.applied, sizeof(overlap->applied));
		assert_memory_equal(overlap, &before->eyes[k].overlap, sizeof(*overlap));
	}
	lp_imager_destroy(before);
	lp_imager_destroy(after);
}

/* A long exposure may end after a short one that began later. */
static void test_frames_in_another_order_than_exposed(void **state)
{
	struct lp_imager *imager = new_imager();

	(void)state;
	assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 1.0)), 0);
	assert_int_equal(lp_imager_add(imager, even(1, 4.0, 0.03, 1.04)), 0);
	assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 1.032)), 0);
	assert_float_equal(light(imager, FORWARD), 4.0, 0.1);
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.1);
	lp_imager_destroy(imager);
}

/* One shows all light brighter than the other, also where both look: it is brought to the first. */
static void test_the_overlap_aligns_them(void **state)
{
	struct lp_imager *imager = new_imager();
	struct lp_imager_status before, after;

	(void)state;
	for (int n = 0; n < 40; n++) {
		assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 1.0 + n / 30.0)), 0);
		assert_int_equal(lp_imager_add(imager, even(1, 4.4, 0.03, 1.008 + n / 30.0)), 0);
		if (n == 0)
			lp_imager_status(imager, &before);
	}
	lp_imager_status(imager, &after);
	assert_float_equal(light(imager, FORWARD), 4.0, 0.04);
	assert_float_equal(light(imager, BACKWARD), 4.0, 0.04);
	assert_true(after.cameras_sigma < 0.5F * before.cameras_sigma);
	assert_true(after.cameras_sigma > 0.002F);
	lp_imager_destroy(imager);
}

/* Of a camera that sees another scene nothing is known but what it shows. */
static void test_what_is_no_difference_between_cameras(void **state)
{
	struct lp_imager *imager = new_imager();

	(void)state;
	for (int n = 0; n < 20; n++) {
		assert_int_equal(lp_imager_add(imager, even(0, 4.0, 0.03, 1.0 + n / 30.0)), 0);
		assert_int_equal(lp_imager_add(imager, even(1, 8.0, 0.03, 1.008 + n / 30.0)), 0);
	}
	assert_float_equal(light(imager, BACKWARD), 8.0, 0.1);
	lp_imager_destroy(imager);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_each_camera_tells_of_what_it_sees),
		cmocka_unit_test(test_one_forgets_and_the_other_does_not),
		cmocka_unit_test(test_a_camera_that_is_away),
		cmocka_unit_test(test_a_camera_that_comes_back_exposes_otherwise),
		cmocka_unit_test(test_another_imager_goes_on),
		cmocka_unit_test(test_all_that_is_known_of_a_camera_goes_on),
		cmocka_unit_test(test_frames_in_another_order_than_exposed),
		cmocka_unit_test(test_the_overlap_aligns_them),
		cmocka_unit_test(test_what_is_no_difference_between_cameras),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
