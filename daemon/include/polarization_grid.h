/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How light is polarized, as a coarse equirectangular picture in the probe frame
 * (include/panorama.h): what PolarizationMap of the wire carries.
 */
#ifndef LP_POLARIZATION_GRID_H
#define LP_POLARIZATION_GRID_H

#include <stdint.h>

/* 3 degrees: a window can be told, a face cannot. */
#define LP_POLARIZATION_WIDTH 120
#define LP_POLARIZATION_HEIGHT 60
#define LP_POLARIZATION_CELLS (LP_POLARIZATION_WIDTH * LP_POLARIZATION_HEIGHT)

struct lp_polarization_grid {
	int64_t t_capture_ns; /* CLOCK_MONOTONIC, of the newest frame in it */
	float s0_unit;
	/* Half floats (base/half.h): S0 / s0_unit, S1 / S0, S2 / S0, 1 sigma of these two; NaN: not
	 * known. */
	uint16_t cells[LP_POLARIZATION_CELLS][4];
};

#endif
