/* SPDX-License-Identifier: Apache-2.0 */
#include "app/run/service.h"

#if WITH_SYSTEMD
#include <systemd/sd-daemon.h>

#include "base/clock.h"
#include "base/text.h"

void lp_service_ready(void)
{
	(void)sd_notify(0, "READY=1");
}

void lp_service_stopping(void)
{
	(void)sd_notify(0, "STOPPING=1");
}

void lp_service_status(const char *text)
{
	char line[256]; /* another line would be another message to systemd */

	lp_text_copy(line, sizeof(line), text);
	(void)sd_notifyf(0, "STATUS=%s", line);
}

int64_t lp_service_watchdog_ns(void)
{
	uint64_t period_us = 0;

	return sd_watchdog_enabled(0, &period_us) > 0 ? (int64_t)period_us * LP_NS_PER_US : 0;
}

void lp_service_watchdog_feed(void)
{
	(void)sd_notify(0, "WATCHDOG=1");
}

#else

void lp_service_ready(void)
{
}

void lp_service_stopping(void)
{
}

void lp_service_status(const char *text)
{
	(void)text;
}

int64_t lp_service_watchdog_ns(void)
{
	return 0;
}

void lp_service_watchdog_feed(void)
{
}

#endif
