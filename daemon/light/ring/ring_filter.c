/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_filter.h"

#include <math.h>
#include <stdbool.h>

/* Chosen by hand (docs/maintainers/constants.md). */

/* A sensor that was missing for longer begins anew. */
#define LONGEST_GAP_S 0.25
/* Light wanders by this share in a second, 1 sigma, without being switched; and that on a sensor
 * that turns by so much more per radian per second. */
#define WANDER 0.1
#define TURNING 0.2
/* How well time constants are known, relative. */
#define LAG_SIGMA 0.2
/* Least noise of a reading, relative, and in lux. */
#define LEAST_NOISE 1e-3
#define LEAST_LUX 1e-6
/* A change is an innovation of this many sigmas. */
#define JUMP_SIGMAS 5.0
/* The running mean of the squared innovations: its gain, and what one of them counts at most. */
#define RESTLESS_GAIN 0.02
#define MOST_RESTLESS 9.0

static void begin(struct lp_sensor_filter *s, int64_t t_ns, double lux, double variance)
{
	*s = (struct lp_sensor_filter){.t_ns = t_ns,
				       .light = lux,
				       .felt = lux,
				       .covariance = {variance, variance, variance},
				       .restlessness = 1.0};
}

static double square(double x)
{
	return x * x;
}

/* felt' = felt + share (light - felt); the light stays, or wanders. */
static void predict(struct lp_sensor_filter *s, double share, double wander_per_s, double elapsed_s)
{
	double *p = s->covariance;
	const double gap = share * (s->light - s->felt);
	const double wander = square(wander_per_s * s->light) * elapsed_s;

	s->felt += gap;
	p[2] = square(share) * p[0] + 2.0 * share * (1.0 - share) * p[1] +
	       square(1.0 - share) * p[2] + square(LAG_SIGMA * gap);
	p[1] = share * p[0] + (1.0 - share) * p[1];
	/* what has wandered is felt, too */
	p[0] += wander;
	p[1] += share * wander;
	p[2] += square(share) * wander;
}

static void correct(struct lp_sensor_filter *s, double innovation, double noise)
{
	double *p = s->covariance;
	const double total = p[2] + noise;
	const double to_light = p[1] / total, to_felt = p[2] / total;

	s->light = fmax(s->light + to_light * innovation, 0.0);
	s->felt = fmax(s->felt + to_felt * innovation, 0.0);
	p[0] = fmax(p[0] - to_light * p[1], 0.0);
	p[1] -= to_light * p[2];
	p[2] = fmax(p[2] - to_felt * p[2], 0.0);
}

/* Returns whether the light has jumped. */
static bool follow(struct lp_sensor_filter *s, const struct lp_ring_sample *reading, int k,
		   double wander_per_s)
{
	const double lux = reading->illuminance_lux[k];
	const double relative = fmax(reading->noise_relative[k], LEAST_NOISE);
	const double noise = square(relative * lux + LEAST_LUX);
	const double elapsed_s = (double)(reading->t_ns - s->t_ns) / 1e9;

	if (s->t_ns == 0 || elapsed_s < 0.0 || elapsed_s > LONGEST_GAP_S) {
		begin(s, reading->t_ns, lux, noise);
		return false;
	}
	const double lag_s = lux > s->felt ? reading->rise_s[k] : reading->fall_s[k];
	const double share = lag_s > 0.0 ? -expm1(-elapsed_s / lag_s) : 1.0;

	s->t_ns = reading->t_ns;
	predict(s, share, wander_per_s, elapsed_s);
	const double innovation = lux - s->felt;
	const double sigmas2 = square(innovation) / (s->covariance[2] + noise);
	const bool jumps = sigmas2 > square(JUMP_SIGMAS) * s->restlessness;

	s->restlessness += RESTLESS_GAIN * (fmin(sigmas2, MOST_RESTLESS) - s->restlessness);
	s->restlessness = fmax(s->restlessness, 1.0);
	if (jumps && share > 0.0) { /* the light may be anything now */
		const double anything = square(innovation / share);

		s->covariance[0] += anything;
		s->covariance[1] += share * anything;
		s->covariance[2] += square(share) * anything;
	}
	correct(s, innovation, noise);
	return jumps;
}

uint32_t lp_ring_filter_update(struct lp_ring_filter *filter, const struct lp_ring_sample *reading,
			       struct lp_ring_sample *light)
{
	const double wander_per_s = WANDER + TURNING * filter->turn_rad_s;
	uint32_t jumped = 0;

	*light = *reading;
	if (reading->t_ns == 0)
		return 0;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		struct lp_sensor_filter *s = &filter->sensors[k];
		const float lux = reading->illuminance_lux[k], noise = reading->noise_relative[k];

		if (!(lux >= 0.0F && isfinite(lux) && noise >= 0.0F && isfinite(noise)))
			continue;
		if (follow(s, reading, k, wander_per_s))
			jumped |= 1U << k;
		light->illuminance_lux[k] = (float)fmax(s->light, LEAST_LUX);
		light->noise_relative[k] =
			(float)sqrt(s->covariance[0]) / light->illuminance_lux[k];
	}
	return jumped;
}
