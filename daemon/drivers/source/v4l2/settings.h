/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How to drive a camera: from the query of the URI, else from section [v4l2] of the camera file
 * (the same names), else defaults. And which camera: the URI's path, else the camera file's
 * `match`.
 */
#ifndef LP_SOURCE_V4L2_SETTINGS_H
#define LP_SOURCE_V4L2_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/usb_id.h"
#include "drivers/source/offers.h"

struct lp_camera_profile;
struct lp_uri;

/* Text of a node's or camera's name. */
#define LP_V4L2_NAME_BYTES 192
#define LP_V4L2_PORT_BYTES 32

enum lp_v4l2_exposure_mode {
	LP_V4L2_EXPOSURE_SETTABLE, /* lock it; be told when that fails */
	LP_V4L2_EXPOSURE_AUTO,	   /* the camera decides, and does not say what */
	LP_V4L2_EXPOSURE_UNKNOWN,  /* what stands behind the node is not known (loop-back) */
};

enum lp_v4l2_power_line {
	LP_V4L2_POWER_LINE_KEEP,
	LP_V4L2_POWER_LINE_OFF,
	LP_V4L2_50HZ,
	LP_V4L2_60HZ
};

struct lp_v4l2_settings {
	struct lp_offer_wish wish;
	int exposure;		   /* enum lp_v4l2_exposure_mode */
	int exposure_delay_frames; /* -1: not known */
	float gain_unity;	   /* control value of linear gain 1; 0: gain is not used */
	float white_balance_k;	   /* 0: as the camera stands when it is opened */
	int power_line;		   /* enum lp_v4l2_power_line */
	int processing;		   /* enum lp_processing_wish */
	float stall_ms;		   /* silence that counts as a stall */
	bool reset;		   /* a camera that hangs may be reset through its USB port */
};

enum lp_v4l2_target_kind {
	LP_V4L2_ANY,	 /* the only camera there is */
	LP_V4L2_PATH,	 /* "/dev/video0", or a link to it */
	LP_V4L2_ID_NAME, /* "usb-Maker_Model_Serial-video-index0", as in /dev/v4l/by-id */
	LP_V4L2_USB,	 /* "1d6b:0102" or "1d6b:0102:SERIAL" */
	LP_V4L2_PORT,	 /* "port:1-1.2": whatever is plugged in there */
};

struct lp_v4l2_target {
	enum lp_v4l2_target_kind kind;
	char text[LP_V4L2_NAME_BYTES]; /* path or name, as it was written; names it in messages */
	struct lp_usb_id usb;
	char serial[64]; /* "": any */
	char port[LP_V4L2_PORT_BYTES];
};

/* Of the URI's query, and of section [v4l2] of the camera file. */
extern const struct lp_params lp_v4l2_params;

/* Reads a device's name as it stands in the URI. -EINVAL (not logged): neither of the above. */
int lp_v4l2_target_parse(const char *text, struct lp_v4l2_target *target);

/* Settings and target of a URI. `camera` NULL: no camera file. -EINVAL, -EBADMSG: logged, with the
 * place. */
int lp_v4l2_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			  struct lp_v4l2_settings *settings, struct lp_v4l2_target *target);

#endif
