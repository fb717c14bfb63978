/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/camera_file.h"

#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "include/processing.h"

/* Of a scale whose file does not say how well it is known. */
#define USUAL_SCALE_SIGMA 0.05F
/* Of [glare], where the file does not say it. */
#define USUAL_GLARE_WIDTH_DEG 10.0F
/* Of [ball]: pixels within this of the outline hold what stands behind it, too. */
#define USUAL_RIM_PX 1.5F
#define USUAL_OUTLINE_SIGMA_PX 0.5F
/* Chromium in green light (Johnson & Christy 1974). */
#define CHROME_INDEX 3.18F
#define CHROME_EXTINCTION 3.31F

/* In the order of enum lp_projection. */
static const char *const projections[] = {"equirect", "fisheye", "ball", "pinhole", NULL};

static int parse_match(const char *text, void *field)
{
	const bool usb = strncmp(text, "usb:", 4) == 0;

	return usb && text[4] && lp_usb_id_parse(text + 4, field) == strlen(text + 4) ? 0 : -EINVAL;
}

static const struct lp_param camera_list[] = {
	{"version", LP_PARAM_INT, offsetof(struct lp_camera_file, version), .min = 1, .max = 1},
	{"name", LP_PARAM_TEXT, offsetof(struct lp_camera_file, name), .max = 64},
	{"match", LP_PARAM_OWN, offsetof(struct lp_camera_file, usb), .parse = parse_match,
	 .expects = "usb:VENDOR:PRODUCT, four hexadecimal digits each"},
	{"projection", LP_PARAM_CHOICE, offsetof(struct lp_camera_file, projection),
	 .choices = projections},
	{"width_px", LP_PARAM_INT, offsetof(struct lp_camera_file, width_px), .min = 1,
	 .max = 16384},
	{"height_px", LP_PARAM_INT, offsetof(struct lp_camera_file, height_px), .min = 1,
	 .max = 16384},
	{"read_out_ms", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, read_out_ms), .min = 0,
	 .max = 1000},
	{"mask", LP_PARAM_TEXT, offsetof(struct lp_camera_file, mask), .max = PATH_MAX},
	{"stuck_pixels", LP_PARAM_TEXT, offsetof(struct lp_camera_file, stuck_pixels),
	 .max = PATH_MAX},
};
static const struct lp_params camera_params = LP_PARAMS(camera_list);

static const struct lp_param crop_list[] = {
	{"full_width_px", LP_PARAM_INT, offsetof(struct lp_crop_fields, full_width_px), .min = 1,
	 .max = 65536},
	{"full_height_px", LP_PARAM_INT, offsetof(struct lp_crop_fields, full_height_px), .min = 1,
	 .max = 65536},
	{"left_px", LP_PARAM_INT, offsetof(struct lp_crop_fields, left_px), .max = 65536},
	{"top_px", LP_PARAM_INT, offsetof(struct lp_crop_fields, top_px), .max = 65536},
};
static const struct lp_params crop_params = LP_PARAMS(crop_list);

/* A bit of a name of `length` characters; 0: there is no such name. */
static uint32_t processing_bit(const char *name, size_t length)
{
	for (int kind = 0; kind < LP_PROCESSING_KINDS; kind++)
		if (strlen(lp_processing_name(kind)) == length &&
		    strncmp(lp_processing_name(kind), name, length) == 0)
			return LP_PROCESSING_BIT(kind);
	return 0;
}

/* "none", or names that commas separate. `field`: the whole file. */
static int parse_processing(const char *text, void *field)
{
	static const char between[] = ", \t";
	struct lp_camera_file *file = field;

	file->tells_processing = true;
	file->processing = 0;
	if (strcmp(text, "none") == 0)
		return 0;
	for (text += strspn(text, between); *text; text += strspn(text, between)) {
		const size_t length = strcspn(text, between);
		const uint32_t bit = processing_bit(text, length);

		if (!bit)
			return -EINVAL;
		file->processing |= bit;
		text += length;
	}
	return file->processing ? 0 : -EINVAL;
}

static const struct lp_param response_list[] = {
	{"table", LP_PARAM_TEXT, offsetof(struct lp_camera_file, response), .max = PATH_MAX},
	{"processing", LP_PARAM_OWN, 0, .parse = parse_processing,
	 .expects = "none, or names as in docs/users/cameras.md: sharpness, gamma"},
};
static const struct lp_params response_params = LP_PARAMS(response_list);

static const struct lp_param photometry_list[] = {
	{"cd_m2_per_unit", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, cd_m2_per_unit),
	 .min = 1e-12, .max = 1e12},
	{"sigma", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, cd_m2_per_unit_sigma),
	 .min = 0.001, .max = 10},
};
static const struct lp_params photometry_params = LP_PARAMS(photometry_list);

static const struct lp_param polarizer_list[] = {
	{"transmission", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, film_transmission),
	 .min = 0.01, .max = 1},
	{"extinction", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, film_extinction), .min = 1,
	 .max = 1e9},
	{"offset_deg", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, film_offset_deg),
	 .min = -180, .max = 180},
	{"index", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, film_index), .min = 1, .max = 2},
};
static const struct lp_params polarizer_params = LP_PARAMS(polarizer_list);

static const struct lp_param glare_list[] = {
	{"even", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, glare.even), .max = 0.4},
	{"around", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, glare.around), .max = 0.4},
	{"width_deg", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, glare.width_deg), .min = 1,
	 .max = 90},
};
static const struct lp_params glare_params = LP_PARAMS(glare_list);

static const struct lp_param ball_list[] = {
	{"centre", LP_PARAM_FLOATS, offsetof(struct lp_camera_file, ball.centre), .min = -1e6,
	 .max = 1e6},
	{"radius", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, ball.radius), .min = 1e-6,
	 .max = 1e6},
	{"distortion", LP_PARAM_FLOATS, offsetof(struct lp_camera_file, ball.distortion),
	 .min = -100, .max = 100},
	{"rim_px", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, ball.rim_px), .max = 1000},
	{"index", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, ball.index), .min = 0.01,
	 .max = 10},
	{"extinction", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, ball.extinction), .max = 20},
	{"outline_sigma_px", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, ball.outline_sigma_px),
	 .max = 1000},
	{"rotation_sigma_deg", LP_PARAM_FLOAT,
	 offsetof(struct lp_camera_file, ball.rotation_sigma_deg), .max = 180},
};
static const struct lp_params ball_params = LP_PARAMS(ball_list);

static const struct lp_param rig_list[] = {
	{"id", LP_PARAM_TEXT, offsetof(struct lp_camera_file, rig.id),
	 .max = sizeof(((struct lp_rig_fields *)0)->id)},
	{"camera", LP_PARAM_INT, offsetof(struct lp_camera_file, rig.camera), .min = 1, .max = 64},
	{"sigma_deg", LP_PARAM_FLOAT, offsetof(struct lp_camera_file, rig.sigma_deg), .max = 180},
};
static const struct lp_params rig_params = LP_PARAMS(rig_list);

/* Versions of clang-format disagree about these lines. */
/* clang-format off */
#define LENS_FLOAT(key, low, high) \
	{#key, LP_PARAM_FLOAT, offsetof(struct lp_lens_fields, key), .min = (low), .max = (high)}
/* clang-format on */

static const struct lp_param lens_list[] = {
	LENS_FLOAT(cx_px, -16384, 32768),
	LENS_FLOAT(cy_px, -16384, 32768),
	LENS_FLOAT(fx_px, 1, 32768),
	LENS_FLOAT(fy_px, 1, 32768),
	LENS_FLOAT(k1, -10, 10),
	LENS_FLOAT(k2, -10, 10),
	LENS_FLOAT(k3, -10, 10),
	LENS_FLOAT(k4, -10, 10),
	LENS_FLOAT(max_theta_deg, 1, 150),
	{"rotation_wxyz", LP_PARAM_FLOATS, offsetof(struct lp_lens_fields, rotation_wxyz),
	 .min = -1, .max = 1},
	{"rolloff", LP_PARAM_FLOATS, offsetof(struct lp_lens_fields, rolloff), .min = -100,
	 .max = 100},
	{"distortion", LP_PARAM_FLOATS, offsetof(struct lp_lens_fields, distortion), .min = -100,
	 .max = 100},
	{"mask", LP_PARAM_TEXT, offsetof(struct lp_lens_fields, mask), .max = PATH_MAX},
};
static const struct lp_params lens_params = LP_PARAMS(lens_list);

static int set_fields(struct lp_camera_file *file)
{
	static const char *const sections[] = {"camera", "response", "lens.0",	   "lens.1",
					       "lens.2", "lens.3",   "v4l2",	   "libcamera",
					       "osc",	 "ptp",	     "photometry", "polarizer",
					       "rig",	 "crop",     "glare",	   "ball",
					       NULL};
	int ret = lp_ini_check_sections(&file->ini, sections);

	_Static_assert(LP_MAX_LENSES == 4, "a section for each lens");
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "camera", &camera_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "response", &response_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "photometry", &photometry_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "polarizer", &polarizer_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "glare", &glare_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "ball", &ball_params, file);
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "rig", &rig_params, file);
	file->crop.present = lp_ini_has(&file->ini, "crop");
	if (ret == 0)
		ret = lp_ini_set(&file->ini, "crop", &crop_params, &file->crop);
	for (int k = 0; k < LP_MAX_LENSES && ret == 0; k++) {
		char section[20];

		(void)snprintf(section, sizeof(section), "lens.%d", k);
		file->lens[k].present = lp_ini_has(&file->ini, section);
		ret = lp_ini_set(&file->ini, section, &lens_params, &file->lens[k]);
	}
	return ret;
}

int lp_camera_file_read(const char *name_or_path, struct lp_camera_file **file)
{
	struct lp_camera_file *self = calloc(1, sizeof(*self));
	int ret = 0;

	if (!self)
		return -ENOMEM;
	self->read_out_ms = NAN;
	for (int k = 0; k < LP_MAX_LENSES; k++)
		self->lens[k].cx_px = self->lens[k].cy_px = NAN;
	if (strcmp(name_or_path, "equirect") == 0) {
		self->projection = LP_EQUIRECT;
		(void)snprintf(self->name, sizeof(self->name), "equirect");
	} else {
		self->projection = -1;
		self->cd_m2_per_unit_sigma = USUAL_SCALE_SIGMA;
		self->glare.width_deg = USUAL_GLARE_WIDTH_DEG;
		self->ball.rim_px = USUAL_RIM_PX;
		self->ball.index = CHROME_INDEX;
		self->ball.extinction = CHROME_EXTINCTION;
		self->ball.outline_sigma_px = USUAL_OUTLINE_SIGMA_PX;
		ret = lp_ini_read(&self->ini, name_or_path,
				  "give --camera=equirect or a camera file");
		if (ret == 0)
			ret = set_fields(self);
	}
	if (ret < 0) {
		lp_camera_file_destroy(self);
		return ret;
	}
	*file = self;
	return 0;
}

void lp_camera_file_destroy(struct lp_camera_file *file)
{
	if (!file)
		return;
	lp_ini_finish(&file->ini);
	free(file);
}

struct lp_camera_profile lp_camera_file_profile(const struct lp_camera_file *file)
{
	return (struct lp_camera_profile){
		.size_px = {(uint32_t)file->width_px, (uint32_t)file->height_px},
		.usb = file->usb,
		.file = &file->ini,
	};
}
