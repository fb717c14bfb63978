/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A camera's commands: Open Spherical Camera, API 2.1, as RICOH publishes it
 * (github.com/ricohapi/theta-api-specs). From its address to a live preview with its exposure held,
 * and back to what it was. The capture's thread.
 */
#ifndef LP_SOURCE_OSC_CAMERA_H
#define LP_SOURCE_OSC_CAMERA_H

#include <jansson.h>
#include <stdbool.h>

#include "drivers/source/offers.h"
#include "drivers/source/osc/exposures.h"
#include "drivers/source/osc/reply.h"
#include "drivers/source/osc/settings.h"
#include "drivers/source/processing.h"
#include "include/source.h"

struct lp_osc_camera {
	const struct lp_osc_settings *settings;
	struct lp_osc_http *http;
	char object[300]; /* "osc: HOST", for messages */
	char model[64], firmware[32], serial[64];

	struct lp_offer_choice choice;
	bool exposure_settable;
	struct lp_osc_exposures range;
	struct lp_processing_report processing, processing_told; /* now; and as logged last */
	float exposure_us, gain; /* that were set last; NAN: unknown */
	int64_t changed_ns;	 /* when options were set last */

	/* What the camera with `saved_serial` was before it was changed; NULL: nothing was. */
	json_t *saved;
	char saved_serial[64];
};

/* Borrows both. */
void lp_osc_camera_init(struct lp_osc_camera *camera, const struct lp_osc_settings *settings,
			struct lp_osc_http *http);
void lp_osc_camera_finish(struct lp_osc_camera *camera);

/*
 * Ask the camera what it is, choose the preview, hold exposure and white balance, keep it awake.
 * A second has passed since the last change when it returns 0, as the live preview wants. -errno
 * with `*fault`; -ECANCELED: without.
 */
int lp_osc_camera_open(struct lp_osc_camera *camera, struct lp_osc_fault *fault);

/* Put back what was changed, as far as the camera answers within `left_ns`. */
void lp_osc_camera_restore(struct lp_osc_camera *camera, int64_t left_ns);

/* The body of a command that sets what lp_osc_exposures_snap() gave. NULL: out of memory; to be
 * freed. */
char *lp_osc_camera_exposure_body(const struct lp_osc_camera *camera, float exposure_us,
				  float gain);

/* Bring a camera whose screen shows something else back to shooting. 0; -errno with `*fault`. */
int lp_osc_camera_show_capture(struct lp_osc_camera *camera, struct lp_osc_fault *fault);

#endif
