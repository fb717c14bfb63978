/* SPDX-License-Identifier: Apache-2.0 */
/* Camera files, projection, and the mapping of camera cells onto the panorama. */
#include "vision/camera/camera.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "include/panorama.h"
#include "include/processing.h"
#include "light/math/grid.h"
#include "lp_test.h"
#include "camera_file_test.h"
#include "scene.h"
#include "vision/camera/camera_file.h"
#include "vision/camera/remap.h"
#include "vision/picture/cells.h"

static const char dual_fisheye[] = "# two lenses back to back\n"
				   "[camera]\n"
				   "name = test dual\n"
				   "projection = fisheye\n"
				   "width_px = 1280\n"
				   "height_px = 720\n"
				   "[lens.0]\n"
				   "cx_px = 320\ncy_px = 360\nfx_px = 183\nfy_px = 184\n"
				   "k1 = 0.02\nk2 = -0.004\nmax_theta_deg = 97\n"
				   "rolloff = -0.05, 0.01\n"
				   "[lens.1]\n"
				   "cx_px = 960\ncy_px = 358\nfx_px = 183\nfy_px = 183\n"
				   "max_theta_deg = 97\n"
				   "rotation_wxyz = 0, 0, 1, 0\n"
				   "[v4l2]\n"
				   "fps = 30\n";

static char path[] = "/tmp/lp_camera_XXXXXX";

static void write_file(const char *text)
{
	FILE *file = fopen(path, "w");

	assert_non_null(file);
	fputs(text, file);
	fclose(file);
}

static int load_file(const char *name, struct lp_camera **camera)
{
	struct lp_camera_file *file;
	int ret = lp_camera_file_read(name, &file);

	if (ret < 0)
		return ret;
	ret = lp_camera_create(file, camera);
	lp_camera_file_destroy(file);
	return ret;
}

static struct lp_camera *load(const char *text)
{
	struct lp_camera *camera;

	write_file(text);
	assert_int_equal(load_file(path, &camera), 0);
	return camera;
}

static void test_pixels_and_rays_are_inverse(void **state)
{
	struct lp_camera *camera = load(dual_fisheye);
	int seen = 0;

	(void)state;
	assert_int_equal(camera->lens_count, 2);
	for (int y = 4; y < 360; y += 7) /* at half the size that the file speaks of */
		for (int x = 4; x < 640; x += 7) {
			double d[3], pixel[2], share, illumination;
			int lens;

			if (!lp_camera_ray(camera, 640, 360, x, y, d, &lens))
				continue;
			seen++;
			assert_float_equal(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], 1.0, 1e-9);
			assert_true(lp_camera_project(camera, lens, 640, 360, d, pixel, &share,
						      &illumination));
			assert_float_equal(pixel[0], x, 1e-5);
			assert_float_equal(pixel[1], y, 1e-5);
		}
	assert_true(seen > 2000);
	lp_camera_destroy(camera);
}

/* The optical axes look where the file says: lens 0 along -Z, lens 1 turned by half a turn about
 * +Y. */
static void test_axes(void **state)
{
	struct lp_camera *camera = load(dual_fisheye);
	double d[3];
	int lens;

	(void)state;
	assert_true(lp_camera_ray(camera, 1280, 720, 320, 360, d, &lens));
	assert_float_equal(d[2], -1.0, 1e-9);
	assert_true(lp_camera_ray(camera, 1280, 720, 960, 358, d, &lens));
	assert_float_equal(d[2], 1.0, 1e-6);
	assert_true(lp_camera_ray(camera, 1280, 720, 420, 360, d, &lens)); /* right is +X */
	assert_true(d[0] > 0.4);
	assert_true(lp_camera_ray(camera, 1280, 720, 320, 260, d, &lens)); /* up is +Y */
	assert_true(d[1] > 0.4);
	assert_true(
		lp_camera_ray(camera, 1280, 720, 1060, 358, d, &lens)); /* behind: right is -X */
	assert_true(d[0] < -0.4);
	assert_false(lp_camera_ray(camera, 1280, 720, 3, 3, d, &lens)); /* dark corner */
	lp_camera_destroy(camera);
}

static void test_pixel_solid_angles(void **state)
{
	struct lp_camera *camera = load(dual_fisheye);
	struct lp_camera *equirect;
	const double cap = 2.0 * M_PI * (1.0 - cos(97.0 * TEST_DEG));
	double sum = 0.0;

	(void)state;
	for (int y = 0; y < 720; y++)
		for (int x = 0; x < 1280; x++)
			sum += lp_camera_pixel_solid_angle_sr(camera, 1280, 720, x + 0.5, y + 0.5);
	assert_float_equal(sum / (2.0 * cap), 1.0, 0.002);
	lp_camera_destroy(camera);

	assert_int_equal(lp_camera_create(NULL, &equirect), 0);
	sum = 0.0;
	for (int y = 0; y < 45; y++)
		for (int x = 0; x < 90; x++)
			sum += lp_camera_pixel_solid_angle_sr(equirect, 90, 45, x + 0.5, y + 0.5);
	assert_float_equal(sum, 4.0 * M_PI, 1e-9);
	lp_camera_destroy(equirect);
}

/* A part of an equirectangular picture, also across the seam: what a pixel sees is where it is in
 * the whole one. */
static void test_part_of_a_sphere(void **state)
{
	static const struct lp_crop crops[] = {{0.25F, 0.25F, 0.5F, 0.5F},
					       {0.875F, 0.0F, 0.5F, 1.0F},
					       {0.0F, 0.5F, 1.0F, 0.5F}};
	struct lp_camera *whole, *part;

	(void)state;
	assert_int_equal(lp_camera_create(NULL, &whole), 0);
	assert_int_equal(lp_camera_create(NULL, &part), 0);
	for (unsigned int k = 0; k < LP_COUNT(crops); k++) {
		const struct lp_crop *c = &crops[k];
		const int width = (int)(800 * c->width), height = (int)(400 * c->height);
		double sum = 0.0, other, d[3], e[3], pixel[2], share, illumination;
		int lens;

		part->crop = *c;
		for (int i = 0; i < width * height; i++) {
			const double x = i % width + 0.5, y = i / width + 0.5;

			assert_true(lp_camera_ray(part, width, height, x, y, d, &lens));
			assert_true(lp_camera_ray(whole, 800, 400,
						  fmod(x + 800 * (double)c->left, 800),
						  y + 400 * (double)c->top, e, &lens));
			assert_true(lp_camera_project(part, 0, width, height, d, pixel, &share,
						      &illumination));
			for (int a = 0; a < 3; a++)
				assert_float_equal(d[a], e[a], 1e-9);
			assert_float_equal(pixel[0], x, 1e-6);
			assert_float_equal(pixel[1], y, 1e-6);
			sum += lp_camera_pixel_solid_angle_sr(part, width, height, x, y);
		}
		other = (double)c->width * 2.0 * M_PI *
			(cos(M_PI * (double)c->top) - cos(M_PI * (double)(c->top + c->height)));
		assert_float_equal(sum, other, 1e-6);
		assert_int_equal(lp_camera_circle_px(part, width), 800);
		/* what is in front of the picture's middle is seen, what is behind it is not */
		lp_camera_ray(part, width, height, width / 2.0, height / 2.0, d, &lens);
		for (int a = 0; a < 3; a++)
			d[a] = -d[a];
		assert_false(
			lp_camera_project(part, 0, width, height, d, pixel, &share, &illumination));
	}
	lp_camera_destroy(part);
	lp_camera_destroy(whole);
}

/* A mask leaves pixels of an equirectangular picture out, of whatever size the picture is. */
static void test_mask_of_a_panorama(void **state)
{
	char mask[] = "/tmp/lp_mask_XXXXXX", text[128];
	double d[3], pixel[2], share, illumination;
	int lens;

	(void)state;
	FILE *file = fdopen(mkstemp(mask), "wb");

	assert_non_null(file);
	fputs("P5 4 2 255\n\xff\xff\xff\xff\xff\xff\xff", file); /* not the last pixel */
	fputc(0, file);
	fclose(file);
	snprintf(text, sizeof(text),
		 "[camera]\nprojection = equirect\nwidth_px = 4\nheight_px = 2\nmask = %s\n", mask);
	struct lp_camera *camera = load(text);

	assert_false(lp_camera_is_whole(camera));
	for (int y = 0; y < 20; y++)
		for (int x = 0; x < 40; x++) {
			const bool seen = x < 30 || y < 10;

			assert_int_equal(lp_camera_ray(camera, 40, 20, x + 0.5, y + 0.5, d, &lens),
					 seen);
			assert_int_equal(lp_camera_project(camera, 0, 40, 20, d, pixel, &share,
							   &illumination),
					 seen);
		}
	lp_camera_destroy(camera);
	unlink(mask);
}

/* A camera's cells under a uniform sky, roll-off included. */
static void fill_uniform(struct lp_cells *cells, const struct lp_camera *camera, int width_px,
			 int height_px, int cell_px)
{
	const int width = (width_px + cell_px - 1) / cell_px;
	const int height = (height_px + cell_px - 1) / cell_px;

	assert_int_equal(lp_cells_reserve(cells, width, height, cell_px), 0);
	for (int i = 0; i < width * height; i++) {
		double d[3], pixel[2], share, illumination = 1.0;
		int lens;

		if (lp_camera_ray(camera, width_px, height_px, (i % width + 0.5) * cell_px,
				  (i / width + 0.5) * cell_px, d, &lens))
			lp_camera_project(camera, lens, width_px, height_px, d, pixel, &share,
					  &illumination);
		for (int c = 0; c < 4; c++)
			cells->radiance[i][c] = (float)illumination;
		cells->clipped[i] = 0;
	}
}

static void test_uniform_stays_uniform(void **state)
{
	const struct {
		int width, height, cell, panorama;
	} cases[] = {{1920, 960, 8, 240}, {1024, 512, 4, 240}, {3840, 1920, 8, 240},
		     {1000, 500, 8, 240}, {16, 8, 1, 16},      {1280, 720, 8, 240},
		     {640, 360, 4, 120},  {7680, 3840, 8, 480}};
	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(cases); k++) {
		const int fisheye = cases[k].height * 2 != cases[k].width;
		struct lp_camera *camera;
		struct lp_panorama panorama = new_panorama(cases[k].panorama);
		struct lp_cells cells = {0};
		struct lp_remap *remap;

		if (fisheye)
			camera = load(dual_fisheye);
		else
			assert_int_equal(lp_camera_create(NULL, &camera), 0);
		assert_int_equal(lp_remap_create(camera, cases[k].width, cases[k].height,
						 cases[k].cell, cases[k].panorama, &remap),
				 0);
		fill_uniform(&cells, camera, cases[k].width, cases[k].height, cases[k].cell);
		lp_remap_apply(remap, &cells, &panorama);
		assert_float_equal(panorama.seen_fraction, 1.0, 0.0);
		for (int i = 0; i < panorama.width * panorama.height; i++)
			assert_float_equal((remap->identity ? cells.radiance
							    : panorama.cells)[i][1],
					   1.0, fisheye ? 0.01 : 1e-5);
		lp_remap_destroy(remap);
		lp_cells_release(&cells);
		lp_camera_destroy(camera);
		free_panorama(&panorama);
	}
}

/* One bright camera cell gives the panorama the light it holds, wherever it looks. */
static void test_light_is_kept(void **state)
{
	const struct {
		int width, height, cell, panorama;
		double tolerance;
	} cases[] = {{1024, 512, 4, 240, 1e-5},
		     {1000, 500, 8, 240, 1e-5},
		     {1280, 720, 8, 240, 0.08}};

	(void)state;
	srand(4);
	for (unsigned int k = 0; k < LP_COUNT(cases); k++) {
		const int fisheye = k == 2;
		struct lp_camera *camera;
		struct lp_panorama panorama = new_panorama(cases[k].panorama);
		struct lp_cells cells = {0};
		struct lp_remap *remap;
		struct lp_grid *grid;
		int tried = 0;

		if (fisheye)
			camera = load(dual_fisheye);
		else
			assert_int_equal(lp_camera_create(NULL, &camera), 0);
		assert_int_equal(lp_grid_create(cases[k].panorama, cases[k].panorama / 2, &grid),
				 0);
		assert_int_equal(lp_remap_create(camera, cases[k].width, cases[k].height,
						 cases[k].cell, cases[k].panorama, &remap),
				 0);
		fill_uniform(&cells, camera, cases[k].width, cases[k].height, cases[k].cell);
		memset(cells.radiance, 0, sizeof(*cells.radiance) * cells.width * cells.height);
		while (tried < 200) {
			const int cell = rand() % (cells.width * cells.height);
			const int x0 = cell % cells.width * cases[k].cell;
			const int y0 = cell / cells.width * cases[k].cell;
			double holds = 0.0, got = 0.0, d[3], pixel[2], share, illumination = 1.0;
			int lens, inside = 1;

			for (int y = y0; y < y0 + cases[k].cell && y < cases[k].height; y++)
				for (int x = x0; x < x0 + cases[k].cell && x < cases[k].width; x++)
					holds += lp_camera_pixel_solid_angle_sr(camera,
										cases[k].width,
										cases[k].height,
										x + 0.5, y + 0.5);
			if (fisheye) { /* away from seam and rim, where a lens serves in part */
				inside = lp_camera_ray(camera, 1280, 720, x0 + 4, y0 + 4, d,
						       &lens) &&
					 fabs(d[2]) > sin(15.0 * TEST_DEG) &&
					 (lens == 0) == (d[2] < 0);
				if (inside)
					lp_camera_project(camera, lens, 1280, 720, d, pixel, &share,
							  &illumination);
			}
			if (!inside)
				continue;
			tried++;
			cells.radiance[cell][1] = 1.0F;
			lp_remap_apply(remap, &cells, &panorama);
			cells.radiance[cell][1] = 0.0F;
			for (int i = 0; i < panorama.width * panorama.height; i++)
				got += (double)panorama.cells[i][1] *
				       lp_grid_solid_angle_sr(grid, i);
			assert_float_equal(got * illumination / holds, 1.0, cases[k].tolerance);
		}
		lp_remap_destroy(remap);
		lp_grid_destroy(grid);
		lp_cells_release(&cells);
		lp_camera_destroy(camera);
		free_panorama(&panorama);
	}
}

static void test_one_lens_sees_a_part(void **state)
{
	const char *text = "[camera]\nprojection = fisheye\nwidth_px = 720\nheight_px = 720\n"
			   "[lens.0]\ncx_px = 360\ncy_px = 360\nfx_px = 220\nfy_px = 220\n"
			   "max_theta_deg = 90\nrotation_wxyz = 1, 1, 0, 0\n"; /* looks up */
	struct lp_camera *camera = load(text);
	struct lp_panorama panorama = new_panorama(240);
	struct lp_cells cells = {0};
	struct lp_remap *remap;

	(void)state;
	assert_int_equal(lp_remap_create(camera, 720, 720, 8, 240, &remap), 0);
	assert_float_equal(remap->seen_fraction, 0.5, 0.02);
	fill_uniform(&cells, camera, 720, 720, 8);
	lp_remap_apply(remap, &cells, &panorama);
	assert_false(panorama.flags[10 * 240 + 17] & LP_CELL_UNSEEN);
	assert_true(panorama.flags[100 * 240 + 17] & LP_CELL_UNSEEN);
	lp_remap_destroy(remap);
	lp_cells_release(&cells);
	lp_camera_destroy(camera);
	free_panorama(&panorama);
}

#define PHONE                                                               \
	"[camera]\nprojection = pinhole\nwidth_px = 360\nheight_px = 640\n" \
	"[lens.0]\ncx_px = 182\ncy_px = 317\nfx_px = 500\nfy_px = 505\n"

/* Scaled pictures are the camera's, those of another shape are not: of them nobody knows which part
 * of the lens they show. */
static void test_the_shape_of_a_picture(void **state)
{
	struct lp_camera *phone = load(PHONE), *whole = load("[camera]\nprojection = equirect\n");

	(void)state;
	assert_true(lp_camera_has_shape(phone, 360, 640));
	assert_true(lp_camera_has_shape(phone, 1080, 1920));
	assert_true(lp_camera_has_shape(phone, 1080, 1936)); /* an encoder's blocks */
	assert_false(lp_camera_has_shape(phone, 640, 360));
	assert_false(lp_camera_has_shape(phone, 360, 480));
	assert_false(lp_camera_has_shape(phone, 366, 640));
	assert_true(lp_camera_has_shape(whole, 100, 77));
	lp_camera_destroy(whole);
	lp_camera_destroy(phone);
}

/* OpenCV's model: the tangent of the angle, distorted; the picture is a rectangle of the sphere. */
static void test_an_ordinary_camera(void **state)
{
	struct lp_camera *plain = load(PHONE);
	struct lp_camera *camera = load(PHONE "distortion = 0.1, -0.2, 0.001, -0.002, 0.05\n"
					      "rolloff = -0.2\nrotation_wxyz = 1, 0, 1, 0\n");
	const double d[3] = {0.1 / sqrt(1.05), 0.2 / sqrt(1.05), -1.0 / sqrt(1.05)};
	const double behind[3] = {-d[0], -d[1], -d[2]};
	double pixel[2], share, illumination, ray[3], sum = 0.0;
	int lens;

	(void)state;
	assert_true(lp_camera_project(plain, 0, 360, 640, d, pixel, &share, &illumination));
	assert_float_equal(pixel[0], 182 + 500 * 0.1, 1e-6);
	assert_float_equal(pixel[1], 317 - 505 * 0.2, 1e-6);
	assert_false(lp_camera_project(plain, 0, 360, 640, behind, pixel, &share, &illumination));
	assert_false(lp_camera_is_whole(camera));
	for (int y = 0; y < 320; y++) /* at half the size that the file speaks of */
		for (int x = 0; x < 180; x++) {
			assert_true(lp_camera_ray(camera, 180, 320, x + 0.5, y + 0.5, ray, &lens));
			assert_true(lp_camera_project(camera, lens, 180, 320, ray, pixel, &share,
						      &illumination));
			assert_float_equal(pixel[0], x + 0.5, 1e-3);
			assert_float_equal(pixel[1], y + 0.5, 1e-3);
			assert_true(illumination <= 1.0 && illumination > 0.85);
			sum += lp_camera_pixel_solid_angle_sr(plain, 180, 320, x + 0.5, y + 0.5);
		}
	/* of a rectangle, from the four parts between its sides and the axis */
	const double left = 182 / 500.0, right = 178 / 500.0, up = 317 / 505.0, down = 323 / 505.0;
	const double sides[2] = {left, right}, heights[2] = {up, down};
	double truth = 0.0;

	for (int i = 0; i < 4; i++) {
		const double a = sides[i % 2], b = heights[i / 2];

		truth += atan(a * b / sqrt(1.0 + a * a + b * b));
	}
	assert_float_equal(sum, truth, 1e-4);
	assert_true(
		lp_camera_ray(camera, 360, 640, 182, 317, ray, &lens)); /* a quarter turn left */
	assert_true(ray[0] < -0.999);
	assert_float_equal(lp_camera_pixel_rad(plain, 180, 320), 2.0 / 500, 1e-9);
	lp_camera_destroy(camera);
	lp_camera_destroy(plain);
}

/* Each broken file: refused, with its name, where, and what would be right. */
static void test_broken_files(void **state)
{
	const struct {
		const char *text, *says;
	} cases[] = {
		{"", "needs projection"},
		{"[camera]\nprojection = cubic\n", ":2"},
		{"[camera]\nprojection = fisheye\n", "needs width_px"},
		{"[camera]\nprojection = fisheye\nwidth_px = 64\nheight_px = 64\n",
		 "needs a [lens.0]"},
		{"[camera]\nprojection = equirect\nheigth_px = 64\n", "heigth_px"},
		{"[camera]\nversion = 2\nprojection = equirect\n", "version"},
		{"[lens.9]\ncx_px = 1\n", "lens.9"},
		{"[camera]\nprojection equirect\n", ":2: parse: neither"},
		{"[camera]\nprojection = fisheye\nwidth_px = 64\nheight_px = 64\n[lens.0]\ncx_px = "
		 "3\n",
		 "max_theta_deg"},
		{"[camera]\nprojection = fisheye\nwidth_px = 64\nheight_px = 64\n[lens.0]\n"
		 "cx_px = 32\ncy_px = 32\nfx_px = 20\nfy_px = 20\nmax_theta_deg = 90\nk1 = -3\n",
		 "stops growing"},
		{PHONE "k1 = 0.1\n", "projection = pinhole needs one"},
		{"[camera]\nprojection = pinhole\nwidth_px = 360\nheight_px = 640\n[lens.0]\n"
		 "cx_px = 180\nfx_px = 500\nfy_px = 505\n",
		 ""}, /* it has just been said */
		{"[camera]\nprojection = fisheye\nwidth_px = 64\nheight_px = 64\n[lens.0]\n"
		 "fx_px = 20\nfy_px = 20\nmax_theta_deg = 90\n",
		 ""}, /* likewise */
		{PHONE "distortion = -4\n", "two places"},
		{"[camera]\nprojection = fisheye\nwidth_px = 64\nheight_px = 64\n[lens.0]\n"
		 "cx_px = 32\ncy_px = 32\nfx_px = 20\nfy_px = 20\nmax_theta_deg = 90\n"
		 "distortion = 0.1\n",
		 "of projection = pinhole"},
		{"[camera]\nprojection = equirect\n[response]\ntable = /nonexistent.txt\n",
		 "/nonexistent.txt"},
	};

	(void)state;
	for (unsigned int k = 0; k < LP_COUNT(cases); k++) {
		struct lp_camera *camera = NULL;
		struct capture capture;
		const char *said;

		write_file(cases[k].text);
		capture_begin(&capture);
		const int ret = load_file(path, &camera);
		said = capture_end(&capture);
		assert_true(ret == -EBADMSG || ret == -ENOENT);
		assert_contains(said, cases[k].says);
	}
	struct lp_camera *camera;
	struct capture capture;

	capture_begin(&capture);
	assert_int_equal(load_file("/nonexistent.camera", &camera), -ENOENT);
	assert_contains(capture_end(&capture), "/nonexistent.camera");
	lp_camera_destroy(NULL);
}

/* Each line is one line, however long: its tail is no setting of its own. */
static void test_processing_of_a_file(void **state)
{
	static const char *const wrong[] = {"", "sharp", "sharpness; gamma", "none, gamma",
					    "sharpness-"};
	struct lp_camera_file *file;
	char text[100];

	(void)state;
	assert_int_equal(read_camera_file("[response]\nprocessing = gamma, sharpness\n", &file), 0);
	assert_true(file->tells_processing);
	assert_int_equal(file->processing, LP_PROCESSING_BIT(LP_PROCESSING_GAMMA) |
						   LP_PROCESSING_BIT(LP_PROCESSING_SHARPNESS));
	lp_camera_file_destroy(file);
	assert_int_equal(read_camera_file("[response]\nprocessing = none\n", &file), 0);
	assert_true(file->tells_processing);
	assert_int_equal(file->processing, 0);
	lp_camera_file_destroy(file);
	assert_int_equal(read_camera_file("[response]\n", &file), 0);
	assert_false(file->tells_processing);
	lp_camera_file_destroy(file);
	for (size_t i = 0; i < LP_COUNT(wrong); i++) {
		(void)snprintf(text, sizeof(text), "[response]\nprocessing = %s\n", wrong[i]);
		assert_int_equal(read_camera_file(text, &file), -EBADMSG);
	}
}

/* Every driver that reads settings from a camera file (docs/users/cameras.md) has its section
 * there. */
static void test_settings_of_every_driver(void **state)
{
	static const char *const schemes[] = {"v4l2", "libcamera", "osc", "ptp"};
	struct lp_camera_file *file;
	char text[100];

	(void)state;
	for (size_t i = 0; i < LP_COUNT(schemes); i++) {
		(void)snprintf(text, sizeof(text), "[%s]\nsomething = 1\n", schemes[i]);
		assert_int_equal(read_camera_file(text, &file), 0);
		assert_true(lp_ini_has(&file->ini, schemes[i]));
		lp_camera_file_destroy(file);
	}
}

static void test_long_lines(void **state)
{
	char text[512];
	struct capture capture;
	struct lp_camera *camera;

	(void)state;
	(void)snprintf(text, sizeof(text),
		       "[camera]\nprojection = equirect\n# %0197dwidth_px = 70000\n", 0);
	lp_camera_destroy(load(text));
	(void)snprintf(text, sizeof(text),
		       "[camera]\nprojection = equirect\nname = %0192dwidth_px = 70\n", 0);
	write_file(text);
	capture_begin(&capture);
	assert_int_equal(load_file(path, &camera), -EBADMSG);
	assert_contains(capture_end(&capture), ":3: parse: a line has at most 198 bytes");
}

/* Rows of pixels beside the camera file; what is no such row, or beyond the picture, is refused. */
static void test_stuck_pixels_are_read(void **state)
{
	static const struct {
		const char *rows;
		int count; /* -1: refused */
	} files[] = {{"", 0},	     {"3 1\n0 0\n", 2}, {"3 1\n4 0\n", -1}, {"3 1\n2", -1},
		     {"3 1\nx", -1}, {"-1 0", -1},	{"nan 0", -1}};

	(void)state;
	for (size_t k = 0; k < sizeof(files) / sizeof(*files); k++) {
		char rows[] = "/tmp/lp_rows_XXXXXX", text[160];
		struct capture capture;
		struct lp_camera *camera;
		FILE *file = fdopen(mkstemp(rows), "w");

		assert_non_null(file);
		fputs(files[k].rows, file);
		fclose(file);
		snprintf(text, sizeof(text),
			 "[camera]\nprojection = equirect\nwidth_px = 4\nheight_px = 2\n"
			 "stuck_pixels = %s\n",
			 rows);
		write_file(text);
		capture_begin(&capture);
		const int ret = load_file(path, &camera);
		const char *log = capture_end(&capture);

		assert_int_equal(ret, files[k].count < 0 ? -EBADMSG : 0);
		if (ret < 0)
			assert_non_null(strstr(log, "stuck_pixels"));
		if (ret == 0) {
			assert_int_equal(camera->stuck_count, files[k].count);
			assert_true(!files[k].count || camera->stuck_px[0][0] == 3.0F);
			lp_camera_destroy(camera);
		}
		unlink(rows);
	}
}

/* Shares of glare, within their bounds; what is left out is as usual. */
static void test_glare_of_a_file(void **state)
{
	static const struct {
		const char *text, *key; /* key: of what is wrong; NULL: nothing is */
		float even, around, width_deg;
	} files[] = {
		{"", NULL, 0.0F, 0.0F, 10.0F},
		{"[glare]\n", NULL, 0.0F, 0.0F, 10.0F},
		{"[glare]\neven = 0.01\naround = 0.02\nwidth_deg = 7\n", NULL, 0.01F, 0.02F, 7.0F},
		{"[glare]\neven = 0.4\n", NULL, 0.4F, 0.0F, 10.0F},
		{.text = "[glare]\neven = 0.41\n", .key = "even"},
		{.text = "[glare]\neven = -0.01\n", .key = "even"},
		{.text = "[glare]\naround = nan\n", .key = "around"},
		{.text = "[glare]\naround = much\n", .key = "around"},
		{.text = "[glare]\nwidth_deg = 0.5\n", .key = "width_deg"},
		{.text = "[glare]\nwidth_deg = 91\n", .key = "width_deg"},
		{.text = "[glare]\nshare = 0.1\n", .key = "share"},
	};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(files); k++) {
		struct lp_camera_file *file;
		struct capture capture;

		capture_begin(&capture);
		const int ret = read_camera_file(files[k].text, &file);
		const char *log = capture_end(&capture);

		assert_int_equal(ret, files[k].key ? -EBADMSG : 0);
		if (files[k].key) {
			assert_contains(log, files[k].key);
			continue;
		}
		assert_true(file->glare.even == files[k].even);
		assert_true(file->glare.around == files[k].around);
		assert_true(file->glare.width_deg == files[k].width_deg);
		lp_camera_file_destroy(file);
	}
	struct lp_camera *camera = load("[camera]\nprojection = equirect\n[glare]\neven = 0.03\n");

	assert_true(camera->glare.even == 0.03F);
	lp_camera_destroy(camera);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_part_of_a_sphere),
		cmocka_unit_test(test_mask_of_a_panorama),
		cmocka_unit_test(test_stuck_pixels_are_read),
		cmocka_unit_test(test_pixels_and_rays_are_inverse),
		cmocka_unit_test(test_axes),
		cmocka_unit_test(test_pixel_solid_angles),
		cmocka_unit_test(test_uniform_stays_uniform),
		cmocka_unit_test(test_light_is_kept),
		cmocka_unit_test(test_one_lens_sees_a_part),
		cmocka_unit_test(test_an_ordinary_camera),
		cmocka_unit_test(test_the_shape_of_a_picture),
		cmocka_unit_test(test_broken_files),
		cmocka_unit_test(test_processing_of_a_file),
		cmocka_unit_test(test_glare_of_a_file),
		cmocka_unit_test(test_settings_of_every_driver),
		cmocka_unit_test(test_long_lines),
	};
	const int fd = mkstemp(path);
	int failed;

	if (fd < 0)
		return 1;
	close(fd);
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	unlink(path);
	return failed;
}
