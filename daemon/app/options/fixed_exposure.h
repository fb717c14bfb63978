/* SPDX-License-Identifier: Apache-2.0 */
/* One exposure instead of brackets: --exposure-us and --gain, and what the camera makes of them. */
#ifndef LP_APP_OPTIONS_FIXED_EXPOSURE_H
#define LP_APP_OPTIONS_FIXED_EXPOSURE_H

#include <stdbool.h>

struct lp_source;
struct lp_source_caps;

/* Whether a camera can set this gain; 0: none is asked for. False: logged under `object` (a URI),
 * with what it offers and the next step. */
bool lp_gain_is_offered(const struct lp_source_caps *caps, float gain, const char *object);

/*
 * Command this exposure and gain of a source that has just begun to stream; gain 0: of 1. What it
 * can only do nearly, or not at all, is logged under `object`. Loop thread.
 */
void lp_fixed_exposure_command(struct lp_source *source, const struct lp_source_caps *caps,
			       float exposure_us, float gain, const char *object);

#endif
