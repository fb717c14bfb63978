/* SPDX-License-Identifier: Apache-2.0 */
/* From a camera file to a camera: lenses, masks, response. */
#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "vision/camera/camera.h"
#include "vision/camera/camera_file.h"

/* `name` relative to the folder of the camera file. */
static FILE *open_beside(const char *camera_path, const char *name)
{
	char folder[PATH_MAX], path[2 * PATH_MAX];
	FILE *file;

	snprintf(folder, sizeof(folder), "%s", camera_path);
	snprintf(path, sizeof(path), "%s/%s", dirname(folder), name);
	file = fopen(name[0] == '/' ? name : path, "rb");
	if (!file)
		lp_error(name, "camera file", "%s, named in %s", lp_strerror(errno), camera_path);
	return file;
}

/* 256 rows "r g b", linear values; scaled so that the last row of green is 1. */
static int load_response(struct lp_camera *camera, const char *camera_path, const char *name)
{
	FILE *file = open_beside(camera_path, name);
	int rows = 0;

	if (!file)
		return -ENOENT;
	while (rows < 256 && fscanf(file, "%f %f %f", &camera->response[0][rows],
				    &camera->response[1][rows], &camera->response[2][rows]) == 3)
		rows++;
	fclose(file);
	for (int c = 0; c < 3 && rows == 256; c++)
		for (int v = 0; v < 256; v++)
			if (!isfinite(camera->response[c][v]) ||
			    (v && camera->response[c][v] < camera->response[c][v - 1]))
				rows = -1;
	if (rows != 256 || camera->response[1][255] <= 0.0F) {
		lp_error(name, "camera file",
			 "a response table has 256 rows of three numbers, "
			 "not decreasing; make one with: lightprobe calibrate response");
		return -EBADMSG;
	}
	const float top = camera->response[1][255];
	for (int c = 0; c < 3; c++)
		for (int v = 0; v < 256; v++)
			camera->response[c][v] /= top;
	camera->response_given = true;
	return 0;
}

/* Binary PGM of the camera's size; 0 = not usable. */
static int load_mask(struct lp_camera *camera, struct lp_lens *lens, const char *camera_path,
		     const char *name)
{
	const size_t pixels = (size_t)camera->width_px * camera->height_px;
	FILE *file = open_beside(camera_path, name);
	int width, height, top;
	int ret = -EBADMSG;

	if (!file)
		return -ENOENT;
	if (fscanf(file, "P5 %d %d %d", &width, &height, &top) != 3 || fgetc(file) == EOF ||
	    width != camera->width_px || height != camera->height_px || top > 255) {
		lp_error(name, "camera file", "a mask is an 8-bit binary PGM of %dx%d",
			 camera->width_px, camera->height_px);
		goto close_file;
	}
	lens->mask = malloc(pixels);
	ret = !lens->mask ? -ENOMEM : fread(lens->mask, 1, pixels, file) == pixels ? 0 : -EBADMSG;
	if (ret == -EBADMSG)
		lp_error(name, "camera file", "the mask file is too short");
close_file:
	fclose(file);
	return ret;
}

/* Rows "x y" of a picture of the camera's size. */
static int load_stuck_pixels(struct lp_camera *camera, const char *camera_path, const char *name)
{
	FILE *file = open_beside(camera_path, name);
	float x, y;
	int ret = 0, read = 0;

	if (!file)
		return -ENOENT;
	camera->stuck_px = calloc(LP_MAX_STUCK_PIXELS, sizeof(*camera->stuck_px));
	if (!camera->stuck_px)
		ret = -ENOMEM;
	while (ret == 0 && (read = fscanf(file, "%f %f", &x, &y)) == 2) {
		const bool inside = x >= 0.0F && y >= 0.0F && x < (float)camera->width_px &&
				    y < (float)camera->height_px;

		if (!inside || camera->stuck_count == LP_MAX_STUCK_PIXELS) {
			ret = -EBADMSG;
			break;
		}
		camera->stuck_px[camera->stuck_count][0] = x;
		camera->stuck_px[camera->stuck_count++][1] = y;
	}
	if (ret == 0 && (read != EOF || ferror(file)))
		ret = -EBADMSG;
	fclose(file);
	if (ret == -EBADMSG)
		lp_error(name, "camera file",
			 "stuck_pixels has rows of two numbers, x y of at most %d pixels within "
			 "width_px x height_px of [camera]",
			 LP_MAX_STUCK_PIXELS);
	return ret;
}

/* Rotation matrix of a quaternion, which is normalised first; the identity when none is given. */
static int set_rotation(struct lp_lens *lens, const struct lp_floats *wxyz)
{
	float w = 1.0F, x = 0.0F, y = 0.0F, z = 0.0F;

	if (wxyz->count == 4) {
		w = wxyz->values[0];
		x = wxyz->values[1];
		y = wxyz->values[2];
		z = wxyz->values[3];
	}
	const float length = sqrtf(w * w + x * x + y * y + z * z);
	if ((wxyz->count && wxyz->count != 4) || length < 0.5F)
		return -EINVAL;
	w /= length;
	x /= length;
	y /= length;
	z /= length;
	const float rotation[3][3] = {
		{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
		{2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
		{2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
	};
	memcpy(lens->rotation, rotation, sizeof(rotation));
	return 0;
}

/* r(theta) must grow up to the rim, or a radius would belong to two angles. */
static bool grows(const struct lp_lens *lens)
{
	double last = 0.0;

	for (int i = 1; i <= 256; i++) {
		const double t = lens->max_theta_rad * i / 256.0, t2 = t * t;
		const double r =
			t * (1 + t2 * (lens->k[0] +
				       t2 * (lens->k[1] + t2 * (lens->k[2] + t2 * lens->k[3]))));

		if (!(r > last))
			return false;
		last = r;
	}
	return true;
}

static int set_lens(struct lp_camera *camera, struct lp_lens *lens, const char *path,
		    const struct lp_lens_fields *f, int number)
{
	*lens = (struct lp_lens){.cx_px = f->cx_px,
				 .cy_px = f->cy_px,
				 .fx_px = f->fx_px,
				 .fy_px = f->fy_px,
				 .k = {f->k1, f->k2, f->k3, f->k4},
				 .max_theta_rad = f->max_theta_deg * (float)M_PI / 180.0F};
	memcpy(lens->rolloff, f->rolloff.values, sizeof(lens->rolloff));
	if (isnan(f->cx_px) || isnan(f->cy_px) || !f->fx_px || !f->fy_px || !f->max_theta_deg) {
		lp_error(path, "camera file",
			 "[lens.%d] needs cx_px, cy_px, fx_px, fy_px and "
			 "max_theta_deg",
			 number);
		return -EBADMSG;
	}
	if (f->distortion.count) {
		lp_error(
			path, "camera file",
			"[lens.%d]: distortion is of projection = pinhole; a fisheye's is k1 to k4",
			number);
		return -EBADMSG;
	}
	if (f->rolloff.count > 3 || set_rotation(lens, &f->rotation_wxyz) < 0) {
		lp_error(path, "camera file",
			 "[lens.%d]: rotation_wxyz takes four numbers, a "
			 "quaternion; rolloff at most three",
			 number);
		return -EBADMSG;
	}
	if (!grows(lens)) {
		lp_error(path, "camera file",
			 "[lens.%d]: with these k1..k4 the radius stops growing before "
			 "max_theta_deg",
			 number);
		return -EBADMSG;
	}
	return f->mask[0] ? load_mask(camera, lens, path, f->mask) : 0;
}

static int set_crop(struct lp_camera *camera, const char *path, const struct lp_crop_fields *f)
{
	camera->crop = lp_crop_of(f->left_px, f->top_px, camera->width_px, camera->height_px,
				  f->full_width_px, f->full_height_px);
	camera->crop_given = true;
	if (lp_crop_is_stated(&camera->crop))
		return 0;
	lp_error(path, "camera file",
		 "[crop] needs full_width_px and full_height_px, within which width_px x height_px "
		 "of [camera] lie at left_px, top_px");
	return -EBADMSG;
}

/* Which part of the sphere an equirectangular picture shows. */
static int set_panorama(struct lp_camera *camera, const struct lp_camera_file *f)
{
	const char *path = f->ini.path;

	if (camera->projection != LP_EQUIRECT || !f->width_px || !f->height_px) {
		lp_error(path, "camera file",
			 "[crop] and mask of [camera] are for projection = equirect, and need its "
			 "width_px and height_px (a fisheye's mask is in its [lens.0])");
		return -EBADMSG;
	}
	if (f->mask[0]) {
		const int ret = load_mask(camera, &camera->lens[0], path, f->mask);

		if (ret < 0)
			return ret;
	}
	return f->crop.present ? set_crop(camera, path, &f->crop) : 0;
}

/* A row of numbers with zeros for those that are not given. */
static void copy_numbers(const struct lp_floats *given, double *to, int count)
{
	for (int k = 0; k < count; k++)
		to[k] = k < given->count ? (double)given->values[k] : 0.0;
}

/* One lens that is described without a polynomial in the angle. */
static bool is_plain(const struct lp_camera_file *f)
{
	const struct lp_lens_fields *l = &f->lens[0];

	return l->present && !isnan(l->cx_px) && !isnan(l->cy_px) && l->fx_px > 0.0F &&
	       l->fy_px > 0.0F && l->k1 == 0.0F && l->k2 == 0.0F && l->k3 == 0.0F &&
	       l->k4 == 0.0F && !f->lens[1].present;
}

/* An ordinary camera. */
static int set_pinhole(struct lp_camera *camera, const struct lp_camera_file *f)
{
	const struct lp_lens_fields *l = &f->lens[0];
	struct lp_lens *lens = &camera->lens[0];
	const char *path = f->ini.path;

	if (!is_plain(f) || l->distortion.count > LP_PINHOLE_DISTORTION || l->rolloff.count > 3 ||
	    set_rotation(lens, &l->rotation_wxyz) < 0) {
		lp_error(path, "camera file",
			 "projection = pinhole needs one [lens.0] with cx_px, cy_px, fx_px and "
			 "fy_px; distortion takes k1, k2, p1, p2, k3 as OpenCV has them; k1 to k4 "
			 "apart are of a fisheye");
		return -EBADMSG;
	}
	camera->pinhole = (struct lp_pinhole){l->cx_px, l->cy_px, l->fx_px, l->fy_px, {0.0}};
	copy_numbers(&l->distortion, camera->pinhole.distortion, LP_PINHOLE_DISTORTION);
	memcpy(lens->rolloff, l->rolloff.values, sizeof(lens->rolloff));
	lens->fx_px = l->fx_px;
	lens->fy_px = l->fy_px;
	const double most_rad =
		lp_pinhole_most_rad(&camera->pinhole, camera->width_px, camera->height_px);

	if (most_rad <= 0.0) {
		lp_error(path, "camera file",
			 "[lens.0]: with this distortion, or this fx_px and fy_px, two places of "
			 "the picture look the same way");
		return -EBADMSG;
	}
	lens->max_theta_rad = (float)most_rad;
	if (l->max_theta_deg > 0.0F)
		lens->max_theta_rad =
			fminf(lens->max_theta_rad, l->max_theta_deg * (float)M_PI / 180.0F);
	camera->lens_count = 1;
	return l->mask[0] ? load_mask(camera, lens, path, l->mask) : 0;
}

/* The camera that sees a mirror ball, and the ball. */
static int set_ball(struct lp_camera *camera, const struct lp_camera_file *f)
{
	const struct lp_lens_fields *l = &f->lens[0];
	const struct lp_ball_fields *b = &f->ball;
	struct lp_lens *lens = &camera->lens[0];
	const char *path = f->ini.path;
	double centre[3];

	if (!is_plain(f) || l->distortion.count) {
		lp_error(path, "camera file",
			 "projection = ball needs one [lens.0] with cx_px, cy_px, fx_px and fy_px "
			 "of the camera; its distortion, if any, stands in [ball]");
		return -EBADMSG;
	}
	camera->pinhole = (struct lp_pinhole){l->cx_px, l->cy_px, l->fx_px, l->fy_px, {0.0}};
	copy_numbers(&b->distortion, camera->pinhole.distortion, LP_PINHOLE_DISTORTION);
	copy_numbers(&b->centre, centre, 3);
	if (b->centre.count != 3 || b->distortion.count > LP_PINHOLE_DISTORTION ||
	    set_rotation(lens, &l->rotation_wxyz) < 0 ||
	    !lp_ball_init(&camera->ball, &camera->pinhole, centre, b->radius, b->rim_px)) {
		lp_error(
			path, "camera file",
			"[ball] needs centre = X, Y, Z before the lens (+X right, +Y up, -Z ahead) "
			"and radius, in one unit, outside of the lens and larger than rim_px; "
			"distortion takes k1, k2, p1, p2, k3");
		return -EBADMSG;
	}
	camera->ball.index = b->index;
	camera->ball.extinction = b->extinction;
	camera->ball.outline_px = b->outline_sigma_px;
	camera->ball.rotation_deg = b->rotation_sigma_deg;
	camera->lens_count = 1;
	return l->mask[0] ? load_mask(camera, lens, path, l->mask) : 0;
}

static int build(struct lp_camera *camera, const struct lp_camera_file *f)
{
	const char *path = f->ini.path;

	snprintf(camera->name, sizeof(camera->name), "%s", f->name[0] ? f->name : path);
	if (f->projection < 0) {
		lp_error(path, "camera file",
			 "[camera] needs projection = equirect, fisheye, pinhole or ball");
		return -EBADMSG;
	}
	camera->projection = (enum lp_projection)f->projection;
	camera->width_px = f->width_px;
	camera->height_px = f->height_px;
	camera->lens_count = camera->projection == LP_EQUIRECT;
	for (int a = 0; a < 3; a++)
		camera->lens[0].rotation[a][a] = 1.0F; /* of an equirectangular one */
	camera->glare = f->glare;
	camera->crop = LP_CROP_WHOLE;
	camera->crop_given = camera->projection != LP_EQUIRECT;
	if (f->crop.present || f->mask[0]) {
		const int ret = set_panorama(camera, f);

		if (ret < 0)
			return ret;
	}
	if (camera->projection != LP_EQUIRECT && (!f->width_px || !f->height_px)) {
		lp_error(path, "camera file",
			 "[camera] needs width_px and height_px, the picture "
			 "that the lens numbers refer to");
		return -EBADMSG;
	}
	for (int k = 0; camera->projection == LP_FISHEYE && k < LP_MAX_LENSES; k++) {
		if (!f->lens[k].present)
			break;
		camera->lens_count++;
		int ret = set_lens(camera, &camera->lens[k], path, &f->lens[k], k);
		if (ret < 0)
			return ret;
	}
	if (camera->projection == LP_BALL || camera->projection == LP_PINHOLE) {
		const int ret = camera->projection == LP_BALL ? set_ball(camera, f)
							      : set_pinhole(camera, f);

		if (ret < 0)
			return ret;
	}
	if (!camera->lens_count) {
		lp_error(path, "camera file", "a fisheye camera needs a [lens.0]");
		return -EBADMSG;
	}
	if (f->stuck_pixels[0]) {
		const int ret = load_stuck_pixels(camera, path, f->stuck_pixels);

		if (ret < 0)
			return ret;
	}
	return f->response[0] ? load_response(camera, path, f->response) : 0;
}

int lp_camera_create(const struct lp_camera_file *file, struct lp_camera **camera)
{
	static const struct lp_camera_file equirect = {.name = "equirect",
						       .projection = LP_EQUIRECT};
	struct lp_camera *c = calloc(1, sizeof(*c));
	int ret;

	if (!c)
		return -ENOMEM;
	ret = build(c, file ? file : &equirect);
	if (ret < 0) {
		lp_camera_destroy(c);
		return ret;
	}
	*camera = c;
	return 0;
}
