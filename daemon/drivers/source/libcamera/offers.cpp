/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/offers.hpp"

#include <libcamera/formats.h>

namespace lp
{
namespace
{

void add(lp_offers &offers, const lp_offer &offer)
{
	if (offers.count < LP_MAX_OFFERS)
		offers.list[offers.count++] = offer;
}

void add_size(lp_offers &offers, uint32_t fourcc, const libcamera::Size &size)
{
	lp_offer offer{};

	offer.fourcc = fourcc;
	offer.width_px = size.width;
	offer.height_px = size.height;
	add(offers, offer);
}

void add_range(lp_offers &offers, uint32_t fourcc, const libcamera::SizeRange &range)
{
	lp_offer offer{};

	offer.fourcc = fourcc;
	offer.width_px = range.max.width;
	offer.height_px = range.max.height;
	offer.least_width_px = range.min.width;
	offer.least_height_px = range.min.height;
	offer.step_width_px = range.hStep;
	offer.step_height_px = range.vStep;
	add(offers, offer);
}

uint32_t fourcc_of(libcamera::PixelFormat format)
{
	return format == libcamera::formats::R8 ? LP_FOURCC_GREY : format.fourcc();
}

} // namespace

libcamera::PixelFormat pixel_format(uint32_t fourcc)
{
	return fourcc == LP_FOURCC_GREY ? libcamera::formats::R8 : libcamera::PixelFormat(fourcc);
}

void list_offers(const libcamera::StreamFormats &formats, lp_offers &offers)
{
	offers.count = 0;
	for (const libcamera::PixelFormat &format : formats.pixelformats()) {
		const libcamera::SizeRange range = formats.range(format);
		const uint32_t fourcc = fourcc_of(format);

		/* Any size, besides the usual ones. Steps of 0: just what surrounds fixed ones. */
		if (range.hStep && range.vStep && range.min != range.max)
			add_range(offers, fourcc, range);
		for (const libcamera::Size &size : formats.sizes(format))
			add_size(offers, fourcc, size);
	}
}

} // namespace lp
