/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/profile.h"

#include "base/ini.h"
#include "base/param.h"
#include "base/uri.h"
#include "include/camera_profile.h"

int lp_profile_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
		    const struct lp_profile_table *table)
{
	int ret = 0;

	lp_param_defaults(table->params, table->count, table->fields);
	if (camera)
		ret = lp_ini_set(camera->file, uri->scheme, table->params, table->count,
				 table->fields);
	for (int i = 0; i < uri->key_count && ret == 0; i++)
		ret = lp_param_set(table->params, table->count, table->fields, uri->text,
				   uri->keys[i].name, uri->keys[i].value);
	return ret;
}
