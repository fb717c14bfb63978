/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/settings.h"

#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/uri.h"
#include "drivers/source/processing.h"
#include "drivers/source/profile.h"
#include "include/camera_profile.h"

static int parse_exposure(const char *text, void *field)
{
	bool *settable = field;

	*settable = !strcmp(text, "settable");
	return *settable || !strcmp(text, "auto") ? 0 : -EINVAL;
}

static const struct lp_param list[] = {
	{"format", LP_PARAM_CHOICE, offsetof(struct lp_libcamera_settings, wish.format),
	 .initial = "auto", .choices = lp_offer_formats,
	 .help = "auto: the offered format that is cheapest to read (mjpeg first)"},
	{"size", LP_PARAM_SIZE, offsetof(struct lp_libcamera_settings, wish.size_px), .max = 16384,
	 .help = "none: the size in the camera file, otherwise the largest up to 1920x1080"},
	{"fps", LP_PARAM_FLOAT, offsetof(struct lp_libcamera_settings, wish.fps), .initial = "0",
	 .max = 1000, .help = "frames a second; 0: the camera's own rate"},
	{"exposure", LP_PARAM_OWN, offsetof(struct lp_libcamera_settings, exposure_settable),
	 .initial = "settable", .parse = parse_exposure, .expects = "settable or auto",
	 .help = "settable: the daemon sets it; auto: the camera sets it"},
	{"exposure_delay_frames", LP_PARAM_INT,
	 offsetof(struct lp_libcamera_settings, exposure_delay_frames), .initial = "-1", .min = -1,
	 .max = 30,
	 .help = "frames from a command to the first one that obeys, for cameras whose frames do "
		 "not\n"
		 "report their exposure; -1: unknown"},
	{"colour_gains", LP_PARAM_FLOATS, offsetof(struct lp_libcamera_settings, colour_gains),
	 .min = 0.01, .max = 100,
	 .help = "RED,BLUE: white balance; none: the values at which automatic white balance "
		 "stops"},
	{"processing", LP_PARAM_CHOICE, offsetof(struct lp_libcamera_settings, processing),
	 .initial = "neutral", .choices = lp_processing_wishes, .help = LP_PROCESSING_HELP},
	{"stall_ms", LP_PARAM_FLOAT, offsetof(struct lp_libcamera_settings, stall_ms),
	 .initial = "1000", .min = 100, .max = 60000,
	 .help = "time without a frame after which the camera is opened again"},
};
const struct lp_params lp_libcamera_params = LP_PARAMS(list);

int lp_libcamera_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			       struct lp_libcamera_settings *settings)
{
	int ret;

	memset(settings, 0, sizeof(*settings));
	ret = lp_profile_read(uri, camera, &lp_libcamera_params, settings);
	if (ret < 0)
		return ret;
	if (settings->colour_gains.count != 0 && settings->colour_gains.count != 2) {
		lp_error(uri->text, "colour_gains", "two numbers are needed, RED,BLUE");
		return -EINVAL;
	}
	if (strlen(uri->rest) >= sizeof(settings->name)) {
		lp_error(uri->text, "parse", "the camera's name is too long");
		return -EINVAL;
	}
	snprintf(settings->name, sizeof(settings->name), "%s", uri->rest);
	if (!camera)
		return 0;
	settings->usb = camera->usb;
	if (!settings->wish.size_px.width)
		settings->wish.size_px = camera->size_px;
	return 0;
}

static bool ends_with(const char *text, const char *end)
{
	const size_t length = strlen(text), end_length = strlen(end);

	return length > end_length && text[length - end_length - 1] == '-' &&
	       !strcmp(text + length - end_length, end);
}

bool lp_libcamera_is_meant(const struct lp_libcamera_settings *settings, const char *id,
			   const char *model)
{
	char usb[16];

	if (*settings->name)
		return !strcmp(id, settings->name) || !strcmp(model, settings->name) ||
		       ends_with(id, settings->name);
	snprintf(usb, sizeof(usb), "%04x:%04x", settings->usb.vendor, settings->usb.product);
	return !settings->usb.known || ends_with(id, usb);
}
