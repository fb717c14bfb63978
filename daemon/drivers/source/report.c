/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/report.h"

#include <stdio.h>
#include <string.h>

#include "base/log.h"

static enum lp_log_level level_of(enum lp_source_state state)
{
	switch (state) {
	case LP_SOURCE_DOWN:
		return LP_LOG_ERROR;
	case LP_SOURCE_WAITING:
	case LP_SOURCE_STALLED:
		return LP_LOG_WARNING;
	case LP_SOURCE_STREAMING:
	case LP_SOURCE_ENDED:
		break;
	}
	return LP_LOG_INFO;
}

bool lp_source_report_state(struct lp_source_report *report, enum lp_source_state state,
			    const char *object, const char *stage, const char *reason)
{
	char text[LP_SOURCE_REASON_BYTES];

	(void)snprintf(text, sizeof(text), "%s: %s: %s", object, stage, reason);
	if (state == report->last_state && strcmp(text, report->last_reason) == 0)
		return false;
	report->last_state = state;
	memcpy(report->last_reason, text, sizeof(text));
	lp_log(level_of(state), object, stage, "%s", reason);
	return true;
}
