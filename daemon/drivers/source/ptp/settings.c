/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/ptp/settings.h"

#include <ctype.h>
#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "base/uri.h"
#include "drivers/source/profile.h"

static const struct lp_param list[] = {
	{"every", LP_PARAM_FLOAT, offsetof(struct lp_ptp_settings, every_s), .initial = "60",
	 .max = 86400,
	 .help = "seconds from one set of stills to the next; 0: one at\n"
		 "first, then only when a client asks (lightprobe still)"},
	{"exposures", LP_PARAM_INT, offsetof(struct lp_ptp_settings, exposures), .initial = "3",
	 .min = LP_PTP_LEAST_EXPOSURES, .max = LP_PTP_MOST_EXPOSURES, .help = "stills in a set"},
	{"shortest_us", LP_PARAM_FLOAT, offsetof(struct lp_ptp_settings, shortest_us),
	 .initial = "0", .max = 6e7, .help = "their shortest exposure; 0: the camera's shortest"},
	{"stops", LP_PARAM_FLOAT, offsetof(struct lp_ptp_settings, stops), .initial = "3",
	 .min = 0.3, .max = 10, .help = "from one exposure to the next"},
	{"iso", LP_PARAM_INT, offsetof(struct lp_ptp_settings, iso), .initial = "0", .max = 100000,
	 .help = "sensitivity, which counts as gain 1; 0: the camera's lowest"},
	{"white_balance_k", LP_PARAM_INT, offsetof(struct lp_ptp_settings, white_balance_k),
	 .initial = "6500", .min = 2500, .max = 10000,
	 .help = "colour temperature to set, in kelvins, in steps of 100"},
	{"keep", LP_PARAM_BOOL, offsetof(struct lp_ptp_settings, keep), .initial = "0",
	 .help = "1: the stills stay in the camera, which fills; 0: they are deleted once read"},
};
const struct lp_params lp_ptp_params = LP_PARAMS(list);

static bool is_serial(const char *text)
{
	for (; *text; text++)
		if (!isalnum((unsigned char)*text))
			return false;
	return true;
}

int lp_ptp_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			 struct lp_ptp_settings *settings)
{
	int ret;

	memset(settings, 0, sizeof(*settings));
	ret = lp_profile_read(uri, camera, &lp_ptp_params, settings);
	if (ret < 0)
		return ret;
	if (strlen(uri->rest) >= sizeof(settings->serial) || !is_serial(uri->rest)) {
		lp_error(uri->text, "parse",
			 "'%s' is not a serial number — use ptp: for the only camera, or "
			 "ptp:SERIAL as lsusb -v shows it (iSerial)",
			 uri->rest);
		return -EINVAL;
	}
	(void)snprintf(settings->serial, sizeof(settings->serial), "%s", uri->rest);
	return 0;
}
