/* SPDX-License-Identifier: Apache-2.0 */
/* The camera from the inside, for its two parts: camera.c (from its address to a live preview) and
 * neutral.c (its processing). */
#ifndef LP_SOURCE_OSC_CAMERA_PARTS_H
#define LP_SOURCE_OSC_CAMERA_PARTS_H

#include <jansson.h>
#include <stdbool.h>

#include "drivers/source/osc/camera.h"

/* All or none. Takes over `options`. */
int lp_osc_set_options(struct lp_osc_camera *camera, json_t *options, struct lp_osc_fault *fault);

/* The options of these names (the last one NULL) into `*options`, to be released. */
int lp_osc_get_options(struct lp_osc_camera *camera, const char *const *names, json_t **options,
		       struct lp_osc_fault *fault);

/* Keep what is not kept yet: after a reconnection the present values are ours. */
void lp_osc_remember(struct lp_osc_camera *camera, const json_t *options);

/* neutral.c: switch processing off in the present mode, before the exposure is made manual: an
 * image filter would make it automatic. What the camera refuses is told, not an error. -errno with
 * `*fault`: it does not answer. */
int lp_osc_neutralize(struct lp_osc_camera *camera, struct lp_osc_fault *fault);

/* Is an image filter still on, with which no exposure can be set? */
bool lp_osc_has_filter(const struct lp_osc_camera *camera);

/* `options` has the camera's whiteBalance: does it adapt, and stay so? */
void lp_osc_look_at_white_balance(struct lp_osc_camera *camera, const json_t *options);

/* Of what was saved: one refused option is not to take the others with it. */
void lp_osc_leave_out_processing(json_t *options);
int lp_osc_restore_processing(struct lp_osc_camera *camera, struct lp_osc_fault *fault);

#endif
