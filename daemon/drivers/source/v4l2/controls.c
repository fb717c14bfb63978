/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/controls.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <stdio.h>
#include <sys/ioctl.h>

#include "base/log.h"
#include "drivers/source/v4l2/controls_parts.h"

#define EXPOSURE_UNIT_US 100.0

static const struct {
	uint32_t id;
	const char *name;
} table[LP_V4L2_CONTROLS] = {
	[SCENE_MODE] = {V4L2_CID_SCENE_MODE, "scene mode"},
	[WIDE_DYNAMIC_RANGE] = {V4L2_CID_WIDE_DYNAMIC_RANGE, "wide dynamic range"},
	[HDR_SENSOR_MODE] = {LP_V4L2_CID_HDR_SENSOR_MODE, "HDR sensor mode"},
	[COLOUR_EFFECT] = {V4L2_CID_COLORFX, "colour effect"},
	[STABILIZATION] = {V4L2_CID_IMAGE_STABILIZATION, "image stabilization"},
	[BACKLIGHT] = {V4L2_CID_BACKLIGHT_COMPENSATION, "backlight compensation"},
	[AUTO_BRIGHTNESS] = {V4L2_CID_AUTOBRIGHTNESS, "auto brightness"},
	[BRIGHTNESS] = {V4L2_CID_BRIGHTNESS, "brightness"},
	[AUTO_HUE] = {V4L2_CID_HUE_AUTO, "auto hue"},
	[HUE] = {V4L2_CID_HUE, "hue"},
	[CONTRAST] = {V4L2_CID_CONTRAST, "contrast"},
	[SATURATION] = {V4L2_CID_SATURATION, "saturation"},
	[GAMMA] = {V4L2_CID_GAMMA, "gamma"},
	[SHARPNESS] = {V4L2_CID_SHARPNESS, "sharpness"},
	[AUTO_EXPOSURE] = {V4L2_CID_EXPOSURE_AUTO, "auto exposure"},
	[AUTO_EXPOSURE_PRIORITY] = {V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure priority"},
	[EXPOSURE] = {V4L2_CID_EXPOSURE_ABSOLUTE, "exposure"},
	[AUTO_GAIN] = {V4L2_CID_AUTOGAIN, "auto gain"},
	[GAIN] = {V4L2_CID_GAIN, "gain"},
	[AUTO_WHITE_BALANCE] = {V4L2_CID_AUTO_WHITE_BALANCE, "auto white balance"},
	[PRESET_WHITE_BALANCE] = {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, "white balance preset"},
	[WHITE_BALANCE] = {V4L2_CID_WHITE_BALANCE_TEMPERATURE, "white balance"},
	[LOCK] = {V4L2_CID_3A_LOCK, "lock of automatic functions"},
	[POWER_LINE] = {V4L2_CID_POWER_LINE_FREQUENCY, "power-line frequency"},
};

int64_t lp_v4l2_to_control(double value, const struct lp_v4l2_range *range)
{
	const double step = range->step > 0 ? (double)range->step : 1;
	double steps;

	if (!(value > (double)range->minimum))
		return range->minimum;
	if (value >= (double)range->maximum)
		return range->maximum;
	steps = round((value - (double)range->minimum) / step);
	if ((double)range->minimum + steps * step > (double)range->maximum)
		steps--; /* the maximum need not be a whole step away */
	return range->minimum + (int64_t)(steps * step);
}

/* ---------------------------------------------------------------- one control */

/* Errors not of one control but of the whole camera. */
static bool is_gone(int ret)
{
	return ret == -ENODEV || ret == -ETIMEDOUT || ret == -EPROTO;
}

/* ioctl() as long as the camera answers: each call to one that hangs takes seconds. 0 or -errno. */
static int call(struct lp_v4l2_controls *controls, unsigned long request, void *argument)
{
	int ret;

	if (controls->gone < 0)
		return controls->gone;
	ret = ioctl(controls->fd, request, argument) < 0 ? -errno : 0;
	if (is_gone(ret))
		controls->gone = ret;
	return ret;
}

int lp_v4l2_control_query(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			  struct v4l2_queryctrl *found)
{
	int ret;

	*found = (struct v4l2_queryctrl){.id = table[which].id};
	ret = call(controls, VIDIOC_QUERYCTRL, found);
	if (ret < 0)
		return ret == -EINVAL || ret == -ENOTTY ? -ENOENT : ret;
	return found->flags & V4L2_CTRL_FLAG_DISABLED ? -ENOENT : 0;
}

/* 0, or -ENOENT: the camera has none; -EACCES: it cannot be written. */
static int query(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
		 struct lp_v4l2_range *range)
{
	struct v4l2_queryctrl found;
	const int ret = lp_v4l2_control_query(controls, which, &found);

	if (ret < 0)
		return ret;
	*range = (struct lp_v4l2_range){found.minimum, found.maximum, found.step};
	return found.flags & V4L2_CTRL_FLAG_READ_ONLY ? -EACCES : 0;
}

int lp_v4l2_control_get(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			int64_t *value)
{
	struct v4l2_control control = {.id = table[which].id};
	const int ret = call(controls, VIDIOC_G_CTRL, &control);

	if (ret == 0)
		*value = control.value;
	return ret;
}

static int set(struct lp_v4l2_controls *controls, enum lp_v4l2_control which, int64_t value)
{
	struct v4l2_control control = {.id = table[which].id, .value = (int32_t)value};

	return call(controls, VIDIOC_S_CTRL, &control);
}

static int save(struct lp_v4l2_controls *controls, enum lp_v4l2_control which)
{
	int ret;

	if (controls->list[which].held)
		return 0;
	ret = lp_v4l2_control_get(controls, which, &controls->list[which].before);
	controls->list[which].held = ret == 0;
	return ret;
}

int lp_v4l2_control_change(struct lp_v4l2_controls *controls, enum lp_v4l2_control which,
			   int64_t value)
{
	const bool was_held = controls->list[which].held;
	int ret = save(controls, which);

	if (ret < 0)
		return ret;
	ret = set(controls, which, value);
	if (ret < 0 && !was_held) /* it is as it was */
		controls->list[which].held = false;
	return ret;
}

const char *lp_v4l2_control_name(enum lp_v4l2_control which)
{
	return table[which].name;
}

/* Save a control and write it. 0; -ENOENT: there is none; else logged. */
static int hold(struct lp_v4l2_controls *controls, enum lp_v4l2_control which, int64_t value)
{
	struct lp_v4l2_range range;
	int ret = controls->gone;

	if (ret < 0)
		return ret; /* has been logged with the first control */
	ret = query(controls, which, &range);
	if (ret == 0)
		ret = lp_v4l2_control_change(controls, which, value);
	if (ret < 0 && ret != -ENOENT)
		lp_warning(controls->object, table[which].name, "cannot be set to %lld: %s",
			   (long long)value, lp_strerror(ret));
	return ret;
}

/* Hold the value that a control has now: its automatic mode has just been switched off. */
static int hold_present(struct lp_v4l2_controls *controls, enum lp_v4l2_control which)
{
	int64_t value = 0;
	const int ret = lp_v4l2_control_get(controls, which, &value);

	return ret < 0 ? ret : hold(controls, which, value);
}

/* ---------------------------------------------------------------- exposure and gain */

/* Is there an automatic exposure, and does it govern? */
static bool is_automatic(struct lp_v4l2_controls *controls)
{
	int64_t mode = V4L2_EXPOSURE_MANUAL;

	return lp_v4l2_control_get(controls, AUTO_EXPOSURE, &mode) == 0 &&
	       mode != V4L2_EXPOSURE_MANUAL && mode != V4L2_EXPOSURE_SHUTTER_PRIORITY;
}

static void read_back(struct lp_v4l2_controls *controls)
{
	int64_t value = 0;

	controls->exposure_us = NAN;
	controls->linear_gain = NAN;
	if (!is_automatic(controls) && lp_v4l2_control_get(controls, EXPOSURE, &value) == 0)
		controls->exposure_us = (float)((double)value * EXPOSURE_UNIT_US);
	if (!controls->gain_settable)
		controls->linear_gain = 1; /* whatever it is, it does not change */
	else if (lp_v4l2_control_get(controls, GAIN, &value) == 0)
		controls->linear_gain = controls->gain_unity > 0
						? (float)value / controls->gain_unity
						: 1; /* held at its minimum */
}

/* What stands in the way of a settable exposure, in words; NULL: nothing does. */
static const char *exposure_obstacle(struct lp_v4l2_controls *controls)
{
	int ret = hold(controls, AUTO_EXPOSURE, V4L2_EXPOSURE_MANUAL);

	/* Some only know shutter priority. */
	if (ret < 0 && ret != -ENOENT && is_automatic(controls))
		ret = hold(controls, AUTO_EXPOSURE, V4L2_EXPOSURE_SHUTTER_PRIORITY);
	if (ret < 0 && is_automatic(controls))
		return "its automatic exposure cannot be switched off";
	ret = query(controls, EXPOSURE, &controls->exposure);
	if (ret == -EACCES)
		return "its exposure is read-only";
	return ret < 0 ? "it has no exposure control" : NULL;
}

static void hold_exposure(struct lp_v4l2_controls *controls)
{
	const char *const obstacle = exposure_obstacle(controls);

	(void)hold(controls, AUTO_EXPOSURE_PRIORITY, 0); /* the frame rate stays */
	if (!obstacle)
		controls->exposure_settable = hold_present(controls, EXPOSURE) == 0;
	else if (controls->gone == 0)
		lp_warning(controls->object, "exposure",
			   "%s: no brackets, and light levels are relative to each frame%s",
			   obstacle,
			   is_automatic(controls) ? "; estimates are flagged EXPOSURE_UNKNOWN"
						  : "");
}

static void hold_gain(struct lp_v4l2_controls *controls)
{
	(void)hold(controls, AUTO_GAIN, 0);
	controls->gain_settable = query(controls, GAIN, &controls->gain) == 0;
	if (controls->gain_settable)
		(void)hold(controls, GAIN,
			   controls->gain_unity > 0
				   ? lp_v4l2_to_control(controls->gain_unity, &controls->gain)
				   : controls->gain.minimum);
}

/* ---------------------------------------------------------------- everything */

static void hold_white_balance(struct lp_v4l2_controls *controls, float white_balance_k)
{
	struct lp_v4l2_range range;

	if (controls->processing.on & LP_PROCESSING_BIT(LP_PROCESSING_WHITE_BALANCE) ||
	    query(controls, WHITE_BALANCE, &range) < 0)
		return; /* it still adapts, or there is none */
	if (white_balance_k > 0)
		(void)hold(controls, WHITE_BALANCE,
			   lp_v4l2_to_control((double)white_balance_k, &range));
	else
		(void)hold_present(controls, WHITE_BALANCE);
}

static void hold_power_line(struct lp_v4l2_controls *controls, int power_line)
{
	static const int values[] = {
		[LP_V4L2_POWER_LINE_OFF] = V4L2_CID_POWER_LINE_FREQUENCY_DISABLED,
		[LP_V4L2_50HZ] = V4L2_CID_POWER_LINE_FREQUENCY_50HZ,
		[LP_V4L2_60HZ] = V4L2_CID_POWER_LINE_FREQUENCY_60HZ,
	};

	if (power_line != LP_V4L2_POWER_LINE_KEEP)
		(void)hold(controls, POWER_LINE, values[power_line]);
}

int lp_v4l2_controls_hold(struct lp_v4l2_controls *controls, int fd, const char *object,
			  const struct lp_v4l2_settings *settings)
{
	*controls = (struct lp_v4l2_controls){.fd = fd,
					      .exposure_us = NAN,
					      .linear_gain = NAN,
					      .gain_unity = settings->gain_unity};
	snprintf(controls->object, sizeof(controls->object), "%s", object);
	if (settings->exposure == LP_V4L2_EXPOSURE_UNKNOWN)
		return 0;
	lp_v4l2_neutralize(controls, settings->processing == LP_PROCESSING_KEEP);
	if (settings->exposure == LP_V4L2_EXPOSURE_SETTABLE) {
		hold_exposure(controls);
		hold_gain(controls);
		read_back(controls);
	}
	hold_white_balance(controls, settings->white_balance_k);
	hold_power_line(controls, settings->power_line);
	return controls->gone;
}

int lp_v4l2_controls_set_exposure(struct lp_v4l2_controls *controls, float exposure_us, float gain)
{
	const int64_t exposure =
		lp_v4l2_to_control((double)exposure_us / EXPOSURE_UNIT_US, &controls->exposure);
	int ret = set(controls, EXPOSURE, exposure);

	if (ret == 0 && controls->gain_settable && controls->gain_unity > 0)
		ret = set(controls, GAIN,
			  lp_v4l2_to_control((double)(gain * controls->gain_unity),
					     &controls->gain));
	if (ret < 0)
		lp_error(controls->object, "exposure", "%.0f us, gain %g: %s", (double)exposure_us,
			 (double)gain, lp_strerror(ret));
	read_back(controls);
	return ret;
}

void lp_v4l2_controls_restore(struct lp_v4l2_controls *controls)
{
	int left = 0;

	for (int i = LP_V4L2_CONTROLS - 1; i >= 0; i--) {
		int ret;

		if (!controls->list[i].held)
			continue;
		controls->list[i].held = false;
		ret = set(controls, i, controls->list[i].before);
		left += ret < 0;
		if (ret < 0 && controls->gone == 0)
			lp_warning(controls->object, table[i].name,
				   "cannot be put back to %lld: %s",
				   (long long)controls->list[i].before, lp_strerror(ret));
	}
	if (left > 0 && controls->gone < 0 && controls->gone != -ENODEV)
		lp_warning(controls->object, "controls",
			   "the camera does not answer (%s): %d controls are not put back — replug "
			   "it",
			   lp_strerror(controls->gone), left);
}
