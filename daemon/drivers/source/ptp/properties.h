/* SPDX-License-Identifier: Apache-2.0 */
/* A THETA's properties (RICOH's THETA USB API v2): read, set, remembered and put back. The thread
 * of the source. */
#ifndef LP_SOURCE_PTP_PROPERTIES_H
#define LP_SOURCE_PTP_PROPERTIES_H

#include "drivers/source/ptp/camera.h"

enum lp_ptp_property {
	LP_PTP_WHITE_BALANCE = 0x5005,
	LP_PTP_PROGRAM = 0x500E,
	LP_PTP_ISO = 0x500F,
	LP_PTP_CAPTURE_DELAY = 0x5012,
	LP_PTP_STILL_CAPTURE_MODE = 0x5013,
	LP_PTP_SHUTTER_SPEED = 0xD00F,
	LP_PTP_SLEEP_DELAY = 0xD803,
	LP_PTP_CAPTURE_STATUS = 0xD808,
	LP_PTP_BRACKET = 0xD812,
	LP_PTP_COLOR_TEMPERATURE = 0xD813,
	LP_PTP_AUTO_POWER_OFF_DELAY_S = 0xD81B,
	LP_PTP_TOP_BOTTOM_CORRECTION = 0xD825,
	LP_PTP_IMAGE_FORMAT = 0xD827,
	LP_PTP_IMAGE_STITCHING = 0xD834,
};

#define LP_PTP_MODE_SINGLE 0x0001
#define LP_PTP_MODE_BRACKET 0x8004
#define LP_PTP_MODE_LIVE 0x8005
#define LP_PTP_PROGRAM_MANUAL 0x0001
#define LP_PTP_WHITE_BALANCE_KELVINS 0x8007

/* What a property shall be. */
struct lp_ptp_wish {
	uint16_t property;
	uint8_t bytes;
	bool is_optional; /* a camera that has not got it, or refuses, does as well */
	uint64_t value;
	const char *name;
};

/* A number of up to 8 bytes. 0; -errno with `*fault`. */
int lp_ptp_get_number(struct lp_ptp_camera *camera, uint16_t property, uint64_t *value,
		      struct lp_ptp_fault *fault);

/* Set a property, and remember what it was before it was first set. 0; -errno with `*fault`. */
int lp_ptp_set(struct lp_ptp_camera *camera, const struct lp_ptp_wish *wish, const uint8_t *value,
	       size_t size_bytes, struct lp_ptp_fault *fault);
int lp_ptp_set_number(struct lp_ptp_camera *camera, const struct lp_ptp_wish *wish,
		      struct lp_ptp_fault *fault);

/* Waits for a camera that is busy. 0, also when the camera refuses: logged; -errno. */
int lp_ptp_put_back(struct lp_ptp_camera *camera, const struct lp_ptp_saved *saved);

#endif
