/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/ring/ldr.h"

#include <errno.h>
#include <ini.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/param.h"

#define LUX_AT_R10 10.0F
#define VERSION 1
#define LEAST_SHARE (1.0F / 4092.0F)

struct fields {
	int version;
	float divider_ohm;
	struct lp_floats r10_ohm, gamma, sigma;
};

struct reader {
	const char *path;
	struct fields fields;
	int ret;
};

static const struct lp_param params[] = {
	{"version", LP_PARAM_INT, offsetof(struct fields, version), .min = 1, .max = 1000},
	{"divider_ohm", LP_PARAM_FLOAT, offsetof(struct fields, divider_ohm), .min = 10,
	 .max = 1e6},
	{"r10_ohm", LP_PARAM_FLOATS, offsetof(struct fields, r10_ohm), .min = 100, .max = 1e6},
	{"gamma", LP_PARAM_FLOATS, offsetof(struct fields, gamma), .min = 0.3, .max = 1.5},
	{"sigma", LP_PARAM_FLOATS, offsetof(struct fields, sigma), .min = 0, .max = 10},
};

void lp_ldr_defaults(struct lp_ldr_calibration *calibration)
{
	calibration->divider_ohm = 3300;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		calibration->r10_ohm[k] = 14000;
		calibration->gamma[k] = 0.7F;
		calibration->sigma[k] = 1;
	}
}

/* inih's handler: 1 means well. */
static int on_value(void *context, const char *section, const char *name, const char *value)
{
	struct reader *reader = context;

	if (strcmp(section, "ring") != 0) {
		lp_error(reader->path, "parse", "[%s]: the only section is [ring]", section);
		reader->ret = -EBADMSG;
	} else if (lp_param_set(params, sizeof(params) / sizeof(params[0]), &reader->fields,
				reader->path, name, value) < 0) {
		reader->ret = -EBADMSG;
	}
	return reader->ret == 0;
}

static int nine(const char *path, const char *name, const struct lp_floats *values, float *to)
{
	if (values->count != LP_RING_SENSORS) {
		lp_error(path, name, "%d values: want nine, one for each sensor", values->count);
		return -EBADMSG;
	}
	memcpy(to, values->values, LP_RING_SENSORS * sizeof(*to));
	return 0;
}

int lp_ldr_read(struct lp_ldr_calibration *calibration, const char *path)
{
	struct reader reader = {.path = path};
	const struct fields *fields = &reader.fields;
	const int line = ini_parse(path, on_value, &reader);
	int ret = reader.ret;

	if (line == -1) {
		lp_error(path, "read", "no such file, or not readable — check calibration=");
		return -ENOENT;
	}
	if (ret == 0 && line != 0) {
		lp_error(path, "parse", "line %d: neither [ring] nor NAME = VALUE", line);
		ret = -EBADMSG;
	}
	if (ret == 0 && fields->version != VERSION) {
		lp_error(path, "version", "%d: this lightprobed reads %d — calibrate anew",
			 fields->version, VERSION);
		ret = -EBADMSG;
	}
	if (ret == 0 && fields->divider_ohm <= 0) {
		lp_error(path, "divider_ohm", "is missing");
		ret = -EBADMSG;
	}
	calibration->divider_ohm = fields->divider_ohm;
	if (ret == 0)
		ret = nine(path, "r10_ohm", &fields->r10_ohm, calibration->r10_ohm);
	if (ret == 0)
		ret = nine(path, "gamma", &fields->gamma, calibration->gamma);
	if (ret == 0)
		ret = nine(path, "sigma", &fields->sigma, calibration->sigma);
	return ret;
}

float lp_ldr_lux(const struct lp_ldr_calibration *calibration, int sensor, float share)
{
	if (!(share >= LEAST_SHARE) || share > 1 - LEAST_SHARE)
		return NAN;
	const float ohm = calibration->divider_ohm * (1 / share - 1);

	return LUX_AT_R10 *
	       powf(calibration->r10_ohm[sensor] / ohm, 1 / calibration->gamma[sensor]);
}
