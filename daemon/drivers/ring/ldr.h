/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From an LDR's level to illuminance and its uncertainty, by its calibration. R = R10 (E / 10 lx)
 * ^-gamma; between supply and channel lie the LDR and what is in series with it (the multiplexer),
 * `divider_ohm` from there to ground. The same model as lightprobe/calibrate/ring.py. Pure, but for
 * reading the file.
 */
#ifndef LP_RING_LDR_H
#define LP_RING_LDR_H

#include "include/ring_sample.h"

/* Of each sensor; sigmas are relative, 1 sigma, of the illuminance, unless they name a unit. */
struct lp_ldr {
	float r10_ohm, gamma, series_ohm;
	float sigma, pivot_lux; /* where it is known best, and how well */
	float gamma_sigma, series_sigma_ohm;
};

struct lp_ldr_calibration {
	float divider_ohm;
	float drift_sigma; /* of every sensor since the calibration: temperature, former light */
	float drift_common_sigma; /* likewise, of all sensors together: temperature above all */
	float rise_s, fall_s;	  /* time constants with which it follows the light, at 10 lux */
	float seat[LP_RING_SENSORS][2]; /* as in struct lp_ring_sample */
	struct lp_ldr sensors[LP_RING_SENSORS];
};

/* GL5528 behind a 74HC4067 as they come: right within a factor of two. */
void lp_ldr_defaults(struct lp_ldr_calibration *calibration);

/* A calibration file (docs/builders/ring_files.md). -errno or -EBADMSG, logged as FILE:LINE. */
int lp_ldr_read(struct lp_ldr_calibration *calibration, const char *path);

/* Share of the supply, 0..1, to lux and its relative 1 sigma; both NAN at either end, where nothing
 * can be told. */
float lp_ldr_lux(const struct lp_ldr_calibration *calibration, int sensor, float share,
		 float *sigma_relative);

/* How a sensor that reads so many lux follows the light, and how much it varies from reading to
 * reading: fills the sample's rise_s, fall_s and noise_relative. */
void lp_ldr_dynamics(const struct lp_ldr_calibration *calibration, int sensor, float lux,
		     struct lp_ring_sample *sample);

#endif
