/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The published recipe for lights in a 360 degree picture (Alhakamy & Tuceryan 2019, "CubeMap360";
 * 2020), on the small panorama: threshold at the histogram's median, or at a static value as
 * behind films, Gaussian blur, erode, dilate with a kernel three times the erosion's, contours
 * sorted by area, direction from the planar moments' centroid, mean colour. Kept as a mode to
 * compare with; its faults (no wrap at the seam, planar moments, area before light) are part of it.
 */
#ifndef LP_LIGHT_FIND_RESEARCH_H
#define LP_LIGHT_FIND_RESEARCH_H

struct lp_lamp_finder;
struct lp_panorama;

/* Lamps into finder->lamps, largest area first. threshold: radiance; 0: the median. scratch: two
 * planes of the grid. */
void lp_research_detect(struct lp_lamp_finder *finder, const struct lp_panorama *panorama,
			float threshold, float *scratch);

#endif
