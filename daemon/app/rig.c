/* SPDX-License-Identifier: Apache-2.0 */
#include "app/rig.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#include "base/log.h"
#include "vision/camera/camera_file.h"

#define NEXT_STEP                                                                             \
	"name the files of one rig, or run lightprobe calibrate rig with all of its cameras " \
	"(docs/users/camera_calibration.md)"

static int compare(const struct lp_camera_file *first, const struct lp_camera_file *file)
{
	const struct lp_rig_fields *rig = &first->rig, *own = &file->rig;

	if (strcmp(rig->id, own->id) == 0 && (!*rig->id || rig->camera != own->camera))
		return 0;
	if (strcmp(rig->id, own->id) == 0)
		lp_error(file->ini.path, "rig", "camera %d of rig %s, as is %s — " NEXT_STEP,
			 own->camera, own->id, first->ini.path);
	else if (*rig->id && *own->id)
		lp_error(file->ini.path, "rig",
			 "of rig %s, but %s is of rig %s: their rotations do not belong together "
			 "— " NEXT_STEP,
			 own->id, first->ini.path, rig->id);
	else
		lp_error(*own->id ? first->ini.path : file->ini.path, "rig",
			 "has no [rig], but %s is of rig %s: how they are turned against each "
			 "other is not known — " NEXT_STEP,
			 *own->id ? file->ini.path : first->ini.path, *own->id ? own->id : rig->id);
	return -EINVAL;
}

int lp_rig_check(const struct lp_camera_file *const *files, int count)
{
	for (int k = 1; k < count; k++)
		for (int other = 0; other < k; other++)
			if (compare(files[other], files[k]) < 0)
				return -EINVAL;
	return 0;
}

float lp_rig_sigma_deg(const struct lp_camera_file *const *files, int count)
{
	float most = 0.0F;

	for (int k = 0; k < count && count > 1; k++)
		most = fmaxf(most, files[k]->rig.sigma_deg);
	return most;
}
