/* SPDX-License-Identifier: Apache-2.0 */
/* Small scenes with exact truth: uniform discs over a background, rendered with sub-pixels. */
#ifndef LP_TESTS_SCENE_H
#define LP_TESTS_SCENE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/frame.h"
#include "include/panorama.h"

#define TEST_DEG (M_PI / 180.0)

struct disc {
	double azimuth_deg, elevation_deg; /* azimuth 0 = -Z, to the right */
	double radius_deg;
	double radiance;
};

static inline void disc_direction(const struct disc *disc, double d[3])
{
	const double a = disc->azimuth_deg * TEST_DEG, e = disc->elevation_deg * TEST_DEG;

	d[0] = cos(e) * sin(a);
	d[1] = sin(e);
	d[2] = -cos(e) * cos(a);
}

static inline double angle_between_deg(const double a[3], const float b[3])
{
	const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2],
		     z = a[0] * b[1] - a[1] * b[0];

	return atan2(sqrt(x * x + y * y + z * z), a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) /
	       TEST_DEG;
}

/* Irradiance at normal incidence of a uniform disc: integral of radiance over its solid angle,
 * which is what the project calls a lamp's irradiance. */
static inline double disc_irradiance(const struct disc *disc)
{
	return disc->radiance * 2.0 * M_PI * (1.0 - cos(disc->radius_deg * TEST_DEG));
}

/* Radiance of a disc seen through one pixel of a width x height equirectangular picture: mean over
 * 16 x 16 sub-pixels, weighted by their solid angle. */
static inline double disc_pixel(const struct disc *disc, int width, int height, int column, int row)
{
	enum { SUB = 16 };
	double sum = 0.0, weight = 0.0, centre[3];

	disc_direction(disc, centre);

	for (int s = 0; s < SUB * SUB; s++) {
		const double t = M_PI * (row + (s / SUB + 0.5) / SUB) / height;
		const double l = 2.0 * M_PI * ((column + (s % SUB + 0.5) / SUB) / width - 0.5);
		const double d[3] = {sin(t) * sin(l), cos(t), -sin(t) * cos(l)};

		if (d[0] * centre[0] + d[1] * centre[1] + d[2] * centre[2] >=
		    cos(disc->radius_deg * TEST_DEG))
			sum += sin(t) * disc->radiance;
		weight += sin(t);
	}
	return sum / weight;
}

/* Cosines of the angles from a disc's centre between which its rim may cross a pixel. */
struct rim {
	double d[3], inner, outer;
};

static inline struct rim disc_rim(const struct disc *disc, int height)
{
	const double margin_deg = 270.0 / height; /* a pixel and a half */
	struct rim rim;

	disc_direction(disc, rim.d);
	rim.inner = disc->radius_deg > margin_deg ? cos((disc->radius_deg - margin_deg) * TEST_DEG)
						  : 2.0; /* no pixel is all inside */
	rim.outer = cos(fmin(disc->radius_deg + margin_deg, 180.0) * TEST_DEG);
	return rim;
}

/* Add one disc to one row; azimuth: sine and cosine of every column's. */
static inline void add_row(const struct disc *disc, const struct rim *rim, const double *azimuth,
			   int width, int height, int row, double *radiance)
{
	const double sine = sin(M_PI * (row + 0.5) / height);
	const double cosine = cos(M_PI * (row + 0.5) / height);

	for (int c = 0; c < width; c++) {
		const double dot = sine * azimuth[2 * c] * rim->d[0] + cosine * rim->d[1] -
				   sine * azimuth[2 * c + 1] * rim->d[2];

		if (dot > rim->inner)
			radiance[c] += disc->radiance;
		else if (dot > rim->outer)
			radiance[c] += disc_pixel(disc, width, height, c, row);
	}
}

/* Radiance of the whole picture: by the pixel's centre, but at rims by disc_pixel(). Caller frees.
 */
static inline double *render_scene(const struct disc *discs, int count, double background,
				   int width, int height)
{
	double *radiance = malloc((size_t)width * height * sizeof(*radiance));
	double *azimuth = malloc(2 * width * sizeof(*azimuth));

	for (int c = 0; c < width; c++) {
		azimuth[2 * c] = sin(2.0 * M_PI * ((c + 0.5) / width - 0.5));
		azimuth[2 * c + 1] = cos(2.0 * M_PI * ((c + 0.5) / width - 0.5));
	}
	for (int i = 0; i < width * height; i++)
		radiance[i] = background;
	for (int k = 0; k < count; k++) {
		const struct rim rim = disc_rim(&discs[k], height);

		for (int r = 0; r < height; r++)
			add_row(&discs[k], &rim, azimuth, width, height, r,
				radiance + (size_t)r * width);
	}
	free(azimuth);
	return radiance;
}

static inline void fill_panorama(struct lp_panorama *panorama, const struct disc *discs, int count,
				 double background)
{
	double *radiance =
		render_scene(discs, count, background, panorama->width, panorama->height);

	for (int i = 0; i < panorama->width * panorama->height; i++)
		for (int k = 0; k < 4; k++)
			panorama->cells[i][k] = (float)radiance[i];
	panorama->seen_fraction = 1.0F;
	free(radiance);
}

static inline struct lp_panorama new_panorama(int width)
{
	struct lp_panorama p = {.width = width, .height = width / 2};

	p.cells = calloc((size_t)width * width / 2, sizeof(*p.cells));
	p.flags = calloc((size_t)width * width / 2, 1);
	return p;
}

static inline void free_panorama(struct lp_panorama *panorama)
{
	free(panorama->cells);
	free(panorama->flags);
}

/* A frame that owns its data and itself. */
static inline void free_test_frame(struct lp_frame *frame)
{
	free((void *)frame->data);
	free(frame);
}

static inline struct lp_frame *new_frame(enum lp_pixel_format format, int width, int height,
					 int stride, size_t size)
{
	struct lp_frame *frame = calloc(1, sizeof(*frame));

	*frame = (struct lp_frame){.format = format,
				   .width_px = width,
				   .height_px = height,
				   .stride_bytes = stride,
				   .data = calloc(1, size),
				   .size_bytes = size,
				   .t_read_ns = 1000000000,
				   .exposure_us = NAN,
				   .gain = NAN,
				   .wheel_deg = NAN,
				   .wheel_sigma_deg = NAN,
				   .orientation = {NAN, NAN, NAN, NAN},
				   .orientation_sigma_deg = NAN,
				   .row_time_us = NAN,
				   .release = free_test_frame};
	return frame;
}

static inline struct lp_frame *new_float_frame(int width, int height)
{
	return new_frame(LP_FORMAT_RGB_F32, width, height, width * 12, (size_t)width * height * 12);
}

static inline struct lp_frame *scene_frame(int width, int height, const struct disc *discs,
					   int count, double background)
{
	struct lp_frame *frame = new_float_frame(width, height);
	double *radiance = render_scene(discs, count, background, width, height);
	float *rgb = (float *)frame->data;

	for (int i = 0; i < width * height; i++)
		rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = (float)radiance[i];
	free(radiance);
	return frame;
}

#endif
