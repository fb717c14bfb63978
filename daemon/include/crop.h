/* SPDX-License-Identifier: Apache-2.0 */
/* Which part of the whole sphere an equirectangular picture shows. */
#ifndef LP_CROP_H
#define LP_CROP_H

#include <stdbool.h>

/* Fractions of the whole picture, 360° by 180°. It may reach across the seam: left + width > 1. */
struct lp_crop {
	float left, top, width,
		height; /* width 0: not stated; below 0: what is stated is unusable */
};

#define LP_CROP_WHOLE ((struct lp_crop){0.0F, 0.0F, 1.0F, 1.0F})
/* Another projection, or numbers that make no sense. */
#define LP_CROP_UNUSABLE ((struct lp_crop){0.0F, 0.0F, -1.0F, 0.0F})

static inline bool lp_crop_is_stated(const struct lp_crop *crop)
{
	return crop->width > 0.0F;
}

static inline bool lp_crop_is_unusable(const struct lp_crop *crop)
{
	return crop->width < 0.0F;
}

static inline bool lp_crop_is_whole(const struct lp_crop *crop)
{
	return crop->left == 0.0F && crop->width >= 1.0F && crop->height >= 1.0F;
}

static inline bool lp_crop_same(const struct lp_crop *a, const struct lp_crop *b)
{
	return a->left == b->left && a->top == b->top && a->width == b->width &&
	       a->height == b->height;
}

/* Of a picture of width x height at (left, top) of a whole one of full_width x full_height. */
static inline struct lp_crop lp_crop_of(double left, double top, double width, double height,
					double full_width, double full_height)
{
	const double most = 1.0 + 1e-6; /* rounding */

	if (!(full_width >= 1.0 && full_height >= 1.0 && width >= 1.0 && height >= 1.0 &&
	      left >= 0.0 && top >= 0.0 && left < full_width && width <= most * full_width &&
	      top + height <= most * full_height))
		return LP_CROP_UNUSABLE;
	return (struct lp_crop){(float)(left / full_width), (float)(top / full_height),
				(float)(width / full_width), (float)(height / full_height)};
}

#endif
