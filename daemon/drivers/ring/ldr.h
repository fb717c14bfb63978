/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From an LDR's level to illuminance, by its calibration. R = R10 (E / 10 lx)^-gamma; the LDR lies
 * between supply and channel, `divider_ohm` from there to ground. Pure, but for reading the file.
 */
#ifndef LP_RING_LDR_H
#define LP_RING_LDR_H

#include "include/ring_sample.h"

struct lp_ldr_calibration {
	float divider_ohm;
	float r10_ohm[LP_RING_SENSORS];
	float gamma[LP_RING_SENSORS];
	float sigma[LP_RING_SENSORS]; /* relative, of the illuminance */
};

/* GL5528 as it comes: a factor of two. */
void lp_ldr_defaults(struct lp_ldr_calibration *calibration);

/* A calibration file (docs/ring_files.md). -errno or -EBADMSG, logged as FILE:LINE. */
int lp_ldr_read(struct lp_ldr_calibration *calibration, const char *path);

/* Share of the supply, 0..1, to lux; NAN at either end, where nothing can be told. */
float lp_ldr_lux(const struct lp_ldr_calibration *calibration, int sensor, float share);

#endif
