/* SPDX-License-Identifier: Apache-2.0 */
/* How to drive a camera of libcamera's: query of the URI, else [libcamera] of the camera file. */
#ifndef LP_SOURCE_LIBCAMERA_SETTINGS_H
#define LP_SOURCE_LIBCAMERA_SETTINGS_H

#include <stdbool.h>

#include "base/usb_id.h"
#include "drivers/source/offers.h"

struct lp_camera_profile;
struct lp_uri;

struct lp_libcamera_settings {
	char name[192];	      /* which camera: see lp_libcamera_is_meant(); "": the only one */
	struct lp_usb_id usb; /* of the camera file; means something where `name` is "" */
	struct lp_offer_wish wish;
	bool exposure_settable;	   /* false: leave automatic exposure on */
	int exposure_delay_frames; /* where frames do not tell theirs; -1: not known */
	struct lp_floats
		colour_gains; /* red, blue; none: automatic white balance is just stopped */
	int processing;	      /* enum lp_processing_wish */
	float stall_ms;	      /* silence that counts as a stall */
};

/* Of the URI's query, and of section [libcamera] of the camera file. */
extern const struct lp_params lp_libcamera_params;

/* `camera` NULL: no camera file. -EINVAL, -EBADMSG: logged, with the place. */
int lp_libcamera_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			       struct lp_libcamera_settings *settings);

/*
 * Is it the camera with this identity and model that the settings name? By its whole identity
 * ("/base/soc/i2c0mux/i2c@1/imx477@1a"), its model ("imx477"), or its VENDOR:PRODUCT on USB.
 */
bool lp_libcamera_is_meant(const struct lp_libcamera_settings *settings, const char *id,
			   const char *model);

#endif
