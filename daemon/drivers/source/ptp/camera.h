/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A RICOH THETA on USB: RICOH's THETA USB API v2 (github.com/ricohapi/theta-api-specs, folder
 * theta-usb-api). From its session to a multi-bracket with fixed exposures, and back to what it
 * was. The thread of the source.
 */
#ifndef LP_SOURCE_PTP_CAMERA_H
#define LP_SOURCE_PTP_CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "drivers/source/ptp/data.h"
#include "drivers/source/ptp/session.h"
#include "drivers/source/ptp/settings.h"

#define LP_PTP_OPTIONS 16
#define LP_PTP_OPTION_BYTES 1024

/* A property that was changed, as it was before. */
struct lp_ptp_saved {
	uint16_t property;
	size_t size_bytes;
	uint8_t value[LP_PTP_OPTION_BYTES];
};

struct lp_ptp_camera {
	const struct lp_ptp_settings *settings;
	struct lp_ptp_session session;
	char object[96]; /* "RICOH THETA X, SERIAL", for messages */
	struct lp_ptp_device device;
	enum lp_ptp_family family;
	uint64_t shutters[LP_PTP_MOST_EXPOSURES];
	float exposures_us[LP_PTP_MOST_EXPOSURES];
	int exposure_count, iso;
	bool has_session;

	/* What the camera with `saved_serial` was before it was changed, in the order of changes.
	 */
	struct lp_ptp_saved saved[LP_PTP_OPTIONS];
	int saved_count;
	char saved_serial[64];
};

/* Borrows the settings. */
void lp_ptp_camera_init(struct lp_ptp_camera *camera, const struct lp_ptp_settings *settings);

/*
 * Begin a session over an open port, borrowed until lp_ptp_camera_close(); look at the camera and
 * prepare a multi-bracket. `stop` ends waiting for events. -errno with `*fault`.
 */
int lp_ptp_camera_open(struct lp_ptp_camera *camera, struct lp_ptp_port *port, struct lp_stop *stop,
		       struct lp_ptp_fault *fault);

/* End the session. restore: put back what was changed, as far as the camera answers. */
void lp_ptp_camera_close(struct lp_ptp_camera *camera, bool restore);

/* Start a multi-bracket. -EAGAIN: the camera is busy. Else as lp_ptp_camera_open(). */
int lp_ptp_camera_shoot(struct lp_ptp_camera *camera, struct lp_ptp_fault *fault);

/* End a multi-bracket before its last still, as far as the camera can. */
void lp_ptp_camera_terminate(struct lp_ptp_camera *camera);

/* An object of the camera: 1: a JPEG; 0: something else. -EAGAIN and errors as above. */
int lp_ptp_camera_look(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_fault *fault);

/* Read an object whole. -EAGAIN: the camera is busy. */
int lp_ptp_camera_fetch(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_sink *sink,
			struct lp_ptp_fault *fault);

/* -EAGAIN: the camera is busy; what it refuses is logged, and 0. */
int lp_ptp_camera_delete(struct lp_ptp_camera *camera, uint32_t object, struct lp_ptp_fault *fault);

/* What an error of lp_ptp_event() means. Returns it. */
int lp_ptp_camera_fail(struct lp_ptp_camera *camera, int error, const char *stage,
		       struct lp_ptp_fault *fault);

#endif
