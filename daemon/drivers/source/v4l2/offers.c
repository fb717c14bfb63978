/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/offers.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>

static void add_rate(struct lp_offer *offer, const struct v4l2_fract *interval)
{
	if (offer->rate_count < LP_MAX_RATES && interval->numerator)
		offer->rates_hz[offer->rate_count++] =
			(float)interval->denominator / (float)interval->numerator;
}

static void read_rates(int fd, struct lp_offer *offer)
{
	struct v4l2_frmivalenum rate = {.pixel_format = offer->fourcc,
					.width = offer->width_px,
					.height = offer->height_px};

	for (; ioctl(fd, VIDIOC_ENUM_FRAMEINTERVALS, &rate) == 0; rate.index++) {
		if (rate.type == V4L2_FRMIVAL_TYPE_DISCRETE) {
			add_rate(offer, &rate.discrete);
			continue;
		}
		add_rate(offer, &rate.stepwise.min);
		add_rate(offer, &rate.stepwise.max);
		offer->rates_are_range = offer->rate_count == 2;
		break;
	}
}

static void add_offer(int fd, struct lp_offers *offers, const struct lp_offer *offer)
{
	struct lp_offer *added;

	if (offers->count == LP_MAX_OFFERS)
		return;
	added = &offers->list[offers->count++];
	*added = *offer;
	read_rates(fd, added);
}

/* Drivers that do not enumerate sizes work in the one that is set. */
static void add_present_size(int fd, struct lp_offers *offers, uint32_t fourcc)
{
	struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};

	if (ioctl(fd, VIDIOC_G_FMT, &format) < 0 || format.fmt.pix.pixelformat != fourcc)
		return;
	add_offer(fd, offers,
		  &(struct lp_offer){.fourcc = fourcc,
				     .width_px = format.fmt.pix.width,
				     .height_px = format.fmt.pix.height});
}

static void read_sizes(int fd, struct lp_offers *offers, uint32_t fourcc)
{
	struct v4l2_frmsizeenum size = {.pixel_format = fourcc};

	for (; ioctl(fd, VIDIOC_ENUM_FRAMESIZES, &size) == 0; size.index++) {
		struct lp_offer offer = {.fourcc = fourcc,
					 .width_px = size.discrete.width,
					 .height_px = size.discrete.height};

		if (size.type != V4L2_FRMSIZE_TYPE_DISCRETE)
			offer = (struct lp_offer){.fourcc = fourcc,
						  .width_px = size.stepwise.max_width,
						  .height_px = size.stepwise.max_height,
						  .least_width_px = size.stepwise.min_width,
						  .least_height_px = size.stepwise.min_height,
						  .step_width_px = size.stepwise.step_width,
						  .step_height_px = size.stepwise.step_height};
		add_offer(fd, offers, &offer);
		if (size.type != V4L2_FRMSIZE_TYPE_DISCRETE)
			return;
	}
	if (size.index == 0)
		add_present_size(fd, offers, fourcc);
}

int lp_v4l2_offers_read(int fd, struct lp_offers *offers)
{
	struct v4l2_fmtdesc format = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};

	offers->count = 0;
	for (; ioctl(fd, VIDIOC_ENUM_FMT, &format) == 0; format.index++)
		read_sizes(fd, offers, format.pixelformat);
	return format.index || errno == EINVAL ? 0 : -errno;
}
