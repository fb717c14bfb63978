/* SPDX-License-Identifier: Apache-2.0 */
/* What a V4L2 camera offers. */
#ifndef LP_SOURCE_V4L2_OFFERS_H
#define LP_SOURCE_V4L2_OFFERS_H

#include "drivers/source/offers.h"

/* Ask the driver. 0 or -errno of the first enumeration. */
int lp_v4l2_offers_read(int fd, struct lp_offers *offers);

#endif
