/* SPDX-License-Identifier: Apache-2.0 */
/* The state that a source has reported last: what is news is logged, once, and handed on. */
#ifndef LP_SOURCE_REPORT_H
#define LP_SOURCE_REPORT_H

#include <stdbool.h>

#include "include/source.h"

#define LP_SOURCE_REASON_BYTES 512

/* Zeroed at first: nothing has been reported. */
struct lp_source_report {
	enum lp_source_state last_state;
	char last_reason[LP_SOURCE_REASON_BYTES]; /* "object: stage: reason", as the host gets it */
};

/*
 * Note a state. True: it is news, another state or another reason; it has been logged (DOWN as an
 * error, WAITING and STALLED as a warning), and last_reason is to be handed to the host.
 */
bool lp_source_report_state(struct lp_source_report *report, enum lp_source_state state,
			    const char *object, const char *stage, const char *reason);

#endif
