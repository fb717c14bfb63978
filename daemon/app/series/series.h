/* SPDX-License-Identifier: Apache-2.0 */
/*
 * --series: a schedule of exposures, and the raw frames that follow each of them, into a folder.
 * What calibration is made of (docs/users/camera_calibration.md); nothing is estimated, nothing is
 * published.
 */
#ifndef LP_APP_SERIES_SERIES_H
#define LP_APP_SERIES_SERIES_H

struct lp_options;

/* Runs until the schedule is done, the source ends, or something is in the way. enum lp_exit. */
int lp_series_run(const struct lp_options *options);

#endif
