/* SPDX-License-Identifier: Apache-2.0 */
/* A still scene with known radiance, so that brightness follows exposure as in a real camera. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>
#include "pictures.h"

enum { CACHE = 8, QUALITY = 85, CHROMA_NEUTRAL = 128 };

/* Full scale is reached by radiance 1 at this exposure and gain 1. */
#define FULL_SCALE_US 10000.0
#define LAMP_RADIANCE 100.0

struct drawing {
	enum camera_format format;
	const struct camera_size *size;
	struct settings settings;
	uint8_t *data; /* NULL: free */
	size_t size_bytes;
};

struct pattern {
	struct pictures base;
	tjhandle encoder;
	struct drawing cache[CACHE]; /* encoding a large JPEG takes longer than a frame lasts */
	unsigned oldest;
};

/* Radiance rises from 0.02 at the left edge to 1 at the right; the lamp is ahead, above the
 * horizon. */
static double radiance(double column, double row)
{
	double across = column - 0.5, up = 0.35 - row;

	if (across * across * 4 + up * up < 0.02 * 0.02)
		return LAMP_RADIANCE;
	return 0.02 + 0.98 * column;
}

/* The response of the camera: sRGB's curve. */
static uint8_t respond(double exposed)
{
	double linear = fmin(exposed, 1);
	double encoded =
		linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;

	return (uint8_t)lround(255 * encoded);
}

static void draw_luma(uint8_t *luma, const struct camera_size *size,
		      const struct settings *settings)
{
	int width = size->width_px, height = size->height_px;
	double factor = settings->exposure_us * settings->gain / FULL_SCALE_US;
	uint8_t lamp = respond(LAMP_RADIANCE * factor);

	for (int column = 0; column < width; column++)
		luma[column] = respond(radiance((column + 0.5) / width, 1) * factor);
	for (int row = 1; row < height; row++)
		memcpy(luma + (size_t)row * width, luma, (size_t)width);
	for (int row = 0; row < height; row++)
		for (int column = width * 2 / 5; column < width * 3 / 5; column++)
			if (radiance((column + 0.5) / width, (row + 0.5) / height) == LAMP_RADIANCE)
				luma[(size_t)row * width + column] = lamp;
}

/* 4:2:2, as UVC cameras send it. */
static int encode_jpeg(struct pattern *pattern, const uint8_t *luma, struct drawing *drawing)
{
	int width = drawing->size->width_px, height = drawing->size->height_px;
	size_t pixels = (size_t)width * height;
	unsigned long size_bytes = 0;
	uint8_t *planes = malloc(pixels * 2);
	int ret;

	if (!planes)
		return -ENOMEM;
	memcpy(planes, luma, pixels);
	memset(planes + pixels, CHROMA_NEUTRAL, pixels);
	ret = tjCompressFromYUV(pattern->encoder, planes, width, 1, height, TJSAMP_422,
				&drawing->data, &size_bytes, QUALITY, 0);
	free(planes);
	drawing->size_bytes = size_bytes;
	return ret ? -EIO : 0;
}

static int pack(const uint8_t *luma, struct drawing *drawing)
{
	size_t pixels = (size_t)drawing->size->width_px * drawing->size->height_px;

	drawing->size_bytes = camera_picture_bytes(drawing->format, drawing->size);
	drawing->data = malloc(drawing->size_bytes);
	if (!drawing->data)
		return -ENOMEM;
	memset(drawing->data, CHROMA_NEUTRAL, drawing->size_bytes);
	if (drawing->format == CAMERA_YUYV)
		for (size_t i = 0; i < pixels; i++)
			drawing->data[2 * i] = luma[i];
	else
		memcpy(drawing->data, luma, pixels);
	return 0;
}

static int draw(struct pattern *pattern, struct drawing *drawing)
{
	uint8_t *luma = malloc((size_t)drawing->size->width_px * drawing->size->height_px);
	int ret;

	if (!luma)
		return -ENOMEM;
	draw_luma(luma, drawing->size, &drawing->settings);
	ret = drawing->format == CAMERA_MJPEG ? encode_jpeg(pattern, luma, drawing)
					      : pack(luma, drawing);
	free(luma);
	return ret;
}

static void discard(struct drawing *drawing)
{
	if (drawing->format == CAMERA_MJPEG)
		tjFree(drawing->data);
	else
		free(drawing->data);
	*drawing = (struct drawing){0};
}

static int take(struct pictures *pictures, enum camera_format format,
		const struct camera_size *size, const struct settings *settings,
		struct picture *picture)
{
	struct pattern *pattern = (struct pattern *)pictures;
	struct drawing *drawing = NULL;
	int ret;

	for (int i = 0; i < CACHE; i++) {
		struct drawing *d = &pattern->cache[i];

		if (d->data && d->format == format && d->size == size &&
		    d->settings.exposure_us == settings->exposure_us &&
		    d->settings.gain == settings->gain)
			drawing = d;
	}
	if (!drawing) {
		drawing = &pattern->cache[pattern->oldest++ % CACHE];
		discard(drawing);
		*drawing = (struct drawing){.format = format, .size = size, .settings = *settings};
		ret = draw(pattern, drawing);
		if (ret < 0) {
			discard(drawing);
			return ret;
		}
	}
	*picture = (struct picture){drawing->data, drawing->size_bytes};
	return 0;
}

static void destroy(struct pictures *pictures)
{
	struct pattern *pattern = (struct pattern *)pictures;

	for (int i = 0; i < CACHE; i++)
		discard(&pattern->cache[i]);
	tjDestroy(pattern->encoder);
	free(pattern);
}

static const struct pictures_ops ops = {.take = take, .destroy = destroy};

struct pictures *pictures_pattern_create(void)
{
	struct pattern *pattern = calloc(1, sizeof(*pattern));

	if (!pattern)
		return NULL;
	pattern->base.ops = &ops;
	pattern->encoder = tjInitCompress();
	if (!pattern->encoder) {
		free(pattern);
		return NULL;
	}
	return &pattern->base;
}
