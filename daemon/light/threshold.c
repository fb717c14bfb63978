/* SPDX-License-Identifier: Apache-2.0 */
#include "light/threshold.h"

#include <math.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/select.h"

#define BINS 256

float lp_threshold_median(const struct lp_panorama *panorama, float *scratch)
{
	int count = 0;

	for (int i = 0; i < panorama->width * panorama->height; i++)
		if (panorama->cells[i][LP_LUMINANCE] > 0.0F)
			scratch[count++] = panorama->cells[i][LP_LUMINANCE];
	return count ? lp_select(scratch, count, count / 2) : 0.0F;
}

/* Cut between two bins that maximises the variance between the two classes. */
static int otsu_cut(const int histogram[BINS])
{
	double total = 0.0, weighted = 0.0, below = 0.0, below_weighted = 0.0, best = -1.0;
	int cut = 0;

	for (int b = 0; b < BINS; b++) {
		total += histogram[b];
		weighted += (double)b * histogram[b];
	}
	for (int b = 0; b < BINS - 1; b++) {
		below += histogram[b];
		below_weighted += (double)b * histogram[b];
		const double above = total - below;

		if (below == 0.0 || above == 0.0)
			continue;
		const double apart = below_weighted / below - (weighted - below_weighted) / above;
		const double between = below * above * apart * apart;

		if (between > best) {
			best = between;
			cut = b + 1;
		}
	}
	return cut;
}

float lp_threshold_otsu(const struct lp_panorama *panorama)
{
	const int count = panorama->width * panorama->height;
	int histogram[BINS] = {0};
	float low = INFINITY, high = 0.0F;

	for (int i = 0; i < count; i++) {
		const float v = panorama->cells[i][LP_LUMINANCE];

		if (v > 0.0F) {
			low = fminf(low, v);
			high = fmaxf(high, v);
		}
	}
	if (!(high > low))
		return high;
	const float step = log2f(high / low) / BINS;

	for (int i = 0; i < count; i++) {
		const float v = panorama->cells[i][LP_LUMINANCE];

		if (v > 0.0F) {
			const int bin = (int)(log2f(v / low) / step);

			histogram[bin < BINS ? bin : BINS - 1]++;
		}
	}
	return low * exp2f(step * otsu_cut(histogram));
}
