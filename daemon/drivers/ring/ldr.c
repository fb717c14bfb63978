/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/ring/ldr.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/ini.h"
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

static int nine(const char *path, const char *name, const struct lp_floats *values, float *to)
{
	if (values->count != LP_RING_SENSORS) {
		lp_error(path, name, "%d values: want nine, one for each sensor", values->count);
		return -EBADMSG;
	}
	memcpy(to, values->values, LP_RING_SENSORS * sizeof(*to));
	return 0;
}

static int read_fields(const char *path, struct fields *fields)
{
	static const char *const sections[] = {"ring", NULL};
	struct lp_ini ini;
	int ret = lp_ini_read(&ini, path, "check calibration=");

	if (ret < 0)
		return ret;
	ret = lp_ini_check_sections(&ini, sections);
	if (ret == 0)
		ret = lp_ini_set(&ini, "ring", params, sizeof(params) / sizeof(params[0]), fields);
	lp_ini_finish(&ini);
	return ret;
}

int lp_ldr_read(struct lp_ldr_calibration *calibration, const char *path)
{
	struct fields fields = {0};
	int ret = read_fields(path, &fields);

	if (ret < 0)
		return ret;
	if (fields.version != VERSION) {
		lp_error(path, "version", "%d: this lightprobed reads %d — calibrate anew",
			 fields.version, VERSION);
		return -EBADMSG;
	}
	if (fields.divider_ohm <= 0) {
		lp_error(path, "divider_ohm", "is missing");
		return -EBADMSG;
	}
	calibration->divider_ohm = fields.divider_ohm;
	ret = nine(path, "r10_ohm", &fields.r10_ohm, calibration->r10_ohm);
	if (ret == 0)
		ret = nine(path, "gamma", &fields.gamma, calibration->gamma);
	if (ret == 0)
		ret = nine(path, "sigma", &fields.sigma, calibration->sigma);
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
