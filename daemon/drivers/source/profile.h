/* SPDX-License-Identifier: Apache-2.0 */
/* A driver's settings: its section of the camera file, and the query of the URI. */
#ifndef LP_SOURCE_PROFILE_H
#define LP_SOURCE_PROFILE_H

#include <stddef.h>

struct lp_camera_profile;
struct lp_param;
struct lp_uri;

struct lp_profile_table {
	const struct lp_param *params;
	size_t count;
	void *fields;
};

/*
 * Defaults, then the section of the camera file that is named as the URI's scheme, then the query
 * of the URI into table->fields. `camera` NULL: no camera file. -EINVAL, -EBADMSG: logged, with the
 * place.
 */
int lp_profile_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
		    const struct lp_profile_table *table);

#endif
