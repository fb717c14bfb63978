/* SPDX-License-Identifier: Apache-2.0 */
#ifndef LP_LIGHT_SELECT_H
#define LP_LIGHT_SELECT_H

/* The value that would stand at `rank` (0-based) if `values` were sorted; reorders them. Hoare
 * 1961. */
static inline float lp_select(float *values, int count, int rank)
{
	int low = 0, high = count - 1;

	while (low < high) {
		const float pivot = values[(low + high) / 2];
		int i = low, j = high;

		while (i <= j) {
			while (values[i] < pivot)
				i++;
			while (values[j] > pivot)
				j--;
			if (i <= j) {
				const float swap = values[i];
				values[i++] = values[j];
				values[j--] = swap;
			}
		}
		if (rank <= j)
			high = j;
		else if (rank >= i)
			low = i;
		else
			break;
	}
	return values[rank];
}

#endif
