/* SPDX-License-Identifier: Apache-2.0 */
/* Which camera, and how: osc:HOST[:PORT] with its keys. */
#ifndef LP_SOURCE_OSC_SETTINGS_H
#define LP_SOURCE_OSC_SETTINGS_H

#include <stdbool.h>

#include "base/param.h"
#include "drivers/source/offers.h"
#include "drivers/source/osc/http.h"

struct lp_camera_profile;
struct lp_uri;

enum lp_osc_mode { LP_OSC_VIDEO, LP_OSC_IMAGE };

struct lp_osc_settings {
	char host[256]; /* as written; of IPv6 in brackets */
	int port;
	char password_file[256]; /* "": none */
	struct lp_osc_login login;
	struct lp_offer_wish wish;
	int mode;		   /* enum lp_osc_mode */
	int exposure_settable;	   /* 0: leave automatic exposure on */
	int exposure_delay_frames; /* -1: not known */
	int iso;		   /* 0: the lowest */
	int white_balance_k;	   /* 0: keep the present one */
	int processing;		   /* enum lp_processing_wish */
	float stall_ms;
};

extern const struct lp_params lp_osc_params;

/* -EINVAL, -EBADMSG, or why the password file cannot be read: logged. */
int lp_osc_settings_read(const struct lp_uri *uri, const struct lp_camera_profile *camera,
			 struct lp_osc_settings *settings);

/* HOST[:PORT]; 80 where none is given. -EINVAL. Not logged. */
int lp_osc_address_parse(const char *text, struct lp_osc_settings *settings);

/* The first line of a file: USER:PASSWORD. -errno, logged; -EACCES: others than its owner may read
 * it. */
int lp_osc_login_read(const char *path, struct lp_osc_login *login);

#endif
