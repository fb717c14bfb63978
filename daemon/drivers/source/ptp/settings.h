/* SPDX-License-Identifier: Apache-2.0 */
/* Which camera, and which stills: ptp:[SERIAL] with its keys. */
#ifndef LP_SOURCE_PTP_SETTINGS_H
#define LP_SOURCE_PTP_SETTINGS_H

#include <stdbool.h>

#include "base/param.h"

#define LP_PTP_LEAST_EXPOSURES 2 /* of a multi-bracket (RICOH's USB API, 0xD812) */
#define LP_PTP_MOST_EXPOSURES 13

struct lp_camera_profile;
struct lp_uri;

struct lp_ptp_settings {
	char serial[32]; /* "": the only one there is */
	float every_s;	 /* from the start of one bracket to that of the next */
	int exposures;
	float shortest_us; /* 0: the camera's shortest */
	float stops;	   /* from one exposure to the next */
	int iso;	   /* 0: the lowest */
	int white_balance_k;
	bool keep; /* the pictures stay in the camera */
};

extern const struct lp_params lp_ptp_params;

/* -EINVAL, -EBADMSG: logged. */
int lp_ptp_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			 struct lp_ptp_settings *settings);

#endif
