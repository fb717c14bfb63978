/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the camera clips, found by the ring of light sensors. Each sensor reads
 *
 *     lux = scale * (seen + sum_j weight_j x_j),
 *
 * where `seen` is the light that the camera knows, x_j >= 0 is what clipped part j (a lamp, or a
 * region: light/clipped/clipped_parts.h) holds beyond what the camera saw of it, and `scale` is in
 * lux per unit. All of these are solved for by non-negative least squares, each reading weighed by
 * its sigma. Light that only explains noise is left out: each x_j pays log(x_j + its bound)
 * (Candes, Wakin & Boyd 2008). The same is done for other explanations of the readings
 * (light/clipped/ring_explain.h); the result is the mean over all of them, weighed by how likely
 * each is, and its covariance contains how far they differ. Readings of the same light from other
 * poses are more equations for the same unknowns. Pure functions on plain data; nothing is
 * allocated.
 */
#ifndef LP_LIGHT_CLIPPED_RING_FUSION_H
#define LP_LIGHT_CLIPPED_RING_FUSION_H

#include <stdbool.h>
#include <stdint.h>

#include "include/ring_sample.h"
#include "light/clipped/clipped_parts.h"

struct lp_grid;
struct lp_panorama;
struct lp_rotation;

/* Illuminance on each sensor per unit of a part's irradiance at normal incidence. */
struct lp_ring_part {
	float weight[LP_RING_SENSORS];
	/* 1 sigma of the weight, as nobody knows where in the part the light is */
	float spread[LP_RING_SENSORS];
	float bound; /* luminance of the irradiance that the camera saw of it */
};

struct lp_ring_view {
	float seen[LP_RING_SENSORS]; /* all that the camera saw, bounds included; units * sr */
	float seen_sigma; /* 1 sigma of `seen`, independent from sensor to sensor; relative */
	int count;
	struct lp_ring_part parts[LP_MAX_CLIPPED_PARTS];
};

/* No scale is less than this share of the one that is known, or of the best one. */
#define LP_RING_LEAST_SCALE 0.02
/* Sensors that a fit needs. */
#define LP_RING_LEAST_USED 4

/* Readings of the same light from elsewhere: the camera and the ring have turned since then. */
#define LP_RING_POSES 12

struct lp_ring_past {
	int count;
	struct lp_ring_look {
		struct lp_ring_view view; /* the parts of the newest reading's, in its order */
		struct lp_ring_sample sample;
		float age_s;
	} list[LP_RING_POSES];
};

/* Lux per unit of luminance times solid angle: cd/m^2 per unit. NAN: not known. */
struct lp_ring_scale {
	float lux_per_unit;
	float sigma; /* relative */
};

enum lp_ring_verdict {
	LP_RING_NO_READING, /* fewer than four sensors can be used */
	LP_RING_AGREES,
	LP_RING_TURNED,	   /* it is turned by `turned_deg`, and read so */
	LP_RING_DISAGREES, /* it does not show the light that the camera sees */
};

/* Whether something was found. */
static inline bool lp_ring_counts(enum lp_ring_verdict verdict)
{
	return verdict == LP_RING_AGREES || verdict == LP_RING_TURNED;
}

struct lp_ring_fusion {
	enum lp_ring_verdict verdict; /* NO_READING, DISAGREES: the excess is 0 */
	/* What is as good as certain; what is only likely is in the covariance. */
	uint32_t wrong;	     /* bit k: sensor k contradicts the others, and does not count */
	bool scale_is_wrong; /* the scale that was given contradicts the readings; not used */
	float turned_deg;    /* TURNED: to the right, seen from above */
	struct lp_ring_scale scale; /* as known now */
	/* Luminance of the irradiance that part j has beyond its bound, its 1 sigma, and the
	 * covariance; all in the camera's units. */
	float excess[LP_MAX_CLIPPED_PARTS];
	float sigma[LP_MAX_CLIPPED_PARTS];
	float covariance[LP_MAX_CLIPPED_PARTS][LP_MAX_CLIPPED_PARTS];
	bool changed; /* the newest reading contradicts the ones before: those did not count */
	float misfit; /* of the best explanation: mean squared residual, in sigmas squared */
};

/* Where sensor k should look, in the probe frame (docs/users/conventions.md), and where those of
 * this reading do. */
void lp_ring_direction(int sensor, float direction[3]);
void lp_ring_looks_along(const struct lp_ring_sample *sample, int sensor, float direction[3]);

/* What falls on a ring in the camera's frame, which `to_panorama` turns into the panorama's; of the
 * reading only the seats count. `channel`: of the panorama's cells. view->seen_sigma is left to the
 * caller. */
void lp_ring_view_init(struct lp_ring_view *view, const struct lp_grid *grid,
		       const struct lp_panorama *panorama, const struct lp_clipped_parts *parts,
		       const struct lp_rotation *to_panorama, const struct lp_ring_sample *sample,
		       int channel);

/* `past`: NULL: none. The newest reading says what may be wrong with the ring; what does not
 * explain the ones before, too, becomes less likely. */
void lp_ring_fuse(const struct lp_ring_view *view, const struct lp_ring_sample *sample,
		  const struct lp_ring_past *past, const struct lp_ring_scale *known,
		  struct lp_ring_fusion *fusion);

/* Variance of the irradiance on a surface, mean over all normals, that the excess's covariance
 * brings (luminance, camera's units). */
float lp_ring_variance(const struct lp_ring_fusion *fusion, const struct lp_clipped_parts *parts);

#endif
