/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Several cameras: by which factors the light of one is brought to the scale and the colours of the
 * first, as the part of the sphere shows that two of them see. One factor per channel; it changes
 * slowly (temperature, age), so that every frame corrects it by a little (a Kalman filter on its
 * logarithm). Pure computation on numbers; one thread; plain data.
 */
#ifndef LP_VISION_DOUBT_OVERLAP_H
#define LP_VISION_DOUBT_OVERLAP_H

#include <stdbool.h>

struct lp_gain;
struct lp_response;

struct lp_overlap {
	float log_gain[3]; /* R, G, B: logarithm of the factor */
	float variance[3]; /* of it */
	float applied[3];  /* what the camera's response holds of it */
};

/* Nothing has been compared: two cameras of one make. The first one's factors are 1. */
void lp_overlap_init(struct lp_overlap *overlap, bool is_first);

/* It may have drifted in the time between two frames. */
void lp_overlap_pass(struct lp_overlap *overlap, float elapsed_s);

/*
 * The same light as two cameras show it: `cells` hold as reference what the other one shows, whose
 * factor has log_gain `other`, its variance `other_variance`. Leaves out what is no difference
 * between two cameras.
 */
void lp_overlap_correct(struct lp_overlap *overlap, int channel, struct lp_gain *cells,
			float other_variance);

/* Hand the factors to the camera's response. False: they have not changed. */
bool lp_overlap_apply(struct lp_overlap *overlap, struct lp_response *response);

/* 1 sigma, relative, of the light of this camera against that of the first. */
float lp_overlap_sigma(const struct lp_overlap *overlap);

#endif
