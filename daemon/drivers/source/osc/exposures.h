/* SPDX-License-Identifier: Apache-2.0 */
/* The shutter speeds and sensitivities that a camera lists: it takes no others. */
#ifndef LP_SOURCE_OSC_EXPOSURES_H
#define LP_SOURCE_OSC_EXPOSURES_H

#include <jansson.h>

#include "include/source.h"

#define LP_OSC_ISOS_MAX 32

struct lp_osc_exposures {
	int exposure_count, iso_count;
	float exposures_us[LP_EXPOSURES_MAX]; /* ascending */
	double shutters_s[LP_EXPOSURES_MAX];  /* the same, with the digits that the camera wants */
	int isos[LP_OSC_ISOS_MAX];	      /* ascending */
	int base_iso;			      /* that counts as gain 1 */
};

/* From shutterSpeedSupport (those that end within a frame of `rate_hz`) and isoSupport. `iso`: what
 * counts as gain 1; 0: the lowest. -EPROTO: a list is missing or empty; -EINVAL: `iso` is not
 * listed. */
int lp_osc_exposures_read(struct lp_osc_exposures *range, const json_t *options, float rate_hz,
			  int iso);

/* The nearest exposure and gain, in stops. */
void lp_osc_exposures_snap(const struct lp_osc_exposures *range, float *exposure_us, float *gain);

/* The options that set them; both are of the lists. NULL: out of memory; to be released. */
json_t *lp_osc_exposures_options(const struct lp_osc_exposures *range, float exposure_us,
				 float gain);

#endif
