/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What every stage makes of the same input, printed, so that two processors can be compared. Lines
 * `NAME = WORD` must be the same to the bit; in lines `NAME ~ NUMBER ...` floats may differ by
 * rounding.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "../unit/jpeg_encode.h"
#include "../unit/scene.h"
#include "estimate/pipeline.h"
#include "light/find/detection.h"
#include "light/math/grid.h"
#include "light/math/sh.h"
#include "vision/camera/camera.h"
#include "vision/imager.h"
#include "vision/jpeg/blocks.h"
#include "vision/map/sh_project.h"

#define WIDTH 1920
#define HEIGHT 960

/* FNV-1a, 64 bits. */
static uint64_t hash(const void *data, size_t size)
{
	const uint8_t *byte = data;
	uint64_t h = 0xcbf29ce484222325ULL;

	for (size_t i = 0; i < size; i++)
		h = (h ^ byte[i]) * 0x100000001b3ULL;
	return h;
}

static void check(int ret, const char *what)
{
	if (ret < 0) {
		fprintf(stderr, "numbers: %s: %s\n", what, strerror(-ret));
		exit(1);
	}
}

static void print_floats(const char *name, const float *values, int count)
{
	printf("%s ~", name);
	for (int i = 0; i < count; i++)
		printf(" %.9g", (double)values[i]);
	printf("\n");
}

static const struct {
	const char *name;
	struct jpeg_kind kind;
} jpegs[] = {
	{"420", {3, 2, 2, 85, 0, 0, 0}},  {"420-restart", {3, 2, 2, 85, 120, 1, 0}},
	{"422", {3, 2, 1, 90, 0, 0, 0}},  {"444", {3, 1, 1, 95, 0, 1, 0}},
	{"grey", {1, 1, 1, 75, 0, 0, 0}},
};

static void blocks(const char *name, const uint8_t *data, size_t size)
{
	struct lp_jpeg_reader *reader;

	check(lp_jpeg_reader_create(&reader), "reader");
	check(lp_jpeg_read(reader, data, size), name);
	printf("jpeg %s bytes = %016" PRIx64 "\n", name, hash(data, size));
	for (int c = 0; c < reader->component_count; c++) {
		const struct lp_jpeg_component *k = &reader->component[c];

		printf("jpeg %s dc[%d] = %016" PRIx64 "\n", name, c,
		       hash(k->dc, (size_t)k->blocks_x * k->blocks_y * sizeof(*k->dc)));
	}
	const size_t count = (size_t)reader->component[0].blocks_x * reader->component[0].blocks_y;

	printf("jpeg %s energy = %016" PRIx64 "\n", name,
	       hash(reader->energy, count * sizeof(*reader->energy)));
	lp_jpeg_reader_destroy(reader);
}

static struct lp_frame *frame_of(enum lp_pixel_format format, const uint8_t *data, size_t size,
				 int stride, float exposure_us)
{
	struct lp_frame *frame = new_frame(format, WIDTH, HEIGHT, stride, size);

	memcpy((void *)frame->data, data, size);
	frame->exposure_us = exposure_us;
	return frame;
}

/* Every 97th cell, flags of all, and what lights and projection make of them. */
static void panorama(const char *name, struct lp_imager *imager)
{
	static const struct lp_detector_options adaptive = {.detector = LP_DETECTOR_ADAPTIVE};
	const struct lp_panorama *p = lp_imager_panorama(imager);
	const int count = p->width * p->height;
	struct lp_detection *detection;
	struct lp_sh_projector *projector;
	double sh[LP_SH_MAX_COUNT][3], mean = 0.0;
	char label[80];

	printf("%s flags = %016" PRIx64 "\n", name, hash(p->flags, count));
	for (int i = 0; i < count; i += 97) {
		snprintf(label, sizeof(label), "%s cell %d", name, i);
		print_floats(label, p->cells[i], 4);
	}
	for (int i = 0; i < count; i++)
		mean += (double)p->cells[i][3] / (4.0 * M_PI) *
			lp_grid_solid_angle_sr(lp_imager_grid(imager), i);
	check(lp_detection_create(lp_imager_grid(imager), &adaptive, &detection), "detection");
	check(lp_sh_projector_create(p->width, p->height, LP_SH_MAX_ORDER, &projector), "SH");
	lp_detect(detection, p, (float)mean);
	printf("%s lamps = %d\n", name, detection->finder->count);
	for (int k = 0; k < detection->finder->count; k++) {
		const struct lp_lamp *lamp = &detection->finder->lamps[k];

		printf("%s lamp %d cells = %d\n", name, k, lamp->count);
		snprintf(label, sizeof(label), "%s lamp %d", name, k);
		print_floats(label, lamp->direction, 3);
		print_floats(label, lamp->irradiance, 4);
	}
	lp_sh_project(projector, p, LP_SH_MAX_ORDER, sh);
	for (int c = 0; c < 3; c++) {
		float column[LP_SH_MAX_COUNT];

		for (int i = 0; i < LP_SH_MAX_COUNT; i++)
			column[i] = (float)sh[i][c];
		snprintf(label, sizeof(label), "%s sh[%d]", name, c);
		print_floats(label, column, LP_SH_MAX_COUNT);
	}
	lp_sh_projector_destroy(projector);
	lp_detection_destroy(detection);
}

static struct lp_imager *new_imager(const struct lp_camera *camera, enum lp_decode decode)
{
	const struct lp_imager_options options = {.panorama_width = 240,
						  .decode = decode,
						  .divisor = 1,
						  .exact_blocks = 64};
	struct lp_imager *imager;

	check(lp_imager_create(camera, &options, &imager), "imager");
	return imager;
}

static void raw_frames(const struct lp_camera *camera, enum lp_pixel_format format,
		       const char *name)
{
	const int stride = format == LP_FORMAT_YUYV ? 2 * WIDTH : WIDTH;
	const size_t size = (size_t)stride * HEIGHT * (format == LP_FORMAT_NV12 ? 3 : 2) / 2;
	uint8_t *data = malloc(size);

	for (size_t i = 0; i < size; i++)
		data[i] = test_sample((int)(i % stride), (int)(i / stride), (int)format);
	struct lp_imager *imager = new_imager(camera, LP_DECODE_BLOCKS);

	check(lp_imager_add(imager, frame_of(format, data, size, stride, 1000.0F)), name);
	panorama(name, imager);
	lp_imager_destroy(imager);
	free(data);
}

int main(void)
{
	static const struct disc discs[] = {{30, 20, 2, 400},
					    {180, 50, 0.3, 2e4},
					    {-60, 88, 6, 40}};
	struct lp_camera *camera;
	struct lp_imager *bracket;

	check(lp_camera_create(NULL, &camera), "camera");
	bracket = new_imager(camera, LP_DECODE_BLOCKS);
	for (unsigned int k = 0; k < sizeof(jpegs) / sizeof(jpegs[0]); k++) {
		unsigned long size;
		uint8_t *data = encode_jpeg(&jpegs[k].kind, WIDTH, HEIGHT, &size);

		blocks(jpegs[k].name, data, size);
		check(lp_imager_add(bracket, frame_of(LP_FORMAT_MJPEG, data, size, 0,
						      1000.0F * (float)(1 << 2 * k))),
		      jpegs[k].name);
		free(data);
	}
	panorama("bracket", bracket);
	lp_imager_destroy(bracket);
	raw_frames(camera, LP_FORMAT_YUYV, "yuyv");
	raw_frames(camera, LP_FORMAT_NV12, "nv12");

	struct lp_imager *floats = new_imager(camera, LP_DECODE_PIXELS);

	check(lp_imager_add(floats, scene_frame(WIDTH, HEIGHT, discs, 3, 1.5)), "floats");
	panorama("floats", floats);
	lp_imager_destroy(floats);
	lp_camera_destroy(camera);
	return 0;
}
