/* SPDX-License-Identifier: Apache-2.0 */
/* The camera's processing, switched off as far as the kernel's standard controls reach. Noise
 * reduction and local tone mapping have none: only private controls of some drivers. */
#include <stdio.h>

#include "base/log.h"
#include "base/macros.h"
#include "drivers/source/v4l2/controls_parts.h"

/*
 * What is neutral. OFF: 0, or the value nearest to it: for modes "off", for strengths the least.
 * USUAL: the driver's default, for what is neutral in the middle of a range without a scale. So is
 * gamma: without a camera file codes are read as sRGB, which the maker's default is nearest to, and
 * with one they were measured at the default.
 */
enum rule { OFF, USUAL };

static const struct row {
	enum lp_v4l2_control which;
	enum lp_processing kind;
	enum rule rule;
} rows[] = {
	{SCENE_MODE, LP_PROCESSING_SCENE, OFF},
	{WIDE_DYNAMIC_RANGE, LP_PROCESSING_DYNAMIC_RANGE, OFF},
	{HDR_SENSOR_MODE, LP_PROCESSING_DYNAMIC_RANGE, OFF},
	{COLOUR_EFFECT, LP_PROCESSING_EFFECT, OFF},
	{STABILIZATION, LP_PROCESSING_STABILIZATION, OFF},
	{BACKLIGHT, LP_PROCESSING_BACKLIGHT, OFF},
	{AUTO_BRIGHTNESS, LP_PROCESSING_BRIGHTNESS, OFF},
	{BRIGHTNESS, LP_PROCESSING_BRIGHTNESS, USUAL},
	{AUTO_HUE, LP_PROCESSING_HUE, OFF},
	{HUE, LP_PROCESSING_HUE, USUAL},
	{CONTRAST, LP_PROCESSING_CONTRAST, USUAL},
	{SATURATION, LP_PROCESSING_SATURATION, USUAL},
	{GAMMA, LP_PROCESSING_GAMMA, USUAL},
	{SHARPNESS, LP_PROCESSING_SHARPNESS, OFF},
	{AUTO_WHITE_BALANCE, LP_PROCESSING_WHITE_BALANCE, OFF},
	{PRESET_WHITE_BALANCE, LP_PROCESSING_WHITE_BALANCE, OFF},
};

static int64_t neutral_value(const struct row *row, const struct v4l2_queryctrl *found)
{
	const struct lp_v4l2_range range = {found->minimum, found->maximum, found->step};

	return lp_v4l2_to_control(row->rule == OFF ? 0 : found->default_value, &range);
}

/* The last resort against a white balance that adapts. */
static bool lock_white_balance(struct lp_v4l2_controls *controls)
{
	int64_t before, now = 0;

	return lp_v4l2_control_get(controls, LOCK, &before) == 0 &&
	       lp_v4l2_control_change(controls, LOCK, before | V4L2_LOCK_WHITE_BALANCE) == 0 &&
	       lp_v4l2_control_get(controls, LOCK, &now) == 0 && now & V4L2_LOCK_WHITE_BALANCE;
}

static void tell_on(struct lp_v4l2_controls *controls, const struct row *row, int64_t value,
		    const char *why)
{
	struct lp_processing_report *report = &controls->processing;
	const char *const name = lp_v4l2_control_name(row->which);

	if (row->kind == LP_PROCESSING_WHITE_BALANCE && lock_white_balance(controls))
		lp_processing_off(report, "%s %lld (locked)", name, (long long)value);
	else
		lp_processing_on(report, row->kind, "%s %lld%s%s%s", name, (long long)value,
				 *why ? " (" : "", why, *why ? ")" : "");
}

/* Write the neutral value, and see what the camera makes of it. */
static void change(struct lp_v4l2_controls *controls, const struct row *row, int64_t before,
		   int64_t neutral)
{
	int ret = lp_v4l2_control_change(controls, row->which, neutral);
	int64_t now = before;
	char why[64] = "";

	if (ret == 0)
		ret = lp_v4l2_control_get(controls, row->which, &now);
	if (ret == 0 && now == neutral) {
		lp_processing_off(&controls->processing, "%s %lld → %lld",
				  lp_v4l2_control_name(row->which), (long long)before,
				  (long long)neutral);
		return;
	}
	if (ret < 0)
		(void)snprintf(why, sizeof(why), "refused: %s", lp_strerror(ret));
	else
		(void)snprintf(why, sizeof(why), "%lld was written", (long long)neutral);
	tell_on(controls, row, now, why);
}

static void neutralize(struct lp_v4l2_controls *controls, const struct row *row, bool keep)
{
	struct v4l2_queryctrl found;
	int64_t before, neutral;

	if (lp_v4l2_control_query(controls, row->which, &found) < 0 ||
	    lp_v4l2_control_get(controls, row->which, &before) < 0)
		return; /* there is none; or the camera does not answer, which the caller finds */
	neutral = neutral_value(row, &found);
	if (before == neutral)
		return;
	if (keep)
		tell_on(controls, row, before, "");
	else if (found.flags & V4L2_CTRL_FLAG_READ_ONLY)
		tell_on(controls, row, before, "read-only");
	else if (found.flags & V4L2_CTRL_FLAG_GRABBED)
		tell_on(controls, row, before, "held by another program");
	else
		change(controls, row, before, neutral);
}

void lp_v4l2_neutralize(struct lp_v4l2_controls *controls, bool keep)
{
	controls->tells_processing = true;
	for (size_t i = 0; i < LP_COUNT(rows); i++)
		neutralize(controls, &rows[i], keep && rows[i].kind != LP_PROCESSING_WHITE_BALANCE);
}
