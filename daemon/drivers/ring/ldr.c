/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/ring/ldr.h"

#include <errno.h>
#include <math.h>

#include "base/ini.h"
#include "base/log.h"
#include "base/param.h"

#define LUX_AT_R10 10.0F
/* Of a GL5528 at 10 lux, by its data sheet. */
#define RISE_MS 20.0F
#define FALL_MS 30.0F
#define VERSION 2
#define LEAST_SHARE (1.0F / 4092.0F)
#define SHARE_SIGMA (6.0F / 4092.0F) /* the ADC's offset, 2 counts at most, and its steps */
#define LEAST_OHM 1e-3F
#define READING_NOISE (1.0F / 4092.0F) /* of the level from reading to reading, a mean of eight */
/* An LDR is slower in the dark: its traps empty with the current. By the square root of the light
 * below this; data sheets only state the time at 10 lux. */
#define SLOWER_BELOW_LUX 10.0F
#define MOST_SEAT_DEG 30.0

/* The keys with nine values, in the order of struct lp_ldr. */
enum { R10, GAMMA, SERIES, SIGMA, PIVOT, GAMMA_SIGMA, SERIES_SIGMA, NINES };

struct fields {
	int version;
	float divider_ohm, drift_sigma, rise_ms, fall_ms;
	struct lp_floats nines[NINES];
	/* These may be left out. */
	float drift_common_sigma;
	struct lp_floats seat_deg[2];
};

/* Versions of clang-format disagree about these lines. */
/* clang-format off */
#define NINE(key, index, least, most)                                                         \
	{key, LP_PARAM_FLOATS,                                                                \
	 offsetof(struct fields, nines) + (index) * sizeof(struct lp_floats), .min = (least), \
	 .max = (most)}
/* clang-format on */
static const struct lp_param list[] = {
	{"version", LP_PARAM_INT, offsetof(struct fields, version), .min = 1, .max = 1000},
	{"divider_ohm", LP_PARAM_FLOAT, offsetof(struct fields, divider_ohm), .min = 10,
	 .max = 1e6},
	{"drift_sigma", LP_PARAM_FLOAT, offsetof(struct fields, drift_sigma), .max = 10},
	{"rise_ms", LP_PARAM_FLOAT, offsetof(struct fields, rise_ms), .max = 10000},
	{"fall_ms", LP_PARAM_FLOAT, offsetof(struct fields, fall_ms), .max = 10000},
	{"drift_common_sigma", LP_PARAM_FLOAT, offsetof(struct fields, drift_common_sigma),
	 .max = 10},
	{"seat_right_deg", LP_PARAM_FLOATS, offsetof(struct fields, seat_deg[0]),
	 .min = -MOST_SEAT_DEG, .max = MOST_SEAT_DEG},
	{"seat_up_deg", LP_PARAM_FLOATS, offsetof(struct fields, seat_deg[1]),
	 .min = -MOST_SEAT_DEG, .max = MOST_SEAT_DEG},
	NINE("r10_ohm", R10, 100, 1e6),
	NINE("gamma", GAMMA, 0.3, 1.5),
	NINE("series_ohm", SERIES, 0, 1000),
	NINE("sigma", SIGMA, 0, 10),
	NINE("pivot_lux", PIVOT, 1e-3, 1e6),
	NINE("gamma_sigma", GAMMA_SIGMA, 0, 1),
	NINE("series_sigma_ohm", SERIES_SIGMA, 0, 1000),
};
static const struct lp_params params = LP_PARAMS(list);
#define FIRST_NINE (LP_COUNT(list) - NINES)

void lp_ldr_defaults(struct lp_ldr_calibration *calibration)
{
	calibration->divider_ohm = 3300;
	calibration->drift_sigma = 0.15F;
	calibration->rise_s = RISE_MS / 1000.0F;
	calibration->fall_s = FALL_MS / 1000.0F;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		calibration->sensors[k] = (struct lp_ldr){.r10_ohm = 14000,
							  .gamma = 0.7F,
							  .series_ohm = 85,
							  .sigma = 0.4F,
							  .pivot_lux = 10,
							  .gamma_sigma = 0.1F,
							  .series_sigma_ohm = 25};
}

/* Every key that must be there, is. */
static int check(const char *path, const struct fields *fields)
{
	if (fields->version != VERSION) {
		lp_error(path, "version", "%d: this lightprobed reads version %d — calibrate again",
			 fields->version, VERSION);
		return -EBADMSG;
	}
	if (fields->divider_ohm <= 0 || fields->drift_sigma < 0) {
		lp_error(path, fields->divider_ohm <= 0 ? "divider_ohm" : "drift_sigma",
			 "is missing");
		return -EBADMSG;
	}
	for (int i = 0; i < NINES; i++) {
		if (fields->nines[i].count != LP_RING_SENSORS) {
			lp_error(path, list[FIRST_NINE + (size_t)i].name,
				 "%d values, but nine are needed: one for each sensor",
				 fields->nines[i].count);
			return -EBADMSG;
		}
	}
	for (int i = 0; i < 2; i++) {
		const int count = fields->seat_deg[i].count;

		if (count != 0 && count != LP_RING_SENSORS) {
			lp_error(path, i ? "seat_up_deg" : "seat_right_deg",
				 "%d values, but nine are needed: one for each sensor", count);
			return -EBADMSG;
		}
	}
	return 0;
}

static void take(struct lp_ldr_calibration *calibration, const struct fields *fields)
{
	calibration->divider_ohm = fields->divider_ohm;
	calibration->drift_sigma = fields->drift_sigma;
	calibration->rise_s = fields->rise_ms / 1000.0F;
	calibration->fall_s = fields->fall_ms / 1000.0F;
	calibration->drift_common_sigma = fields->drift_common_sigma;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		for (int i = 0; i < 2; i++)
			calibration->seat[k][i] =
				tanf(fields->seat_deg[i].values[k] * (float)M_PI / 180.0F);
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const struct lp_floats *nines = fields->nines;

		calibration->sensors[k] =
			(struct lp_ldr){.r10_ohm = nines[R10].values[k],
					.gamma = nines[GAMMA].values[k],
					.series_ohm = nines[SERIES].values[k],
					.sigma = nines[SIGMA].values[k],
					.pivot_lux = nines[PIVOT].values[k],
					.gamma_sigma = nines[GAMMA_SIGMA].values[k],
					.series_sigma_ohm = nines[SERIES_SIGMA].values[k]};
	}
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
		ret = lp_ini_set(&ini, "ring", &params, fields);
	lp_ini_finish(&ini);
	return ret;
}

int lp_ldr_read(struct lp_ldr_calibration *calibration, const char *path)
{
	struct fields fields = {.drift_sigma = -1, .rise_ms = RISE_MS, .fall_ms = FALL_MS};
	int ret = read_fields(path, &fields);

	if (ret == 0)
		ret = check(path, &fields);
	if (ret == 0)
		take(calibration, &fields);
	return ret;
}

float lp_ldr_lux(const struct lp_ldr_calibration *calibration, int sensor, float share,
		 float *sigma_relative)
{
	const struct lp_ldr *ldr = &calibration->sensors[sensor];

	*sigma_relative = NAN;
	if (!(share >= LEAST_SHARE) || share > 1 - LEAST_SHARE)
		return NAN;
	const float slope_ohm = calibration->divider_ohm / (share * share);
	const float ohm_sigma = hypotf(slope_ohm * SHARE_SIGMA, ldr->series_sigma_ohm);
	/* No LDR has no resistance: at least half of what it may be off. */
	const float ohm = fmaxf(calibration->divider_ohm * (1 / share - 1) - ldr->series_ohm,
				fmaxf(ohm_sigma / 2, LEAST_OHM));
	const float lux = LUX_AT_R10 * powf(ldr->r10_ohm / ohm, 1 / ldr->gamma);
	const float by_gamma = logf(lux / ldr->pivot_lux) * ldr->gamma_sigma;
	const float of_fit = hypotf(by_gamma, ohm_sigma / ohm) / ldr->gamma;

	*sigma_relative = hypotf(of_fit, hypotf(ldr->sigma, calibration->drift_sigma));
	return lux;
}

void lp_ldr_dynamics(const struct lp_ldr_calibration *calibration, int sensor, float lux,
		     struct lp_ring_sample *sample)
{
	const struct lp_ldr *ldr = &calibration->sensors[sensor];
	const float slower = sqrtf(fmaxf(SLOWER_BELOW_LUX / lux, 1.0F));
	const float ohm = ldr->r10_ohm * powf(lux / LUX_AT_R10, -ldr->gamma);
	const float whole_ohm = calibration->divider_ohm + ldr->series_ohm + ohm;
	/* of the share, divider / whole, to that of the illuminance, ohm^(-1 / gamma) */
	const float noise =
		READING_NOISE * whole_ohm * whole_ohm / (calibration->divider_ohm * ohm);

	sample->rise_s[sensor] = calibration->rise_s * slower;
	sample->fall_s[sensor] = calibration->fall_s * slower;
	sample->noise_relative[sensor] = noise / ldr->gamma;
}
