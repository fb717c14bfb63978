/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which light has changed, by the change that the ring of light sensors reads. Each explanation (a
 * lamp and the light that the room throws back, two lamps, all light at once, light from no lamp
 * that is known) is fitted by weighted least squares; a hand before one or two sensors and a small
 * turn of the camera are explanations, too. What several explain about as well is shared among
 * them, with the variance of that. Pure functions on plain data; nothing is allocated.
 */
#ifndef LP_LIGHT_RING_RING_STEP_H
#define LP_LIGHT_RING_RING_STEP_H

#include "include/ring_sample.h"

#define LP_MAX_STEP_SOURCES 32

/* Irradiance at normal incidence (luminance), in the camera's units. */
struct lp_step_source {
	float weight[LP_RING_SENSORS]; /* cosine to each sensor, 0 or more */
	float now;		       /* that it has by the estimate; 0: it is off */
	float usual;		       /* that it has when it is on; 0: not known */
};

/* Irradiance on each sensor, in the camera's units. */
struct lp_step_question {
	float expected[LP_RING_SENSORS]; /* by the estimate */
	float change[LP_RING_SENSORS];	 /* of the light since then; NAN: not known */
	float sigma[LP_RING_SENSORS];	 /* 1 sigma of the change, by noise */
	float turn[3][LP_RING_SENSORS];	 /* what a turn about each axis changes, per radian */
	float turn_sigma_rad;		 /* how far the camera may have turned, 1 sigma, per axis */
	int count;
	struct lp_step_source sources[LP_MAX_STEP_SOURCES];
};

enum lp_step_verdict {
	LP_STEP_NONE,	 /* nothing has changed, or noise and a turn explain it */
	LP_STEP_SHADOW,	 /* something before one or two sensors explains it */
	LP_STEP_UNCLEAR, /* nothing explains it */
	LP_STEP_FOUND,
};

struct lp_step {
	enum lp_step_verdict verdict; /* all but FOUND: the rest is 0 */
	float change[LP_MAX_STEP_SOURCES];
	float variance[LP_MAX_STEP_SOURCES];
	float ambient[4]; /* irradiance on a surface: ambient[0] + ambient[1..3] . normal */
	float ambient_variance;
	float all; /* all light is 1 + all times what it was, besides */
	float all_variance;
};

/* `normals`: of the sensors, in the frame in which ambient[1..3] is wanted. */
void lp_ring_step(const struct lp_step_question *question, const float (*normals)[3],
		  struct lp_step *step);

#endif
