/* SPDX-License-Identifier: Apache-2.0 */
/* Several exposures of one scene into one radiance. */
#ifndef LP_VISION_MERGE_H
#define LP_VISION_MERGE_H

#ifdef __cplusplus
extern "C" {
#endif

struct lp_cells;
struct lp_response;

#define LP_MERGE_MAX 8 /* exposures */

/*
 * Mean of the exposures' radiance by inverse variance (Robertson, Borman & Stevenson 2003, eq. 7,
 * with noise of one code), saturated cells left out. A cell saturated in all of them keeps the
 * largest lower bound and is marked clipped. All exposures have the size of the first; `merged` is
 * resized to it.
 */
int lp_merge(const struct lp_cells *const *exposures, int count, const struct lp_response *response,
	     struct lp_cells *merged);

#ifdef __cplusplus
}
#endif

#endif
