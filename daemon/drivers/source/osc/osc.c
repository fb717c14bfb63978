/* SPDX-License-Identifier: Apache-2.0 */
/*
 * osc:HOST - a camera on the network that follows Open Spherical Camera, as RICOH's THETA do: its
 * live preview is MJPEG over HTTP, its exposure is set by commands. This file is the back end as
 * the loop sees it; the camera is driven by a thread of its own, capture.c.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/uri.h"
#include "drivers/source/osc/capture.h"
#include "drivers/source/osc/settings.h"
#include "include/source.h"

struct source_osc {
	struct lp_source base;
	struct lp_osc_capture *capture;
};

static struct lp_osc_capture *capture_of(const struct lp_source *source)
{
	return ((const struct source_osc *)source)->capture;
}

static void osc_destroy(struct lp_source *source)
{
	if (!source)
		return;
	lp_osc_capture_destroy(capture_of(source));
	free(source);
}

const struct lp_source_ops lp_source_osc_ops;

static int osc_create(const struct lp_uri *uri, const struct lp_source_host *host,
		      struct lp_source **source)
{
	struct source_osc *self = calloc(1, sizeof(*self));
	struct lp_osc_settings settings;
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_osc_ops, .host = *host};
	ret = lp_osc_settings_read(uri, host->camera, &settings);
	if (ret == 0)
		ret = lp_osc_capture_create(&settings, &self->capture);
	explicit_bzero(&settings.login, sizeof(settings.login));
	if (ret < 0)
		goto err_free;
	*source = &self->base;
	return 0;

err_free:
	free(self);
	return ret;
}

static int osc_start(struct lp_source *source)
{
	return lp_osc_capture_start(capture_of(source), source);
}

static void osc_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	lp_osc_capture_caps(capture_of(source), caps);
}

static int osc_set_exposure(struct lp_source *source, float exposure_us, float gain)
{
	return lp_osc_capture_set_exposure(capture_of(source), exposure_us, gain);
}

const struct lp_source_ops lp_source_osc_ops = {
	.info = {.scheme = "osc",
		 .form = "HOST[:PORT]",
		 .help = "a 360° camera on the network, as RICOH's THETA (Open Spherical Camera)\n"
			 "HOST is its name or address; in its own Wi-Fi a THETA is 192.168.1.1. "
			 "The "
			 "keys may also be\n"
			 "in the camera file, section [osc].",
		 .params = &lp_osc_params},
	.create = osc_create,
	.start = osc_start,
	.caps = osc_caps,
	.set_exposure = osc_set_exposure,
	.destroy = osc_destroy,
};
