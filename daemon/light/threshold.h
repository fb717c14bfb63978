/* SPDX-License-Identifier: Apache-2.0 */
/* Global thresholds of luminance. Cells without light do not count. */
#ifndef LP_LIGHT_THRESHOLD_H
#define LP_LIGHT_THRESHOLD_H

struct lp_panorama;

/* Median luminance of the cells (by cell, as the published recipe has it); scratch: one plane. */
float lp_threshold_median(const struct lp_panorama *panorama, float *scratch);

/* Otsu's threshold (1979) of log luminance, 256 bins between the extremes. */
float lp_threshold_otsu(const struct lp_panorama *panorama);

#endif
