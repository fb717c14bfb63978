/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera answers, and what its errors mean. */
#ifndef LP_SOURCE_OSC_REPLY_H
#define LP_SOURCE_OSC_REPLY_H

#include <jansson.h>
#include <stdbool.h>

#include "drivers/source/osc/http.h"
#include "include/source.h"

/* How commands are written: shutter speeds as the cameras print them, not with 17 digits. */
#define LP_OSC_JSON (JSON_COMPACT | JSON_REAL_PRECISION(10))

/* Why a command did not succeed, for whoever reads the log. */
struct lp_osc_fault {
	enum lp_source_state state; /* DOWN: trying again soon is of no use */
	const char *stage;
	char reason[400]; /* with the next step */
};

/* What POST /osc/state says of its health. */
struct lp_osc_health {
	float battery; /* 0..1; NAN: it does not say */
	bool is_charging;
	float temperature_c; /* of its board; NAN: it does not say */
	char error[64];	     /* the first of its errors; "": none */
};

/* Fill in `*fault`; returns `error`. `stage`: static. */
__attribute__((format(printf, 5, 6))) int lp_osc_fail(struct lp_osc_fault *fault, int error,
						      enum lp_source_state state, const char *stage,
						      const char *format, ...);

/* Why a command did not get through. -ECANCELED is passed on, without a fault. */
int lp_osc_network_fault(int error, const char *stage, struct lp_osc_fault *fault);

/*
 * What a reply says. 0: `*json` (may be NULL) is its object, to be released. Else -errno with
 * `*fault`: -EAGAIN (the camera is busy), -EACCES (password), -EPERM (its state forbids it),
 * -ENOSYS and -ENOENT (command or option unknown), -EINVAL (value refused), -EPROTO (no JSON).
 * `has_login`: a password was given.
 */
int lp_osc_reply_check(const struct lp_osc_reply *reply, const char *stage, bool has_login,
		       json_t **json, struct lp_osc_fault *fault);

/* False: it is no answer of /osc/state. */
bool lp_osc_health_read(const struct lp_osc_reply *reply, struct lp_osc_health *health);

#endif
