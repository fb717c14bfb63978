/* SPDX-License-Identifier: Apache-2.0 */
/* A driver's settings: its section of the camera file, and the query of the URI. */
#ifndef LP_SOURCE_PROFILE_H
#define LP_SOURCE_PROFILE_H

struct lp_camera_profile;
struct lp_params;
struct lp_uri;

/*
 * Defaults, then the section of the camera file that is named as the URI's scheme, then the query
 * of the URI into `*settings`. `camera` NULL: no camera file. -EINVAL, -EBADMSG: logged, with the
 * place.
 */
int lp_profile_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
		    const struct lp_params *params, void *settings);

#endif
