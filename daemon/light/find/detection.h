/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One panorama into lamps: which detector, with what settings. What follows (refinement at full
 * resolution, projection) needs pixels and is the application's pipeline.
 */
#ifndef LP_LIGHT_FIND_DETECTION_H
#define LP_LIGHT_FIND_DETECTION_H

#include "light/find/lamps.h"
#include "light/find/regions.h"

/* A peak is a lamp of its own when it is so many times as bright as its saddle to a brighter one.
 */
#define LP_PEAK_STANDS_OUT 1.6F

enum lp_detector {
	LP_DETECTOR_ADAPTIVE, /* default: peaks with persistence, excess over the surround */
	LP_DETECTOR_RESEARCH, /* the published recipe, step by step */
};

struct lp_detector_options {
	enum lp_detector detector;
	float threshold; /* radiance, of RESEARCH; 0: the median */
};

struct lp_detection {
	const struct lp_grid *grid; /* borrowed */
	struct lp_detector_options options;
	struct lp_regions *regions;
	struct lp_lamp_finder *finder;
	float *scratch; /* two planes of the grid */
};

int lp_detection_create(const struct lp_grid *grid, const struct lp_detector_options *options,
			struct lp_detection **detection);
void lp_detection_destroy(struct lp_detection *detection); /* accepts NULL; the grid stays */

/* Lamps into detection->finder->lamps, those included that are too faint to become one and strong
 * enough to stay one (lp_detection_enters()). mean: mean luminance over the sphere. */
void lp_detect(struct lp_detection *detection, const struct lp_panorama *panorama, float mean);

/* A lamp of the panorama before, over the cells that it had then (lp_lamp_finder_hold()); false
 * also for detectors whose lamps are no regions. */
bool lp_detection_hold(struct lp_detection *detection, const struct lp_panorama *panorama,
		       float mean, struct lp_lamp *lamp);

/* Whether the detector's lamps are regions that stand out of their surrounds. */
bool lp_detection_finds_regions(const struct lp_detection *detection);

/* How wide a lamp is as a source of shadows: the radius of the disc with the same solid angle, or a
 * quarter of its length. 0 for detectors whose user wants all that they find. */
float lp_detection_width_deg(const struct lp_detection *detection, const struct lp_lamp *lamp);

/* Whether this lamp of the finder is strong and clear enough to become one. */
bool lp_detection_enters(const struct lp_detection *detection, const struct lp_lamp *lamp);

#endif
