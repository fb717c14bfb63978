/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ptp:[SERIAL] - a RICOH THETA on USB as a camera for stills: a set of exposures every so often.
 * Beside a live camera it adds what that one cannot expose for. This file is the back end as the
 * loop sees it; the camera is driven by a thread of its own, stills.c.
 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "base/uri.h"
#include "drivers/source/ptp/settings.h"
#include "drivers/source/ptp/stills.h"
#include "include/source.h"

struct source_ptp {
	struct lp_source base;
	struct lp_ptp_stills *stills;
};

static struct lp_ptp_stills *stills_of(const struct lp_source *source)
{
	return ((const struct source_ptp *)source)->stills;
}

static void ptp_destroy(struct lp_source *source)
{
	if (!source)
		return;
	lp_ptp_stills_destroy(stills_of(source));
	free(source);
}

const struct lp_source_ops lp_source_ptp_ops;

static int ptp_create(const struct lp_uri *uri, const struct lp_source_host *host,
		      struct lp_source **source)
{
	struct source_ptp *self = calloc(1, sizeof(*self));
	struct lp_ptp_settings settings;
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_source){.ops = &lp_source_ptp_ops, .host = *host};
	ret = lp_ptp_settings_read(uri, host->camera, &settings);
	if (ret == 0)
		ret = lp_ptp_stills_create(&settings, &self->stills);
	if (ret < 0) {
		free(self);
		return ret;
	}
	*source = &self->base;
	return 0;
}

static int ptp_start(struct lp_source *source)
{
	return lp_ptp_stills_start(stills_of(source), source);
}

static void ptp_caps(const struct lp_source *source, struct lp_source_caps *caps)
{
	(void)source;
	*caps = (struct lp_source_caps){.reports_exposure = true,
					.exposure_min_us = NAN,
					.exposure_max_us = NAN,
					.gain_min = NAN,
					.gain_max = NAN,
					.exposure_delay_frames = -1};
}

static void ptp_take_stills(struct lp_source *source)
{
	lp_ptp_stills_take(stills_of(source));
}

const struct lp_source_ops lp_source_ptp_ops = {
	.info = {.scheme = "ptp",
		 .form = "[SERIAL]",
		 .help = "stills of a RICOH THETA on USB, a set of exposures every so often\n"
			 "THETA X, Z1 or V, not in its live streaming mode. The keys may also be "
			 "in "
			 "the camera file,\n"
			 "section [ptp].",
		 .params = &lp_ptp_params},
	.create = ptp_create,
	.start = ptp_start,
	.caps = ptp_caps,
	.take_stills = ptp_take_stills,
	.destroy = ptp_destroy,
};
