/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/profile.h"

#include "base/ini.h"
#include "base/param.h"
#include "base/uri.h"
#include "include/camera_profile.h"

int lp_profile_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
		    const struct lp_params *params, void *settings)
{
	int ret = 0;

	lp_param_defaults(params, settings);
	if (camera)
		ret = lp_ini_set(camera->file, uri->scheme, params, settings);
	return ret < 0 ? ret : lp_uri_set(uri, params, settings);
}
