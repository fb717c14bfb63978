/* SPDX-License-Identifier: Apache-2.0 */
/* What systemd wants to hear from a Type=notify service. Does nothing outside of systemd, or built
 * without it (WITH_SYSTEMD=0). */
#ifndef LP_APP_RUN_SERVICE_H
#define LP_APP_RUN_SERVICE_H

#include <stdint.h>

void lp_service_ready(void);
void lp_service_stopping(void);

/* One line for `systemctl status`. */
void lp_service_status(const char *text);

/* How long the service may be silent before it is restarted; 0: nobody watches. */
int64_t lp_service_watchdog_ns(void);

/* All is well. */
void lp_service_watchdog_feed(void);

#endif
