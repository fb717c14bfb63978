/* SPDX-License-Identifier: Apache-2.0 */
/* One reading of the ring of light sensors: eight on the equator, one up
 * (docs/users/conventions.md). */
#ifndef LP_RING_SAMPLE_H
#define LP_RING_SAMPLE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define LP_RING_SENSORS 9

struct lp_ring_sample {
	int64_t t_ns;				/* CLOCK_MONOTONIC of the middle of the scan */
	uint32_t sequence;			/* gaps are samples lost on the link */
	float illuminance_lux[LP_RING_SENSORS]; /* NAN: sensor open, shorted, saturated or not
						   fitted */
	float sigma_relative[LP_RING_SENSORS];	/* 1 sigma, errors that stay included */
	float noise_relative[LP_RING_SENSORS];	/* 1 sigma from reading to reading */
	/* Time constants with which the sensor follows more and less light; 0: at once. */
	float rise_s[LP_RING_SENSORS], fall_s[LP_RING_SENSORS];
	/* Tangents of the angles by which sensor k looks to its right and up of where it should
	 * (docs/builders/ring_files.md); 0 where nobody has measured it. */
	float seat[LP_RING_SENSORS][2];
	/* What the sensors see of red, green and blue; each colour has a scale of its own, which is
	 * found from light that does not clip. */
	float rgb[LP_RING_SENSORS][3];
	float colour_sigma; /* relative, of each of these numbers; 0: no colours */
	float common_sigma; /* relative, by which all nine may be off together */
};

/* Whether sensor k tells anything: a number of lux, and sigmas by which to weigh it. */
static inline bool lp_ring_tells(const struct lp_ring_sample *sample, int k)
{
	const float lux = sample->illuminance_lux[k], sigma = sample->sigma_relative[k];
	const float noise = sample->noise_relative[k];

	return lux >= 0.0F && isfinite(lux) && sigma > 0.0F && isfinite(sigma) && noise >= 0.0F &&
	       isfinite(noise);
}

#endif
