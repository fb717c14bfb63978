/* SPDX-License-Identifier: Apache-2.0 */
/* Stills of a THETA, a set every so often, taken and read by a thread of their own. */
#ifndef LP_SOURCE_PTP_STILLS_H
#define LP_SOURCE_PTP_STILLS_H

struct lp_ptp_settings;
struct lp_ptp_stills;
struct lp_source;

/* Logged: -ENOMEM. */
int lp_ptp_stills_create(const struct lp_ptp_settings *settings, struct lp_ptp_stills **stills);

/* Loop thread. From now on the host of `source` is called. 0 or -errno, logged. */
int lp_ptp_stills_start(struct lp_ptp_stills *stills, struct lp_source *source);

/* Loop thread. Take a set now; if one is under way, one after it. */
void lp_ptp_stills_take(struct lp_ptp_stills *stills);

/* Accepts NULL. Puts the camera's options back. */
void lp_ptp_stills_destroy(struct lp_ptp_stills *stills);

#endif
