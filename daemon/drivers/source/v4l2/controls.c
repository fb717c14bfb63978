/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/controls.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <stdio.h>
#include <sys/ioctl.h>

#include "base/log.h"

#define EXPOSURE_UNIT_US 100.0

/*
 * In the order of holding: an automatic mode is switched off before the value that it governs is
 * written. They are put back in the reverse order: values first, while they may still be written.
 */
enum control {
	AUTO_EXPOSURE,
	AUTO_EXPOSURE_PRIORITY,
	EXPOSURE,
	AUTO_GAIN,
	GAIN,
	AUTO_WHITE_BALANCE,
	WHITE_BALANCE,
	BACKLIGHT,
	POWER_LINE,
};

static const struct {
	uint32_t id;
	const char *name;
} table[LP_V4L2_CONTROLS] = {
	[AUTO_EXPOSURE] = {V4L2_CID_EXPOSURE_AUTO, "auto exposure"},
	[AUTO_EXPOSURE_PRIORITY] = {V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure priority"},
	[EXPOSURE] = {V4L2_CID_EXPOSURE_ABSOLUTE, "exposure"},
	[AUTO_GAIN] = {V4L2_CID_AUTOGAIN, "auto gain"},
	[GAIN] = {V4L2_CID_GAIN, "gain"},
	[AUTO_WHITE_BALANCE] = {V4L2_CID_AUTO_WHITE_BALANCE, "auto white balance"},
	[WHITE_BALANCE] = {V4L2_CID_WHITE_BALANCE_TEMPERATURE, "white balance"},
	[BACKLIGHT] = {V4L2_CID_BACKLIGHT_COMPENSATION, "backlight compensation"},
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

/* 0, or -ENOENT: the camera has none; -EACCES: it cannot be written. */
static int query(int fd, enum control which, struct lp_v4l2_range *range)
{
	struct v4l2_queryctrl found = {.id = table[which].id};

	if (ioctl(fd, VIDIOC_QUERYCTRL, &found) < 0)
		return errno == EINVAL || errno == ENOTTY ? -ENOENT : -errno;
	if (found.flags & V4L2_CTRL_FLAG_DISABLED)
		return -ENOENT;
	*range = (struct lp_v4l2_range){found.minimum, found.maximum, found.step};
	return found.flags & V4L2_CTRL_FLAG_READ_ONLY ? -EACCES : 0;
}

static int get(int fd, enum control which, int64_t *value)
{
	struct v4l2_control control = {.id = table[which].id};

	if (ioctl(fd, VIDIOC_G_CTRL, &control) < 0)
		return -errno;
	*value = control.value;
	return 0;
}

static int set(int fd, enum control which, int64_t value)
{
	struct v4l2_control control = {.id = table[which].id, .value = (int32_t)value};

	return ioctl(fd, VIDIOC_S_CTRL, &control) < 0 ? -errno : 0;
}

static int save(struct lp_v4l2_controls *controls, int fd, enum control which)
{
	int ret;

	if (controls->list[which].held)
		return 0;
	ret = get(fd, which, &controls->list[which].before);
	controls->list[which].held = ret == 0;
	return ret;
}

/* Save a control and write it. 0; -ENOENT: there is none; else logged. */
static int hold(struct lp_v4l2_controls *controls, int fd, enum control which, int64_t value)
{
	struct lp_v4l2_range range;
	int ret = query(fd, which, &range);

	if (ret == 0)
		ret = save(controls, fd, which);
	if (ret == 0)
		ret = set(fd, which, value);
	if (ret < 0 && ret != -ENOENT)
		lp_warning(controls->object, table[which].name, "cannot be set to %lld: %s",
			   (long long)value, lp_strerror(ret));
	return ret;
}

/* Hold the value that a control has now: its automatic mode has just been switched off. */
static int hold_present(struct lp_v4l2_controls *controls, int fd, enum control which)
{
	int64_t value = 0;
	const int ret = get(fd, which, &value);

	return ret < 0 ? ret : hold(controls, fd, which, value);
}

/* ---------------------------------------------------------------- exposure and gain */

/* Not just this control: the whole camera does not answer. */
static bool is_gone(int ret)
{
	return ret == -ENODEV || ret == -ETIMEDOUT || ret == -EPROTO;
}

/* Is there an automatic exposure, and does it govern? */
static bool is_automatic(int fd)
{
	int64_t mode = V4L2_EXPOSURE_MANUAL;

	return get(fd, AUTO_EXPOSURE, &mode) == 0 && mode != V4L2_EXPOSURE_MANUAL &&
	       mode != V4L2_EXPOSURE_SHUTTER_PRIORITY;
}

static void read_back(struct lp_v4l2_controls *controls, int fd)
{
	int64_t value = 0;

	controls->exposure_us = NAN;
	controls->linear_gain = NAN;
	if (!is_automatic(fd) && get(fd, EXPOSURE, &value) == 0)
		controls->exposure_us = (float)((double)value * EXPOSURE_UNIT_US);
	if (!controls->gain_settable)
		controls->linear_gain = 1; /* whatever it is, it does not change */
	else if (get(fd, GAIN, &value) == 0)
		controls->linear_gain = controls->gain_unity > 0
						? (float)value / controls->gain_unity
						: 1; /* held at its minimum */
}

/* What stands in the way of a settable exposure, in words; NULL: nothing does. */
static const char *exposure_obstacle(struct lp_v4l2_controls *controls, int fd)
{
	struct lp_v4l2_range range;
	int ret = hold(controls, fd, AUTO_EXPOSURE, V4L2_EXPOSURE_MANUAL);

	if (ret < 0 && ret != -ENOENT && is_automatic(fd)) /* some only know shutter priority */
		ret = hold(controls, fd, AUTO_EXPOSURE, V4L2_EXPOSURE_SHUTTER_PRIORITY);
	if (ret < 0 && is_automatic(fd))
		return "its automatic exposure cannot be switched off";
	ret = query(fd, EXPOSURE, &range);
	if (ret == -ENOENT)
		return "it has no exposure control";
	if (ret == -EACCES)
		return "its exposure is read-only";
	controls->exposure = range;
	return NULL;
}

static int hold_exposure(struct lp_v4l2_controls *controls, int fd)
{
	const char *const obstacle = exposure_obstacle(controls, fd);
	int ret;

	(void)hold(controls, fd, AUTO_EXPOSURE_PRIORITY, 0); /* the frame rate stays */
	if (obstacle) {
		lp_warning(controls->object, "exposure",
			   "%s: no brackets, and light levels are relative to each frame%s",
			   obstacle,
			   is_automatic(fd) ? "; estimates are flagged EXPOSURE_UNKNOWN" : "");
		return 0;
	}
	ret = hold_present(controls, fd, EXPOSURE);
	controls->exposure_settable = ret == 0;
	return is_gone(ret) ? ret : 0;
}

static int hold_gain(struct lp_v4l2_controls *controls, int fd)
{
	int64_t value = 0;
	int ret;

	(void)hold(controls, fd, AUTO_GAIN, 0);
	ret = query(fd, GAIN, &controls->gain);
	controls->gain_settable = ret == 0;
	if (ret < 0)
		return is_gone(ret) ? ret : 0;
	value = controls->gain_unity > 0 ? lp_v4l2_to_control(controls->gain_unity, &controls->gain)
					 : controls->gain.minimum;
	ret = hold(controls, fd, GAIN, value);
	return is_gone(ret) ? ret : 0;
}

/* ---------------------------------------------------------------- everything */

static int hold_white_balance(struct lp_v4l2_controls *controls, int fd, float white_balance_k)
{
	struct lp_v4l2_range range = {0};
	int ret = hold(controls, fd, AUTO_WHITE_BALANCE, 0);

	if (ret < 0 && ret != -ENOENT)
		return is_gone(ret) ? ret : 0;
	if (query(fd, WHITE_BALANCE, &range) < 0)
		return 0;
	ret = white_balance_k > 0 ? hold(controls, fd, WHITE_BALANCE,
					 lp_v4l2_to_control((double)white_balance_k, &range))
				  : hold_present(controls, fd, WHITE_BALANCE);
	return is_gone(ret) ? ret : 0;
}

static int hold_power_line(struct lp_v4l2_controls *controls, int fd, int power_line)
{
	static const int values[] = {
		[LP_V4L2_POWER_LINE_OFF] = V4L2_CID_POWER_LINE_FREQUENCY_DISABLED,
		[LP_V4L2_50HZ] = V4L2_CID_POWER_LINE_FREQUENCY_50HZ,
		[LP_V4L2_60HZ] = V4L2_CID_POWER_LINE_FREQUENCY_60HZ,
	};
	int ret;

	if (power_line == LP_V4L2_POWER_LINE_KEEP)
		return 0;
	ret = hold(controls, fd, POWER_LINE, values[power_line]);
	return is_gone(ret) ? ret : 0;
}

int lp_v4l2_controls_hold(struct lp_v4l2_controls *controls, int fd, const char *object,
			  const struct lp_v4l2_settings *settings)
{
	int ret = 0;

	*controls = (struct lp_v4l2_controls){.exposure_us = NAN,
					      .linear_gain = NAN,
					      .gain_unity = settings->gain_unity};
	snprintf(controls->object, sizeof(controls->object), "%s", object);
	if (settings->exposure == LP_V4L2_EXPOSURE_UNKNOWN)
		return 0;
	if (settings->exposure == LP_V4L2_EXPOSURE_SETTABLE) {
		ret = hold_exposure(controls, fd);
		if (ret == 0)
			ret = hold_gain(controls, fd);
		if (ret == 0)
			read_back(controls, fd);
	}
	if (ret == 0)
		ret = hold_white_balance(controls, fd, settings->white_balance_k);
	if (ret == 0)
		ret = hold_power_line(controls, fd, settings->power_line);
	if (ret == 0)
		(void)hold(controls, fd, BACKLIGHT, 0);
	return ret;
}

int lp_v4l2_controls_set_exposure(struct lp_v4l2_controls *controls, int fd, float exposure_us,
				  float gain)
{
	const int64_t exposure =
		lp_v4l2_to_control((double)exposure_us / EXPOSURE_UNIT_US, &controls->exposure);
	int ret = set(fd, EXPOSURE, exposure);

	if (ret == 0 && controls->gain_settable && controls->gain_unity > 0)
		ret = set(fd, GAIN,
			  lp_v4l2_to_control((double)(gain * controls->gain_unity),
					     &controls->gain));
	if (ret < 0)
		lp_error(controls->object, "exposure", "%.0f us, gain %g: %s", (double)exposure_us,
			 (double)gain, lp_strerror(ret));
	read_back(controls, fd);
	return ret;
}

void lp_v4l2_controls_restore(struct lp_v4l2_controls *controls, int fd)
{
	for (int i = LP_V4L2_CONTROLS - 1; i >= 0; i--) {
		int ret;

		if (!controls->list[i].held)
			continue;
		controls->list[i].held = false;
		ret = set(fd, i, controls->list[i].before);
		if (ret < 0 && ret != -ENODEV)
			lp_warning(controls->object, table[i].name,
				   "cannot be put back to %lld: %s",
				   (long long)controls->list[i].before, lp_strerror(ret));
	}
}
