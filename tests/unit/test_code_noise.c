/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/code_noise.h"

#include <math.h>

#include "jpeg_encode.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera.h"
#include "vision/camera/response.h"

static struct lp_code_noise noise_of_jpeg(const uint8_t *data, size_t size)
{
	const struct lp_frame frame = {.format = LP_FORMAT_MJPEG, .data = data, .size_bytes = size};

	return lp_code_noise_of(&frame, false);
}

/* Quality 100 has steps of 1 throughout; 50 the standard's own table: 16 for DC. */
static void test_steps_of_a_jpeg(void **state)
{
	const struct jpeg_kind finest = {3, 2, 2, 100, 0, 0, 0}, standard = {1, 1, 1, 50, 0, 0, 0};
	unsigned long size;
	uint8_t *data = encode_jpeg(&finest, 64, 32, &size);
	struct lp_code_noise noise = noise_of_jpeg(data, size);

	(void)state;
	assert_float_equal(noise.pixel, sqrt(63.0 / 64.0 / 12.0), 1e-6);
	assert_float_equal(noise.common, sqrt((1.0 + 1.0 / 64.0) / 12.0), 1e-6);
	free(data);
	data = encode_jpeg(&standard, 64, 32, &size);
	noise = noise_of_jpeg(data, size);
	assert_float_equal(noise.common, sqrt((1.0 + 4.0) / 12.0), 1e-6);
	/* where light is even, rounding by the camera goes with its noise */
	assert_float_equal(noise.even, sqrt(4.0 / 12.0), 1e-6);
	const struct lp_frame frame = {.format = LP_FORMAT_MJPEG, .data = data, .size_bytes = size};

	assert_true(lp_code_noise_of(&frame, true).even > 1.2F * noise.even);
	assert_true(noise.pixel > 15.0F && noise.pixel < 25.0F);
	free(data);
}

static void test_cut_anywhere_it_is_rounding_alone(void **state)
{
	const struct jpeg_kind kind = {3, 2, 2, 85, 0, 0, 0};
	unsigned long size;
	uint8_t *data = encode_jpeg(&kind, 64, 32, &size);

	(void)state;
	for (unsigned long cut = 0; cut < 200; cut++) {
		uint8_t *part = malloc(cut ? cut : 1); /* the sanitizer sees a read beyond */

		memcpy(part, data, cut);
		const struct lp_code_noise noise = noise_of_jpeg(part, cut);

		assert_true(noise.common >= 0.2886F && noise.common < 0.5F);
		assert_true(noise.pixel >= 0.0F);
		free(part);
	}
	free(data);
}

static void test_raw_and_float_frames(void **state)
{
	const struct lp_frame grey = {.format = LP_FORMAT_GREY},
			      floats = {.format = LP_FORMAT_RGB_F32};

	(void)state;
	assert_float_equal(lp_code_noise_of(&grey, false).common, 1.0 / sqrt(12.0), 1e-6);
	assert_float_equal(lp_code_noise_of(&grey, false).pixel, 0.0, 0.0);
	assert_float_equal(lp_code_noise_of(&floats, true).common, 0.0, 0.0);
}

/* Of sRGB: 2.4 / (code + 0.055 * 255) above its linear part; 1 / code within it. */
static void test_slope(void **state)
{
	struct lp_response *response = malloc(sizeof(*response));
	struct lp_camera *camera;

	(void)state;
	assert_int_equal(lp_camera_create(NULL, &camera), 0);
	lp_response_init(response, camera);
	for (int code = 14; code < 254; code += 20)
		assert_float_equal(lp_relative_slope(response, response->pixel[1][code]) *
					   ((double)code + 0.055 * 255.0) / 2.4,
				   1.0, 0.01);
	assert_float_equal(lp_relative_slope(response, response->pixel[1][5]) * 5.0, 1.0, 0.01);
	assert_true(lp_relative_slope(response, 0.0F) > 0.9F);
	assert_true(lp_relative_slope(response, 2.0F) > 0.0F);
	lp_camera_destroy(camera);
	free(response);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_steps_of_a_jpeg),
		cmocka_unit_test(test_cut_anywhere_it_is_rounding_alone),
		cmocka_unit_test(test_raw_and_float_frames),
		cmocka_unit_test(test_slope),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
