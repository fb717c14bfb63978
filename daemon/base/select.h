/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_BASE_SELECT_H
#define LP_BASE_SELECT_H

#include <stdbool.h>

/* Move what is below the pivot (or equal: `equal`) to the front of values[from .. to - 1]; returns
 * where that ends. Without a branch: which are is anything but predictable. */
static inline int lp_gather_below(float *values, int from, int to, float pivot, bool equal)
{
	int end = from;

	for (int i = from; i < to; i++) {
		const float value = values[i];

		values[i] = values[end];
		values[end] = value;
		end += (value < pivot) | (equal & (value == pivot));
	}
	return end;
}

/* The value that would stand at `rank` (0-based) if `values` were sorted; reorders them.
 * Quickselect (Hoare 1961), in three parts: many values may be equal. */
static inline float lp_select(float *values, int count, int rank)
{
	int low = 0, high = count;

	for (;;) {
		const float pivot = values[low + (high - low) / 2];
		const int below = lp_gather_below(values, low, high, pivot, false);

		if (rank < below) {
			high = below;
			continue;
		}
		low = lp_gather_below(values, below, high, pivot, true);
		if (rank < low || low == below) /* NAN is neither */
			return pivot;
	}
}

#endif
