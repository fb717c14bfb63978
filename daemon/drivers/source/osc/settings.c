/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/osc/settings.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/uri.h"
#include "drivers/source/processing.h"
#include "drivers/source/profile.h"
#include "include/camera_profile.h"

static const char *const modes[] = {"video", "image", NULL};
static const char *const exposures[] = {"auto", "settable", NULL};

static const struct lp_param list[] = {
	{"password_file", LP_PARAM_TEXT, offsetof(struct lp_osc_settings, password_file),
	 .initial = "", .max = sizeof(((struct lp_osc_settings *)NULL)->password_file),
	 .help = "file with USER:PASSWORD in its first line, for a camera in client mode;\n"
		 "only its owner may be able to read it"},
	{"size", LP_PARAM_SIZE, offsetof(struct lp_osc_settings, wish.size_px), .max = 16384,
	 .help = "none: the size in the camera file, otherwise the largest up to 1920x1080"},
	{"fps", LP_PARAM_FLOAT, offsetof(struct lp_osc_settings, wish.fps), .initial = "0",
	 .max = 1000, .help = "frames a second; 0: the highest up to 30"},
	{"mode", LP_PARAM_CHOICE, offsetof(struct lp_osc_settings, mode), .initial = "video",
	 .choices = modes,
	 .help = "the camera's mode while it streams; image: for models without manual\n"
		 "exposure of movies"},
	{"exposure", LP_PARAM_CHOICE, offsetof(struct lp_osc_settings, exposure_settable),
	 .initial = "settable", .choices = exposures,
	 .help = "settable: the daemon sets it; auto: the camera sets it, and does not report it"},
	{"exposure_delay_frames", LP_PARAM_INT,
	 offsetof(struct lp_osc_settings, exposure_delay_frames), .initial = "-1", .min = -1,
	 .max = 60, .help = "frames from a command to the first one that obeys; -1: unknown"},
	{"iso", LP_PARAM_INT, offsetof(struct lp_osc_settings, iso), .initial = "0", .max = 100000,
	 .help = "sensitivity that counts as gain 1; 0: the camera's lowest"},
	{"white_balance_k", LP_PARAM_INT, offsetof(struct lp_osc_settings, white_balance_k),
	 .initial = "6500", .max = 20000,
	 .help = "colour temperature to set, in kelvins, in steps of 100; 0: keep the present one"},
	{"processing", LP_PARAM_CHOICE, offsetof(struct lp_osc_settings, processing),
	 .initial = "neutral", .choices = lp_processing_wishes, .help = LP_PROCESSING_HELP},
	{"stall_ms", LP_PARAM_FLOAT, offsetof(struct lp_osc_settings, stall_ms), .initial = "2000",
	 .min = 100, .max = 60000,
	 .help = "time without a frame after which the live preview is started again"},
};
const struct lp_params lp_osc_params = LP_PARAMS(list);

static bool is_host(const char *text, size_t length)
{
	const bool bracketed = length > 2 && text[0] == '[' && text[length - 1] == ']';

	for (size_t i = 0; i < length; i++) {
		const unsigned char c = (unsigned char)text[i];

		if (!isalnum(c) && !strchr(bracketed ? ".:%-[]" : ".-_", c))
			return false;
	}
	return length > 0;
}

int lp_osc_address_parse(const char *text, struct lp_osc_settings *settings)
{
	const char *colon = *text == '[' ? strstr(text, "]:") : strrchr(text, ':');
	size_t length;
	char *end;

	if (colon && *colon == ']')
		colon++;
	length = colon ? (size_t)(colon - text) : strlen(text);
	settings->port = 80;
	if (colon) {
		const long port = strtol(colon + 1, &end, 10);

		if (!isdigit((unsigned char)colon[1]) || *end || port < 1 || port > 65535)
			return -EINVAL;
		settings->port = (int)port;
	}
	if (length >= sizeof(settings->host) || !is_host(text, length))
		return -EINVAL;
	(void)snprintf(settings->host, sizeof(settings->host), "%.*s", (int)length, text);
	return 0;
}

static int split_login(const char *path, char *line, struct lp_osc_login *login)
{
	char *colon;

	line[strcspn(line, "\r\n")] = '\0';
	colon = strchr(line, ':');
	if (!colon || colon == line || !colon[1] || (size_t)(colon - line) >= sizeof(login->user) ||
	    strlen(colon + 1) >= sizeof(login->password)) {
		lp_error(path, "password_file", "line 1: expected USER:PASSWORD");
		return -EBADMSG;
	}
	(void)snprintf(login->user, sizeof(login->user), "%.*s", (int)(colon - line), line);
	(void)snprintf(login->password, sizeof(login->password), "%s", colon + 1);
	return 0;
}

int lp_osc_login_read(const char *path, struct lp_osc_login *login)
{
	char line[sizeof(*login) + 4] = "";
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
	struct stat status = {0};
	int ret = fd < 0 || fstat(fd, &status) < 0 ? -errno : 0;

	if (ret < 0) {
		lp_error(path, "password_file", "%s", lp_strerror(ret));
	} else if (S_ISREG(status.st_mode) && (status.st_mode & (S_IRWXG | S_IRWXO))) {
		ret = -EACCES;
		lp_error(path, "password_file", "others than its owner may read it — chmod 600 %s",
			 path);
	} else if (read(fd, line, sizeof(line) - 1) < 0) {
		ret = -errno;
		lp_error(path, "password_file", "%s", lp_strerror(ret));
	} else {
		ret = split_login(path, line, login);
	}
	if (fd >= 0)
		close(fd);
	explicit_bzero(line, sizeof(line));
	return ret;
}

int lp_osc_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			 struct lp_osc_settings *settings)
{
	int ret;

	memset(settings, 0, sizeof(*settings));
	ret = lp_profile_read(uri, camera, &lp_osc_params, settings);
	if (ret < 0)
		return ret;
	if (camera && !settings->wish.size_px.width)
		settings->wish.size_px = camera->size_px;
	if (lp_osc_address_parse(uri->rest, settings) < 0) {
		lp_error(uri->text, "parse",
			 "'%s' is not the address of a camera — use osc:HOST or osc:HOST:PORT, as "
			 "osc:192.168.1.1; `lightprobe find --cameras` lists those that announce "
			 "themselves",
			 uri->rest);
		return -EINVAL;
	}
	return *settings->password_file
		       ? lp_osc_login_read(settings->password_file, &settings->login)
		       : 0;
}
