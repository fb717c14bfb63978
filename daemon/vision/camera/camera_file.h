/* SPDX-License-Identifier: Apache-2.0 */
/* A camera file as it is written (docs/users/camera_files.md): read once, for the picture's
 * geometry (lp_camera_create()) and for the driver (lp_camera_file_profile()). */
#ifndef LP_VISION_CAMERA_CAMERA_FILE_H
#define LP_VISION_CAMERA_CAMERA_FILE_H

#include <limits.h>

#include <stdbool.h>
#include <stdint.h>

#include "base/ini.h"
#include "base/param.h"
#include "base/usb_id.h"
#include "include/camera_profile.h"
#include "vision/camera/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A mirror ball before an ordinary camera, which [lens.0] describes. */
struct lp_ball_fields {
	struct lp_floats centre, distortion;
	float radius, rim_px, index, extinction;
	float outline_sigma_px, rotation_sigma_deg;
};

struct lp_lens_fields {
	bool present;
	float cx_px, cy_px, fx_px, fy_px, k1, k2, k3, k4, max_theta_deg;
	struct lp_floats rotation_wxyz, rolloff, distortion;
	char mask[PATH_MAX];
};

/* Where the picture lies within an equirectangular one of the whole sphere. */
struct lp_crop_fields {
	bool present;
	int full_width_px, full_height_px, left_px, top_px;
};

/* Of the rig that the camera is a part of; lightprobe calibrate rig writes it. */
struct lp_rig_fields {
	char id[24];	 /* "": of none */
	int camera;	 /* from 1 on */
	float sigma_deg; /* of its rotation against camera 1 */
};

/* Numbers are within their own bounds; what several of them say together is not checked yet. */
struct lp_camera_file {
	struct lp_ini ini; /* of no entries for "equirect" */
	int version;	   /* of the format */
	char name[64];
	struct lp_usb_id usb;
	int projection; /* enum lp_projection; -1: the file does not say */
	int width_px, height_px;
	float read_out_ms; /* from the reading of the first row to that of the last; NAN: not said
			    */
	char response[PATH_MAX];
	/* What the camera did to its pictures when the response was measured (processing.h). */
	bool tells_processing;
	uint32_t processing;	    /* LP_PROCESSING_BIT() of each */
	float cd_m2_per_unit;	    /* luminance of radiance 1; 0: not known */
	float cd_m2_per_unit_sigma; /* relative */
	/* Of the film on the wheel (light/film/polarization.h); 0: the file does not say */
	float film_transmission, film_extinction, film_offset_deg, film_index;
	struct lp_glare_shares glare; /* width_deg: of the usual lens, where the file says none */
	struct lp_crop_fields crop;
	char mask[PATH_MAX]; /* of an equirectangular picture */
	char stuck_pixels[PATH_MAX];
	struct lp_lens_fields lens[LP_MAX_LENSES];
	struct lp_ball_fields ball;
	struct lp_rig_fields rig;
};

/* "equirect", or the path of a camera file. -errno or -EBADMSG, logged as FILE:LINE. */
int lp_camera_file_read(const char *name_or_path, struct lp_camera_file **file);

void lp_camera_file_destroy(struct lp_camera_file *file); /* accepts NULL */

/* The driver's part; borrows from `file`. */
struct lp_camera_profile lp_camera_file_profile(const struct lp_camera_file *file);

#ifdef __cplusplus
}
#endif

#endif
