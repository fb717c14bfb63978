/* SPDX-License-Identifier: Apache-2.0 */
/*
 * v4l2:DEVICE - a camera through the kernel's video interface (UVC and others). This file is the
 * back end as the loop sees it; the camera is driven by a thread of its own, capture.c.
 */
#include <errno.h>
#include <stdlib.h>

#include "base/uri.h"
#include "drivers/source/v4l2/capture.h"
#include "drivers/source/v4l2/settings.h"
#include "include/source.h"

struct source_v4l2 {
	struct lp_source base;
	struct lp_v4l2_capture *capture;
};

static struct lp_v4l2_capture *capture_of(const struct lp_source *source)
{
	return ((const struct source_v4l2 *)source)->capture;
}

static void v4l2_destroy(struct lp_source *source)
{
	if (!source)
		return;
	lp_v4l2_capture_destroy(capture_of(source));
	free(source);
}

const struct lp_source_ops lp_source_v4l2_ops;

static int v4l2_create(const struct lp_uri *uri, const struct lp_source_host *host,
		       struct lp_source **source)
{
	struct source_v4l2 *self = calloc(1, sizeof(*self));
	struct lp_v4l2_settings settings;
	struct lp_v4l2_target target;
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_v4l2_ops, .host = *host};
	ret = lp_v4l2_settings_read(uri, host->camera, &settings, &target);
	if (ret == 0)
		ret = lp_v4l2_capture_create(&settings, &target, &self->capture);
	if (ret < 0)
		goto err_free;
	*source = &self->base;
	return 0;

err_free:
	free(self);
	return ret;
}

static int v4l2_start(struct lp_source *source)
{
	return lp_v4l2_capture_start(capture_of(source), source);
}

static void v4l2_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	lp_v4l2_capture_caps(capture_of(source), caps);
}

static int v4l2_set_exposure(struct lp_source *source, float exposure_us, float gain)
{
	return lp_v4l2_capture_set_exposure(capture_of(source), exposure_us, gain);
}

const struct lp_source_ops lp_source_v4l2_ops = {
	.info = {.scheme = "v4l2",
		 .form = "DEVICE",
		 .help = "a camera through the kernel's video interface\n"
			 "DEVICE is /dev/video0, VENDOR:PRODUCT[:SERIAL], or a name from "
			 "/dev/v4l/by-id; leave it out\n"
			 "for the camera that --camera matches, or for the only one. The keys may "
			 "also be in the\n"
			 "camera file, section [v4l2].",
		 .params = &lp_v4l2_params},
	.create = v4l2_create,
	.start = v4l2_start,
	.caps = v4l2_caps,
	.set_exposure = v4l2_set_exposure,
	.destroy = v4l2_destroy,
};
