/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a THETA does to its pictures, switched off as far as RICOH publishes options for it: the
 * image filters (noise reduction, compensation of dynamic range, HDR) and the correction that turns
 * pictures upright. Sharpening, noise reduction and the curve of the live preview have none.
 */
#include <errno.h>
#include <string.h>

#include "base/macros.h"
#include "drivers/source/osc/camera_parts.h"

static const struct option {
	const char *name, *neutral;
	bool for_stills; /* the camera knows it in the mode for stills alone */
} table[] = {
	{"_filter", "off", true},
	{"_topBottomCorrection", "Disapply", false},
};

static enum lp_processing kind_of(const struct option *option, const char *value)
{
	if (strcmp(option->name, "_filter") != 0)
		return LP_PROCESSING_STABILIZATION;
	return strcmp(value, "Noise Reduction") == 0 ? LP_PROCESSING_NOISE_REDUCTION
						     : LP_PROCESSING_DYNAMIC_RANGE;
}

/* The camera answers, and does not do it; else it does not answer. */
static bool is_refusal(int ret)
{
	return ret == -ENOENT || ret == -EINVAL || ret == -EPERM || ret == -ENOSYS ||
	       ret == -EPROTO || ret == -EIO;
}

/* Its value into `text`; "": there is no such option, or it is no text that could be meant. */
static int get(struct lp_osc_camera *camera, const char *name, char *text, size_t size_bytes,
	       struct lp_osc_fault *fault)
{
	const char *const names[] = {name, NULL};
	json_t *options = NULL;
	const int ret = lp_osc_get_options(camera, names, &options, fault);
	const char *const value = json_string_value(json_object_get(options, name));

	(void)snprintf(text, size_bytes, "%s", value && strlen(value) < size_bytes ? value : "");
	json_decref(options);
	return is_refusal(ret) ? 0 : ret;
}

/* Write the neutral value, and see what the camera makes of it. */
static int change(struct lp_osc_camera *camera, const struct option *option, const char *before,
		  struct lp_osc_fault *fault)
{
	struct lp_processing_report *report = &camera->processing;
	json_t *former = json_pack("{s:s}", option->name, before);
	char now[32] = "";
	int ret = lp_osc_set_options(camera, json_pack("{s:s}", option->name, option->neutral),
				     fault);

	if (ret == 0) {
		lp_osc_remember(camera, former);
		ret = get(camera, option->name, now, sizeof(now), fault);
	}
	json_decref(former);
	if (ret == 0 && strcmp(now, option->neutral) == 0)
		lp_processing_off(report, "%s %s → %s", option->name, before, now);
	else if (ret == 0)
		lp_processing_on(report, kind_of(option, before), "%s %s (%s was written)",
				 option->name, now, option->neutral);
	else if (is_refusal(ret))
		lp_processing_on(report, kind_of(option, before), "%s %s (refused: %s)",
				 option->name, before, fault->reason);
	return is_refusal(ret) ? 0 : ret;
}

static int neutralize(struct lp_osc_camera *camera, const struct option *option,
		      struct lp_osc_fault *fault)
{
	char before[32];
	const int ret = get(camera, option->name, before, sizeof(before), fault);

	if (ret < 0 || !*before || strcmp(before, option->neutral) == 0)
		return ret;
	if (camera->settings->processing != LP_PROCESSING_KEEP)
		return change(camera, option, before, fault);
	lp_processing_on(&camera->processing, kind_of(option, before), "%s %s", option->name,
			 before);
	return 0;
}

int lp_osc_neutralize(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	int ret = 0;

	camera->processing = (struct lp_processing_report){0};
	for (size_t i = 0; i < LP_COUNT(table) && ret == 0; i++)
		if (!table[i].for_stills || camera->settings->mode == LP_OSC_IMAGE)
			ret = neutralize(camera, &table[i], fault);
	return ret;
}

bool lp_osc_has_filter(const struct lp_osc_camera *camera)
{
	return camera->processing.on & (LP_PROCESSING_BIT(LP_PROCESSING_NOISE_REDUCTION) |
					LP_PROCESSING_BIT(LP_PROCESSING_DYNAMIC_RANGE));
}

void lp_osc_look_at_white_balance(struct lp_osc_camera *camera, const json_t *options)
{
	const char *const value = json_string_value(json_object_get(options, "whiteBalance"));

	if (camera->settings->white_balance_k == 0 && value && strcmp(value, "auto") == 0)
		lp_processing_on(&camera->processing, LP_PROCESSING_WHITE_BALANCE,
				 "whiteBalance auto (white_balance_k=0)");
}

void lp_osc_leave_out_processing(json_t *options)
{
	for (size_t i = 0; i < LP_COUNT(table); i++)
		(void)json_object_del(options, table[i].name);
}

int lp_osc_restore_processing(struct lp_osc_camera *camera, struct lp_osc_fault *fault)
{
	int first = 0;

	for (size_t i = 0; i < LP_COUNT(table); i++) {
		json_t *value = json_object_get(camera->saved, table[i].name);
		const int ret =
			value ? lp_osc_set_options(camera, json_pack("{s:O}", table[i].name, value),
						   first == 0 ? fault : &(struct lp_osc_fault){0})
			      : 0;

		first = first ? first : ret;
	}
	return first;
}
