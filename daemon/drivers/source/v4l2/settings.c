/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/settings.h"

#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/uri.h"
#include "drivers/source/processing.h"
#include "drivers/source/profile.h"
#include "include/camera_profile.h"

static const char *const exposures[] = {"settable", "auto", "unknown", NULL};
static const char *const power_lines[] = {"keep", "off", "50", "60", NULL};

static const struct lp_param list[] = {
	{"format", LP_PARAM_CHOICE, offsetof(struct lp_v4l2_settings, wish.format),
	 .initial = "auto", .choices = lp_offer_formats,
	 .help = "auto: the offered format that is cheapest to read (mjpeg first)"},
	{"size", LP_PARAM_SIZE, offsetof(struct lp_v4l2_settings, wish.size_px), .max = 16384,
	 .help = "none: the size in the camera file, otherwise the largest up to 1920x1080"},
	{"fps", LP_PARAM_FLOAT, offsetof(struct lp_v4l2_settings, wish.fps), .initial = "0",
	 .max = 1000, .help = "frames a second; 0: the highest up to 30"},
	{"exposure", LP_PARAM_CHOICE, offsetof(struct lp_v4l2_settings, exposure),
	 .initial = "settable", .choices = exposures,
	 .help = "settable: the daemon sets it; auto: the camera sets it, and does not report it;\n"
		 "unknown: change no control, for loop-back devices"},
	{"exposure_delay_frames", LP_PARAM_INT,
	 offsetof(struct lp_v4l2_settings, exposure_delay_frames), .initial = "-1", .min = -1,
	 .max = 30, .help = "frames from a command to the first one that obeys; -1: unknown"},
	{"gain_unity", LP_PARAM_FLOAT, offsetof(struct lp_v4l2_settings, gain_unity),
	 .initial = "0", .max = 1e6,
	 .help = "value of the gain control that means a factor of 1; 0: the gain stays at its "
		 "minimum"},
	{"white_balance_k", LP_PARAM_FLOAT, offsetof(struct lp_v4l2_settings, white_balance_k),
	 .initial = "0", .max = 20000,
	 .help = "colour temperature to set, in kelvins; 0: keep the present one"},
	{"power_line", LP_PARAM_CHOICE, offsetof(struct lp_v4l2_settings, power_line),
	 .initial = "off", .choices = power_lines,
	 .help = "mains frequency in Hz for the camera's flicker filter; keep: do not change it"},
	{"processing", LP_PARAM_CHOICE, offsetof(struct lp_v4l2_settings, processing),
	 .initial = "neutral", .choices = lp_processing_wishes, .help = LP_PROCESSING_HELP},
	{"stall_ms", LP_PARAM_FLOAT, offsetof(struct lp_v4l2_settings, stall_ms), .initial = "1000",
	 .min = 100, .max = 60000,
	 .help = "time without a frame after which the stream is restarted; at least four frame "
		 "periods"},
	{"reset", LP_PARAM_BOOL, offsetof(struct lp_v4l2_settings, reset), .initial = "1",
	 .help = "1: reset a camera that hangs through its USB port"},
};
const struct lp_params lp_v4l2_params = LP_PARAMS(list);

/* False: not of the form vendor:product[:serial]. */
static bool parse_usb(const char *text, struct lp_v4l2_target *target)
{
	const size_t length = lp_usb_id_parse(text, &target->usb);

	if (!length || (text[length] && text[length] != ':'))
		return false;
	if (text[length])
		snprintf(target->serial, sizeof(target->serial), "%s", text + length + 1);
	target->kind = LP_V4L2_USB;
	return true;
}

/* False: not of the form port:BUS-PORT[.PORT...]. */
static bool parse_port(const char *text, struct lp_v4l2_target *target)
{
	const char *port = text + strlen("port:");

	if (strncmp(text, "port:", strlen("port:")) != 0 || !*port ||
	    port[strspn(port, "0123456789-.")] || strlen(port) >= sizeof(target->port))
		return false;
	snprintf(target->port, sizeof(target->port), "%s", port);
	target->kind = LP_V4L2_PORT;
	return true;
}

int lp_v4l2_target_parse(const char *text, struct lp_v4l2_target *target)
{
	*target = (struct lp_v4l2_target){.kind = LP_V4L2_ANY};
	if (strlen(text) >= sizeof(target->text))
		return -EINVAL;
	snprintf(target->text, sizeof(target->text), "%s", text);
	if (!*text || parse_port(text, target) || parse_usb(text, target))
		return 0;
	if (text[0] == '/')
		target->kind = LP_V4L2_PATH;
	else if (!strncmp(text, "usb-", 4))
		target->kind = LP_V4L2_ID_NAME;
	else
		return -EINVAL;
	return 0;
}

int lp_v4l2_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			  struct lp_v4l2_settings *settings, struct lp_v4l2_target *target)
{
	int ret;

	memset(settings, 0, sizeof(*settings));
	ret = lp_profile_read(uri, camera, &lp_v4l2_params, settings);
	if (ret < 0)
		return ret;
	if (camera && !settings->wish.size_px.width)
		settings->wish.size_px = camera->size_px;
	if (lp_v4l2_target_parse(uri->rest, target) < 0) {
		lp_error(uri->text, "parse",
			 "'%s' is not the name of a camera — use v4l2:/dev/video0, "
			 "v4l2:VENDOR:PRODUCT[:SERIAL], v4l2:port:1-1.2, or a name from "
			 "/dev/v4l/by-id",
			 uri->rest);
		return -EINVAL;
	}
	if (target->kind == LP_V4L2_ANY && camera && camera->usb.known)
		*target = (struct lp_v4l2_target){.kind = LP_V4L2_USB, .usb = camera->usb};
	return 0;
}
