/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Estimates while no camera gives any: one lamp and an even surround, by the ring of light sensors
 * (light/ring/ring_alone.h). Plain data. Loop thread.
 */
#ifndef LP_ESTIMATE_RING_RING_ONLY_H
#define LP_ESTIMATE_RING_RING_ONLY_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/pipeline.h"
#include "include/ring_sample.h"
#include "light/math/sh.h"

struct lp_rotation;

/*
 * The light that the ring sees by itself, of whatever else `estimate` has: coefficients, one lamp,
 * predicted error and sigma, scale; the flag RING_ONLY, or NO_LIGHT where it is dark. `turn`: from
 * the probe's frame to that of the estimate. `total` becomes all orders of its light.
 */
void lp_ring_only_light(const struct lp_ring_sample *sample, const struct lp_ring_scale *scale,
			const struct lp_rotation *turn, double total[LP_SH_MAX_COUNT][3],
			struct lp_light_estimate *estimate);

struct lp_ring_only {
	float smoothing_ms;
	int64_t patience_ns; /* without a camera's estimate: then the ring speaks */
	int64_t t_camera_ns; /* of the camera's last estimate, or the start */
	int64_t t_last_ns;   /* of our own last one; 0: none since the camera's */
	/* cd/m^2 per unit of the radiance that clients have got so far; 1 where nothing is known:
	 * then radiance is in cd/m^2. */
	struct lp_ring_scale scale;
	struct lp_ring_sample smoothed;
};

/* given: what camera file or user say of the camera; NAN: nothing. */
void lp_ring_only_init(struct lp_ring_only *self, const struct lp_ring_scale *given,
		       float smoothing_ms, float ttl_ms, int64_t now_ns);

/* The camera has given an estimate. */
void lp_ring_only_camera(struct lp_ring_only *self, const struct lp_light_estimate *estimate,
			 int64_t now_ns);

/* The ring has given a reading. True: the camera has been silent for too long, and `estimates` is
 * what the ring says, with the flag RING_ONLY; at most 30 times a second. */
bool lp_ring_only_sample(struct lp_ring_only *self, const struct lp_ring_sample *sample,
			 int64_t now_ns, struct lp_estimates *estimates);

#endif
