/* SPDX-License-Identifier: Apache-2.0 */
/* What a JPEG says of itself: Exif (CIPA DC-008), XMP, and Google's photo sphere metadata in it. */
#ifndef LP_SOURCE_PHOTO_H
#define LP_SOURCE_PHOTO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/crop.h"

/* NAN and 0: it does not say. */
struct lp_photo {
	float exposure_us;
	float f_number;
	int iso;
	int orientation;     /* 1 to 8; 1: as it is stored */
	struct lp_crop crop; /* of an equirectangular picture */
};

struct lp_photo lp_photo_read(const uint8_t *jpeg, size_t size_bytes);

#endif
