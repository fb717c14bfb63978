/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The light behind the readings of the ring. A light-dependent resistor follows the light with a
 * lag of tens of milliseconds, more in the dark. Each sensor has a Kalman filter of two unknowns,
 * the light and what the sensor feels of it; that takes the lag off, at the price of noise that the
 * filter knows. Light that changes at once is told from noise by the innovation. Plain data; zeroed
 * is a new one.
 */
#ifndef LP_LIGHT_RING_RING_FILTER_H
#define LP_LIGHT_RING_RING_FILTER_H

#include "include/ring_sample.h"

struct lp_sensor_filter {
	int64_t t_ns;	      /* of the last reading that could be used; 0: none yet */
	double light, felt;   /* lux */
	double covariance[3]; /* of light; of both; of felt */
	double restlessness;  /* running mean of the squared innovations in sigmas, 1 or more */
};

struct lp_ring_filter {
	struct lp_sensor_filter sensors[LP_RING_SENSORS];
	float turn_rad_s; /* how fast the ring turns, as far as the caller knows */
};

/*
 * The next reading, in the order of their times: `light` becomes what fell on the sensors at its
 * time, with noise_relative; what is not known stays NAN. A reading without a time (t_ns 0) is
 * taken as it is. Returns a bit for each sensor whose light has changed by more than noise, slow
 * change and the restlessness of the last half second explain.
 */
uint32_t lp_ring_filter_update(struct lp_ring_filter *filter, const struct lp_ring_sample *reading,
			       struct lp_ring_sample *light);

#endif
