/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Does a camera change its exposure in the midst of a picture? Then the first rows of a frame still
 * have the exposure of the frame before, and their light is wrong by the ratio of the two.
 *
 * Across the row where that ends, light steps by as much as the exposure has changed. What the
 * scene has there does not follow the exposure: the regression of the step on the change is 1 at a
 * tear, and 0 elsewhere. Pure computation; one thread; no allocation.
 */
#ifndef LP_VISION_RESPONSE_TEAR_H
#define LP_VISION_RESPONSE_TEAR_H

#include <stdbool.h>

#include "vision/picture/cells.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LP_TEAR_ROWS 32

/* Plain data; lp_tear_init() starts it. */
struct lp_tear {
	float log_exposure; /* of the frame before; NAN: there was none */
	/* Sums, lately, of what each row's light steps by as the exposure changes. */
	struct lp_tear_row {
		float places, step, change, product, step2, change2;
	} rows[LP_TEAR_ROWS];
	float frames; /* with another exposure than the one before: so many, up to "lately" */
	float apart;  /* by which it changed: mean logarithm */
	float share;  /* of the rows that have the exposure of the frame before */
	bool found;
};

void lp_tear_init(struct lp_tear *tear);

/* The newest frame's cells, as they come from the picture. log_exposure: logarithm of its exposure,
 * in any unit. */
void lp_tear_learn(struct lp_tear *tear, const struct lp_cells *cells, float log_exposure);

/* 1 sigma of light, relative; 0 unless it is found. */
float lp_tear_sigma(const struct lp_tear *tear);

#ifdef __cplusplus
}
#endif

#endif
