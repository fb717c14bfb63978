/* SPDX-License-Identifier: Apache-2.0 */
#include "light/find/detection.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "light/find/research.h"
#include "light/math/grid.h"

/* A lamp is brighter than twice the mean, of the brightest tenth of the sphere and no larger,
 * LP_PEAK_STANDS_OUT times its own saddle to a brighter one, and reaches down to a tenth of its
 * peak; it gives a surface facing it at least a hundredth of its light, and stands out of its
 * surround twofold. Chosen by hand; docs/maintainers/constants.md says what half and double of each
 * does. */
static const struct lp_peak_options peak_options = {.floor_ratio = 2.0F,
						    .area_sr = 1.2F,
						    .persistence_ratio = LP_PEAK_STANDS_OUT,
						    .core_ratio = 0.1F,
						    .clipped_core_ratio = 0.5F};
static const struct lp_lamp_options lamp_options = {.min_strength = 0.01F,
						    .min_contrast = 2.0F,
						    .min_contrast_to_noise = 5.0F};
/* What is a lamp stays one down to this share of all three, so that noise does not make it come and
 * go. */
#define STAYS 0.6F

int lp_detection_create(const struct lp_grid *grid, const struct lp_detector_options *options,
			struct lp_detection **detection)
{
	struct lp_detection *d = calloc(1, sizeof(*d));
	int ret = -ENOMEM;

	if (!d)
		return ret;
	d->grid = grid;
	d->options = *options;
	d->scratch = calloc(2 * (size_t)grid->width * grid->height, sizeof(*d->scratch));
	if (d->scratch)
		ret = lp_regions_create(grid, &d->regions);
	if (ret == 0)
		ret = lp_lamp_finder_create(grid, &d->finder);
	if (ret < 0) {
		lp_detection_destroy(d);
		return ret;
	}
	*detection = d;
	return 0;
}

void lp_detection_destroy(struct lp_detection *detection)
{
	if (!detection)
		return;
	lp_lamp_finder_destroy(detection->finder);
	lp_regions_destroy(detection->regions);
	free(detection->scratch);
	free(detection);
}

/* Of what is a lamp already. */
static struct lp_lamp_options to_stay(void)
{
	return (struct lp_lamp_options){.min_strength = STAYS * lamp_options.min_strength,
					.min_contrast = STAYS * lamp_options.min_contrast,
					.min_contrast_to_noise =
						STAYS * lamp_options.min_contrast_to_noise};
}

static void find_lamps(struct lp_detection *detection, const struct lp_panorama *panorama,
		       float mean)
{
	const struct lp_lamp_options options = to_stay();

	lp_regions_from_peaks(detection->regions, panorama, mean, &peak_options);
	lp_find_lamps(detection->finder, panorama, detection->regions, mean, &options);
}

bool lp_detection_finds_regions(const struct lp_detection *detection)
{
	return detection->options.detector == LP_DETECTOR_ADAPTIVE;
}

float lp_detection_width_deg(const struct lp_detection *detection, const struct lp_lamp *lamp)
{
	/* of Omega = 4 pi sin^2(r / 2) */
	const float radius_rad =
		2.0F * asinf(fminf(sqrtf(lamp->solid_angle_sr / (4.0F * (float)M_PI)), 1.0F));

	if (!lp_detection_finds_regions(detection))
		return 0.0F;
	return fmaxf(radius_rad * 180.0F / (float)M_PI, lamp->half_angle_deg[0] / 2.0F);
}

bool lp_detection_hold(struct lp_detection *detection, const struct lp_panorama *panorama,
		       float mean, struct lp_lamp *lamp)
{
	const struct lp_lamp_options options = to_stay();

	return lp_detection_finds_regions(detection) &&
	       lp_lamp_finder_hold(detection->finder, panorama, mean, &options, lamp);
}

bool lp_detection_enters(const struct lp_detection *detection, const struct lp_lamp *lamp)
{
	if (!lp_detection_finds_regions(detection))
		return true;
	return lamp->share >= lamp_options.min_strength &&
	       lamp->contrast >= lamp_options.min_contrast &&
	       lamp->contrast_to_noise >= lamp_options.min_contrast_to_noise;
}

void lp_detect(struct lp_detection *detection, const struct lp_panorama *panorama, float mean)
{
	switch (detection->options.detector) {
	case LP_DETECTOR_ADAPTIVE:
		find_lamps(detection, panorama, mean);
		return;
	case LP_DETECTOR_RESEARCH:
		lp_research_detect(detection->finder, panorama, detection->options.threshold,
				   detection->scratch);
		return;
	}
}
