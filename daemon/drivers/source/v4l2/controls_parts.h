/* SPDX-License-Identifier: Apache-2.0 */
/* The controls from the inside, for their two parts: controls.c (one control; exposure, gain and
 * white balance) and neutral.c (processing). */
#ifndef LP_SOURCE_V4L2_CONTROLS_PARTS_H
#define LP_SOURCE_V4L2_CONTROLS_PARTS_H

#include <linux/videodev2.h>
#include <stdbool.h>
#include <stdint.h>

#include "drivers/source/v4l2/controls.h"

/* Newer than the kernel headers of Debian 12. */
#define LP_V4L2_CID_HDR_SENSOR_MODE (V4L2_CID_CAMERA_CLASS_BASE + 36)

/*
 * In the order of holding: a mode is left before the values that it governs are written. They are
 * put back in the reverse order: values first, while they may still be written.
 */
enum lp_v4l2_control {
	SCENE_MODE,
	WIDE_DYNAMIC_RANGE,
	HDR_SENSOR_MODE,
	COLOUR_EFFECT,
	STABILIZATION,
	BACKLIGHT,
	AUTO_BRIGHTNESS,
	BRIGHTNESS,
	AUTO_HUE,
	HUE,
	CONTRAST,
	SATURATION,
	GAMMA,
	SHARPNESS,
	AUTO_EXPOSURE,
	AUTO_EXPOSURE_PRIORITY,
	EXPOSURE,
	AUTO_GAIN,
	GAIN,
	AUTO_WHITE_BALANCE,
	PRESET_WHITE_BALANCE,
	WHITE_BALANCE,
	LOCK,
	POWER_LINE,
};
_Static_assert(POWER_LINE + 1 == LP_V4L2_CONTROLS, "a place for each");

/* For messages; static. */
const char *lp_v4l2_control_name(enum lp_v4l2_control which);

/* 0; -ENOENT: the camera has none; or why it does not say. Not logged. */
int lp_v4l2_control_query(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			  struct v4l2_queryctrl *found);
int lp_v4l2_control_get(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			int64_t *value);

/* Write a control; what it was is put back at the end. -errno: not logged. */
int lp_v4l2_control_change(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			   int64_t value);

/* neutral.c: switch the camera's processing off, into controls->processing. `keep`: leave it, but
 * for a white balance that adapts. */
void lp_v4l2_neutralize(struct lp_v4l2_controls *controls, bool keep);

#endif
