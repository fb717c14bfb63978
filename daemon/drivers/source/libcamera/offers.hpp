/* SPDX-License-Identifier: Apache-2.0 */
/* What a camera of libcamera's offers, in the words of drivers/source/offers.h. */
#ifndef LP_SOURCE_LIBCAMERA_OFFERS_HPP
#define LP_SOURCE_LIBCAMERA_OFFERS_HPP

#include <libcamera/stream.h>

#include "drivers/source/libcamera/c.hpp"

namespace lp
{

/* libcamera's name of a format. */
libcamera::PixelFormat pixel_format(uint32_t fourcc);

void list_offers(const libcamera::StreamFormats &formats, struct lp_offers &offers);

} // namespace lp

#endif
