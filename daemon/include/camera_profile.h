/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera file (docs/users/camera_files.md) says to the driver of the camera. */
#ifndef LP_CAMERA_PROFILE_H
#define LP_CAMERA_PROFILE_H

#include "base/param.h"
#include "base/usb_id.h"

struct lp_ini;

struct lp_camera_profile {
	struct lp_size size_px;	   /* 0x0: the file does not say */
	struct lp_usb_id usb;	   /* as `match = usb:VENDOR:PRODUCT` says */
	const struct lp_ini *file; /* the section with a back end's scheme as its name is its own */
};

#endif
