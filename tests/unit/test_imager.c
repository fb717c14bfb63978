/* SPDX-License-Identifier: Apache-2.0 */
/* Frames of every format into one panorama of radiance; brackets; what is refused. */
#include "vision/imager.h"

#include <errno.h>
#include <math.h>

#include "include/light_estimate.h"
#include "jpeg_encode.h"
#include "light/find/lamps.h"
#include "light/math/grid.h"
#include "lp_test.h"
#include "scene.h"
#include "vision/camera/camera.h"

static struct lp_camera *camera;

static int set_up(void **state)
{
	(void)state;
	return lp_camera_create(NULL, &camera);
}

static int tear_down(void **state)
{
	(void)state;
	lp_camera_destroy(camera);
	return 0;
}

static struct lp_imager *new_imager(enum lp_decode decode)
{
	const struct lp_imager_options options = {.panorama_width = 240,
						  .decode = decode,
						  .divisor = 1,
						  .exact_blocks = 128};
	struct lp_imager *imager;

	assert_int_equal(lp_imager_create(camera, &options, &imager), 0);
	return imager;
}

static double srgb_encode(double linear)
{
	return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

/* A grey gradient of linear light, exposed: codes as a camera would give them. */
static uint8_t gradient_code(int x, int width, double exposure_s)
{
	const double light = 0.02 + 2.0 * x / width;

	return (uint8_t)lround(255.0 * srgb_encode(fmin(light * exposure_s, 1.0)));
}

static struct lp_frame *raw_gradient(enum lp_pixel_format format, int width, int height,
				     double exposure_s)
{
	const int stride = format == LP_FORMAT_YUYV ? 2 * width : width;
	const size_t size = (size_t)stride * height * (format == LP_FORMAT_NV12 ? 3 : 2) / 2;
	struct lp_frame *frame = new_frame(format, width, height, stride, size);
	uint8_t *data = (uint8_t *)frame->data;

	memset(data, 128, size);
	for (int y = 0; y < height; y++)
		for (int x = 0; x < width; x++)
			data[y * stride + x * stride / width] = gradient_code(x, width, exposure_s);
	frame->exposure_us = (float)(exposure_s * 1e6);
	return frame;
}

/* A camera's picture of the gradient, turned to the right. */
static void add_turned(struct lp_imager *imager, double exposure_s, int turn_px)
{
	const int width = 480, height = 240;
	struct lp_frame *frame = raw_gradient(LP_FORMAT_GREY, width, height, exposure_s);
	uint8_t *data = (uint8_t *)frame->data;

	for (int y = 0; y < height; y++)
		for (int x = 0; x < width; x++)
			data[y * width + (x + turn_px) % width] =
				gradient_code(x, width, exposure_s);
	assert_int_equal(lp_imager_add(imager, frame), 0);
}

static int current_count(const struct lp_imager *imager)
{
	struct lp_imager_status status;

	lp_imager_status(imager, &status);
	return lp_imager_current_exposures(imager, 0);
}

/* Exposures from before and after a turn are no bracket; those of one light are. */
static void test_exposures_from_before_a_turn_do_not_count(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	const double exposures_s[] = {0.4, 0.1};
	int turn_px = 0;

	(void)state;
	for (int frame = 0; frame < 8; frame++)
		add_turned(imager, exposures_s[frame % 2], 0);
	assert_int_equal(current_count(imager), 2);
	for (int frame = 0; frame < 8; frame++) {
		add_turned(imager, exposures_s[frame % 2], turn_px += 24);
		assert_int_equal(current_count(imager), 1);
	}
	for (int frame = 0; frame < 4; frame++)
		add_turned(imager, exposures_s[frame % 2], turn_px);
	assert_int_equal(current_count(imager), 2);
	/* a single exposure needs no other */
	lp_imager_forget(imager);
	for (int frame = 0; frame < 4; frame++) {
		add_turned(imager, 0.1, turn_px += 24);
		assert_int_equal(current_count(imager), 1);
	}
	lp_imager_destroy(imager);
}

/* Radiance does not depend on exposure nor on format: 1.0 is full scale at one second. */
static void test_exposure_is_divided_out(void **state)
{
	const enum lp_pixel_format formats[] = {LP_FORMAT_YUYV, LP_FORMAT_NV12, LP_FORMAT_GREY};

	(void)state;
	for (unsigned int f = 0; f < LP_COUNT(formats); f++)
		for (double exposure_s = 0.05; exposure_s < 0.5; exposure_s *= 2.0) {
			struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);

			assert_int_equal(lp_imager_add(imager, raw_gradient(formats[f], 480, 240,
									    exposure_s)),
					 0);
			for (int c = 10; c < 230; c++)
				assert_float_equal(
					lp_imager_panorama(imager)->cells[60 * 240 + c][1],
					0.02 + 2.0 * (c + 0.25) / 240,
					0.02 / exposure_s * 0.25 + 0.01);
			lp_imager_destroy(imager);
		}
}

static void test_gain_counts_as_exposure(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	struct lp_frame *frame = raw_gradient(LP_FORMAT_GREY, 480, 240, 0.4);

	(void)state;
	frame->exposure_us = 1e5F;
	frame->gain = 4.0F;
	assert_int_equal(lp_imager_add(imager, frame), 0);
	assert_float_equal(lp_imager_panorama(imager)->cells[60 * 240 + 120][1], 1.02, 0.02);
	lp_imager_destroy(imager);
}

/* Three exposures of a scene that no single one holds; then the bracket slides. */
static void test_bracket(void **state)
{
	const double exposures_s[] = {2.0, 0.2, 0.02};
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	struct lp_imager_status status;

	(void)state;
	assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 2.0)), 0);
	assert_true(lp_imager_panorama(imager)->clipped_fraction > 0.5F);
	assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.2)), 0);
	assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.02)), 0);
	lp_imager_status(imager, &status);
	assert_int_equal(status.exposure_count, 3);
	assert_float_equal(status.longest_exposure_us, 2e6F, 1.0F);
	assert_float_equal(lp_imager_panorama(imager)->clipped_fraction, 0.0, 0.0);
	for (int c = 1; c < 239; c++)
		assert_float_equal(lp_imager_panorama(imager)->cells[60 * 240 + c][1] /
					   (0.02 + 2.0 * (c + 0.25) / 240),
				   1.0, 0.03);
	for (int n = 0; n < 30; n++) /* same settings: the same three slots */
		assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240,
								    exposures_s[n % 3])),
				 0);
	lp_imager_status(imager, &status);
	assert_int_equal(status.exposure_count, 3);
	for (int n = 0; n < 40; n++) /* the camera stays at one: the others are forgotten */
		assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.2)),
				 0);
	lp_imager_status(imager, &status);
	assert_int_equal(status.exposure_count, 1);
	lp_imager_destroy(imager);
}

/* What clips is told by the shortest exposure, whatever the map makes of it. */
static void test_what_clips_in_the_shortest_exposure(void **state)
{
	const double exposures_s[] = {2.0, 4.0, 0.2, 2.0};
	const float clip[] = {0.76F, 0.76F, 0.0F, 0.0F};
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);

	(void)state;
	for (int n = 0; n < 4; n++) {
		struct lp_imager_status status;

		assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240,
								    exposures_s[n])),
				 0);
		lp_imager_status(imager, &status);
		assert_float_equal(status.newest_clips, clip[n], 0.03);
	}
	lp_imager_destroy(imager);
}

/* A set of stills has up to 13 exposures; the longest come after the shortest, and none pushes it
 * out. */
static void test_a_set_of_many_exposures(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);

	(void)state;
	for (int n = 0; n < 26; n++) {
		struct lp_imager_status status;
		const double exposure_s = 0.02 * pow(2.0, n % 13);

		assert_int_equal(lp_imager_add(imager,
					       raw_gradient(LP_FORMAT_GREY, 480, 240, exposure_s)),
				 0);
		lp_imager_status(imager, &status);
		assert_float_equal(status.newest_clips, 0.0, 0.0);
		assert_int_equal(status.exposure_count, n < 13 ? n + 1 : 13);
	}
	lp_imager_destroy(imager);
}

/* Which of several exposures a frame had shows in its picture. */
static void test_match(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	int told = 0;

	(void)state;
	assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.4)), 0);
	for (double exposure_s = 0.00625; exposure_s < 10.0; exposure_s *= 4.0) {
		const float right_us = (float)exposure_s * 1e6F;
		const float candidates_us[] = {right_us, 0.25F * right_us, 4.0F * right_us};
		struct lp_exposure_matches matches;

		assert_int_equal(lp_imager_load(imager,
						raw_gradient(LP_FORMAT_GREY, 480, 240, exposure_s),
						NAN),
				 0);
		lp_imager_match(imager, candidates_us, 3, &matches);
		for (int k = 1; k < 3; k++) {
			const float right = matches.codes[0][k], wrong = matches.codes[k][0];

			/* there may be nothing that both can tell */
			if (isnan(right) || (k == 2 && exposure_s > 5.0))
				continue;
			told++;
			assert_true(right < 3.0F);
			assert_true(wrong > 4.0F * right + 3.0F);
		}
	}
	assert_true(told >= 8);
	/* accepted with another exposure than expected: the radiance is that of the true one */
	assert_int_equal(lp_imager_load(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.2), 4e5F),
			 0);
	lp_imager_forget(imager);
	assert_int_equal(lp_imager_accept(imager, 2e5F), 0);
	assert_float_equal(lp_imager_panorama(imager)->cells[60 * 240 + 120][1], 1.02, 0.02);
	assert_int_equal(lp_imager_accept(imager, 2e5F), -EINVAL); /* it counts once */
	lp_imager_destroy(imager);
}

static void test_unknown_exposure_is_full_scale(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	struct lp_frame *frame = raw_gradient(LP_FORMAT_GREY, 480, 240, 0.4);
	struct lp_imager_status status;

	(void)state;
	frame->exposure_us = NAN;
	assert_int_equal(lp_imager_add(imager, frame), 0);
	lp_imager_status(imager, &status);
	assert_true(status.exposure_unknown);
	assert_true(isnan(status.longest_exposure_us));
	assert_float_equal(lp_imager_panorama(imager)->cells[60 * 240 + 120][1], 0.4 * 1.02, 0.01);
	lp_imager_destroy(imager);
}

static struct lp_frame *jpeg_frame(const struct jpeg_kind *kind, int width, int height)
{
	struct lp_frame *frame = new_frame(LP_FORMAT_MJPEG, width, height, 0, 1);
	unsigned long size;

	free((void *)frame->data);
	frame->data = encode_jpeg(kind, width, height, &size);
	frame->size_bytes = size;
	frame->exposure_us = 1e6F;
	return frame;
}

/* Blocks, and every kind of JPEG, against the mean of the linearised pixels. */
static void test_jpeg_against_its_own_pixels(void **state)
{
	const struct jpeg_kind kinds[] = {{3, 2, 2, 90, 0, 0, 0},
					  {3, 2, 1, 90, 5, 0, 0},
					  {3, 1, 1, 90, 0, 1, 0},
					  {1, 1, 1, 90, 0, 0, 0},
					  {3, 2, 2, 90, 0, 0, 1}};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(kinds); k++) {
		struct lp_imager *blocks = new_imager(LP_DECODE_BLOCKS);
		struct lp_imager *pixels = new_imager(LP_DECODE_PIXELS);
		double difference = 0.0, bias = 0.0, total = 0.0;

		assert_int_equal(lp_imager_add(blocks, jpeg_frame(&kinds[k], 1920, 960)), 0);
		assert_int_equal(lp_imager_add(pixels, jpeg_frame(&kinds[k], 1920, 960)), 0);
		for (int i = 0; i < 240 * 120; i++) {
			const float *a = lp_imager_panorama(blocks)->cells[i];
			const float *b = lp_imager_panorama(pixels)->cells[i];

			difference += fabs(a[1] - b[1]);
			bias += a[1] - b[1];
			total += b[1];
		}
		/* full-scale edges and noise all over, of all colours: far worse than a room; the
		 * detail of chroma is not read, and pixels' chroma follows their luma, so grey does
		 * better, and pixels are exact */
		const int exact = kinds[k].progressive, grey = kinds[k].components == 1;

		assert_true(difference / total < (exact ? 0.01 : grey ? 0.02 : 0.1));
		assert_true(fabs(bias / total) < (exact ? 0.001 : grey ? 0.005 : 0.05));
		lp_imager_destroy(blocks);
		lp_imager_destroy(pixels);
	}
}

/* Means and variances of raw blocks against every pixel linearised; sizes that end in part of a
 * block. */
static void test_raw_blocks_against_pixels(void **state)
{
	const enum lp_pixel_format formats[] = {LP_FORMAT_YUYV, LP_FORMAT_NV12, LP_FORMAT_GREY};
	const int sizes[][2] = {{1920, 960}, {1934, 966}};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(formats) * LP_COUNT(sizes); k++) {
		const int width = sizes[k % 2][0], height = sizes[k % 2][1];
		double difference = 0.0, bias = 0.0, total = 0.0;
		struct lp_imager *imagers[2] = {new_imager(LP_DECODE_BLOCKS),
						new_imager(LP_DECODE_PIXELS)};

		for (int i = 0; i < 2; i++) {
			struct lp_frame *frame = raw_gradient(formats[k / 2], width, height, 0.4);
			uint8_t *data = (uint8_t *)frame->data;

			srand(9);
			for (size_t j = 0; j < frame->size_bytes; j++) /* texture, also of chroma */
				data[j] = (uint8_t)(data[j] / 2 + 60 + rand() % 40 - 20);
			assert_int_equal(lp_imager_add(imagers[i], frame), 0);
		}
		for (int i = 0; i < 240 * 120; i++)
			for (int c = 0; c < 3; c++) {
				const double a = lp_imager_panorama(imagers[0])->cells[i][c];
				const double b = lp_imager_panorama(imagers[1])->cells[i][c];

				difference += fabs(a - b);
				bias += a - b;
				total += b;
			}
		assert_true(difference / total < 0.025);
		assert_true(fabs(bias / total) < 0.025); /* the variance of chroma is left out */
		lp_imager_destroy(imagers[0]);
		lp_imager_destroy(imagers[1]);
	}
}

/* Lamps smaller than a cell: the grid knows the cell, the pixels know the place. */
static void test_refinement(void **state)
{
	const struct disc discs[] = {{40.3, 11.7, 0.25, 1e4},
				     {-120.1, -33.3, 0.6, 3e3},
				     {179.93, 5.2, 0.4, 5e3},
				     {20.0, 89.2, 0.5, 5e3}};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(discs); k++) {
		struct lp_imager *imager = new_imager(LP_DECODE_PIXELS);
		struct lp_lamp_finder finder = {0};
		struct lp_lamp lamp = {0};
		int32_t cells[5 * 240];
		float grid_direction[3];
		double d[3];

		disc_direction(&discs[k], d);
		assert_int_equal(lp_imager_add(imager, scene_frame(1920, 960, &discs[k], 1, 0.5)),
				 0);
		/* the cells around it, as a finder would hand them over */
		const int centre = lp_grid_cell(lp_imager_grid(imager),
						(float[]){(float)d[0], (float)d[1], (float)d[2]});
		finder.cells = cells;
		if (centre / 240 < 3) {
			for (int i = 0; i < 4 * 240; i++)
				cells[lamp.count++] = i;
		} else {
			for (int r = -2; r <= 2; r++)
				for (int c = -2; c <= 2; c++)
					cells[lamp.count++] = (centre / 240 + r) * 240 +
							      (centre % 240 + c + 240) % 240;
		}
		for (int c = 0; c < 4; c++)
			lamp.background[c] = 0.5F;
		lp_grid_direction(lp_imager_grid(imager), centre, grid_direction);
		memcpy(lamp.direction, grid_direction, sizeof(grid_direction));
		assert_false(lp_imager_refine(imager, &finder, &lamp, 4)); /* too many cells */
		assert_true(lp_imager_refine(imager, &finder, &lamp, 1024));
		assert_true(angle_between_deg(d, lamp.direction) < 0.01);
		assert_float_equal(lamp.irradiance[3] / disc_irradiance(&discs[k]), 1.0, 0.02);
		assert_true(lamp.direction_sigma_deg > 0.0F && lamp.direction_sigma_deg < 0.05F);
		/* rim pixels make the smallest look larger; the others are right */
		assert_true(lamp.solid_angle_sr * discs[k].radiance / disc_irradiance(&discs[k]) <
			    (discs[k].radius_deg < 0.3 ? 1.6 : 1.25));
		lp_imager_destroy(imager);
	}
}

/* Three clipped pixels in a bright block: its mean and detail do not show them, its pixels do. */
static void test_few_clipped_pixels_are_seen(void **state)
{
	const struct lp_imager_options options = {.panorama_width = 240,
						  .decode = LP_DECODE_BLOCKS,
						  .divisor = 1};

	(void)state;
	for (int code = 240; code <= 255; code += 15) {
		struct lp_frame *frame = new_frame(LP_FORMAT_GREY, 1920, 960, 1920, 1920 * 960);
		uint8_t *luma = (uint8_t *)frame->data;
		struct lp_lamp_finder finder = {0};
		struct lp_lamp lamp = {.count = 1};
		struct lp_imager *imager;

		assert_int_equal(lp_imager_create(camera, &options, &imager), 0);
		memset(luma, 137, 1920 * 960);
		memset(luma + 486 * 1920 + 964, code, 3);
		assert_int_equal(lp_imager_add(imager, frame), 0);
		int32_t cell = lp_grid_cell(lp_imager_grid(imager), (float[]){0.02F, -0.02F, -1});

		lp_grid_direction(lp_imager_grid(imager), cell, lamp.direction);
		finder.cells = &cell;
		for (int c = 0; c < 4; c++)
			lamp.background[c] = lp_imager_panorama(imager)->cells[cell + 30][c];
		lamp.peak = lp_imager_panorama(imager)->cells[cell][3];
		assert_true(lamp.peak > 1.05F * lamp.background[3]);
		assert_true(lp_imager_refine(imager, &finder, &lamp, 64));
		assert_int_equal(lamp.flags & LP_LIGHT_CLIPPED, code == 255 ? LP_LIGHT_CLIPPED : 0);
		lp_imager_destroy(imager);
	}
}

/* One lens in the middle of the picture, its circle full of small lamps, and something beside it.
 */
static struct lp_frame *circle(int side, double radius, int beside)
{
	struct lp_frame *frame = new_frame(LP_FORMAT_GREY, side, side, side, (size_t)side * side);
	uint8_t *data = (uint8_t *)frame->data;

	for (int y = 0; y < side; y++)
		for (int x = 0; x < side; x++) {
			const double r = hypot(x + 0.5 - side / 2.0, y + 0.5 - side / 2.0);
			const bool inside = r < radius + 16.0; /* blocks on its rim, too */
			const bool dot = x % 32 == 3 && y % 32 == 5;

			data[y * side + x] = inside ? (dot ? 200 : 20) : (x ^ y) & 1 ? beside : 0;
		}
	frame->exposure_us = 1e6F;
	return frame;
}

/* Neither its light nor its detail: blocks with detail are looked at closely, as far as time
 * allows.
 */
static void test_what_lies_beside_the_circle_counts_nowhere(void **state)
{
	const int side = 480;
	struct lp_camera lens = {.projection = LP_FISHEYE,
				 .width_px = side,
				 .height_px = side,
				 .lens_count = 1};
	struct lp_imager_options options = {.panorama_width = 160,
					    .decode = LP_DECODE_BLOCKS,
					    .divisor = 1,
					    .exact_blocks = 64};
	struct lp_imager *imagers[2];
	struct lp_imager_status status[2];

	(void)state;
	lens.lens[0] = (struct lp_lens){.cx_px = 240,
					.cy_px = 240,
					.fx_px = 110,
					.fy_px = 110,
					.max_theta_rad = 1.6F,
					.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
	for (int k = 0; k < 2; k++) {
		assert_int_equal(lp_imager_create(&lens, &options, &imagers[k]), 0);
		assert_int_equal(lp_imager_add(imagers[k], circle(side, 110 * 1.6, 255 * k)), 0);
		lp_imager_status(imagers[k], &status[k]);
	}
	assert_float_equal(status[0].mean_code, 20.2, 1.0);
	assert_float_equal(status[1].mean_code, status[0].mean_code, 0);
	assert_float_equal(lp_imager_panorama(imagers[1])->clipped_fraction, 0, 0);
	for (int i = 0; i < 160 * 80; i++)
		assert_memory_equal(lp_imager_panorama(imagers[0])->cells[i],
				    lp_imager_panorama(imagers[1])->cells[i], 16);
	lp_imager_destroy(imagers[0]);
	lp_imager_destroy(imagers[1]);
}

static int frames_out;

static void count_back(struct lp_frame *frame)
{
	frames_out--;
	free_test_frame(frame);
}

/* A bracket that keeps changing holds no more of a source's raw frames than it is told to have. */
static void test_frames_held(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);

	(void)state;
	for (int k = 0; k < 60; k++) {
		struct lp_frame *frame =
			raw_gradient(LP_FORMAT_YUYV, 480, 240, 0.5 * pow(0.6, k % 13));

		frame->release = count_back;
		frames_out++;
		assert_true(frames_out <= LP_FRAMES_HELD);
		assert_int_equal(lp_imager_add(imager, frame), 0);
	}
	assert_true(frames_out > 0);
	lp_imager_destroy(imager);
	assert_int_equal(frames_out, 0);
}

/* A refused frame leaves what there was. */
static void test_bad_frames(void **state)
{
	const struct jpeg_kind kind = {3, 2, 2, 90, 0, 0, 0};
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);
	struct lp_frame *frame;
	struct capture capture;
	float before;

	(void)state;
	assert_int_equal(lp_imager_add(imager, raw_gradient(LP_FORMAT_GREY, 480, 240, 0.2)), 0);
	before = lp_imager_panorama(imager)->cells[5000][1];
	capture_begin(&capture);

	frame = raw_gradient(LP_FORMAT_YUYV, 480, 240, 0.1);
	frame->size_bytes -= 1; /* short */
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	frame = raw_gradient(LP_FORMAT_NV12, 480, 240, 0.1);
	frame->size_bytes = 480 * 240; /* chroma is missing */
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	frame = raw_gradient(LP_FORMAT_GREY, 480, 240, 0.1);
	frame->stride_bytes = 100;
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	frame = raw_gradient(LP_FORMAT_GREY, 480, 240, 0.1);
	frame->exposure_us = -3.0F;
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	frame = raw_gradient(LP_FORMAT_GREY, 480, 240, 0.1);
	frame->width_px = 0;
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	frame = jpeg_frame(&kind, 480, 240);
	frame->size_bytes /= 2;
	assert_int_equal(lp_imager_add(imager, frame), -EBADMSG);
	assert_float_equal(lp_imager_panorama(imager)->cells[5000][1], before, 0.0);
	(void)capture_end(&capture);
	lp_imager_destroy(imager);
}

/* NaN and negative samples are left out, and said so. */
static void test_invalid_samples(void **state)
{
	struct lp_imager *imager = new_imager(LP_DECODE_PIXELS);
	struct lp_frame *frame = new_float_frame(960, 480);
	float *rgb = (float *)frame->data;
	struct lp_imager_status status;

	(void)state;
	for (int i = 0; i < 960 * 480 * 3; i++)
		rgb[i] = 2.0F;
	rgb[3 * 1000] = NAN;
	rgb[3 * 50000 + 1] = -INFINITY;
	rgb[3 * 100000 + 2] = -1.0F;
	for (int y = 100; y < 104; y++) /* a whole cell */
		for (int x = 200; x < 204; x++)
			rgb[3 * (y * 960 + x)] = NAN;
	assert_int_equal(lp_imager_add(imager, frame), 0);
	lp_imager_status(imager, &status);
	assert_true(status.invalid_samples);
	assert_false(status.exposure_unknown); /* float frames are radiance */
	for (int i = 0; i < 240 * 120; i++)
		for (int c = 0; c < 4; c++) {
			const int whole = i / 240 == 25 && i % 240 == 50;

			assert_float_equal(lp_imager_panorama(imager)->cells[i][c],
					   whole ? 0.0 : 2.0, 1e-5);
		}
	lp_imager_destroy(imager);
}

/* Infinity is light beyond the largest half float, or beyond what is brighter: a lower bound. */
static void test_infinity_is_saturated(void **state)
{
	(void)state;
	for (int k = 0; k < 2; k++) {
		const float brightest = k ? 2e5F : 2.0F, least = k ? 2e5F : 65504.0F;
		struct lp_imager *imager = new_imager(LP_DECODE_PIXELS);
		struct lp_frame *frame = new_float_frame(960, 480);
		float *rgb = (float *)frame->data;
		struct lp_imager_status status;

		for (int i = 0; i < 960 * 480 * 3; i++)
			rgb[i] = 2.0F;
		for (int y = 100; y < 104; y++) /* a whole cell */
			for (int x = 200; x < 204; x++)
				for (int c = 0; c < 3; c++)
					rgb[3 * (y * 960 + x) + c] = INFINITY;
		rgb[3 * 50000 + 1] = INFINITY; /* of another one, one channel of one pixel */
		frame->brightest = brightest;
		assert_int_equal(lp_imager_add(imager, frame), 0);
		lp_imager_status(imager, &status);
		assert_false(status.invalid_samples);
		const struct lp_panorama *panorama = lp_imager_panorama(imager);
		const int whole = 25 * 240 + 50, part = 50000 / 960 / 4 * 240 + 50000 % 960 / 4;

		for (int i = 0; i < 240 * 120; i++)
			assert_int_equal(panorama->flags[i] & LP_CELL_CLIPPED,
					 i == whole || i == part ? LP_CELL_CLIPPED : 0);
		assert_float_equal(panorama->cells[whole][0], least, least * 1e-5);
		assert_float_equal(panorama->cells[part][1], (least + 30) / 16, least / 160);
		assert_float_equal(panorama->cells[part][0], 2.0, 1e-4);
		lp_imager_destroy(imager);
	}
}

/* The picture may change its size in mid-stream. */
static void test_size_changes(void **state)
{
	const int sizes[][2] = {{480, 240}, {16, 8}, {1920, 960}, {2, 2}, {250, 125}, {480, 240}};
	struct lp_imager *imager = new_imager(LP_DECODE_BLOCKS);

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(sizes); k++) {
		struct lp_frame *frame = new_float_frame(sizes[k][0], sizes[k][1]);

		for (int i = 0; i < sizes[k][0] * sizes[k][1] * 3; i++)
			((float *)frame->data)[i] = 7.0F;
		assert_int_equal(lp_imager_add(imager, frame), 0);
		for (int i = 0; i < 240 * 120; i++)
			assert_float_equal(lp_imager_panorama(imager)->cells[i][3], 7.0, 1e-4);
	}
	lp_imager_destroy(imager);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_exposures_from_before_a_turn_do_not_count),
		cmocka_unit_test(test_exposure_is_divided_out),
		cmocka_unit_test(test_gain_counts_as_exposure),
		cmocka_unit_test(test_bracket),
		cmocka_unit_test(test_what_clips_in_the_shortest_exposure),
		cmocka_unit_test(test_a_set_of_many_exposures),
		cmocka_unit_test(test_match),
		cmocka_unit_test(test_unknown_exposure_is_full_scale),
		cmocka_unit_test(test_jpeg_against_its_own_pixels),
		cmocka_unit_test(test_raw_blocks_against_pixels),
		cmocka_unit_test(test_refinement),
		cmocka_unit_test(test_few_clipped_pixels_are_seen),
		cmocka_unit_test(test_what_lies_beside_the_circle_counts_nowhere),
		cmocka_unit_test(test_frames_held),
		cmocka_unit_test(test_bad_frames),
		cmocka_unit_test(test_invalid_samples),
		cmocka_unit_test(test_infinity_is_saturated),
		cmocka_unit_test(test_size_changes),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
