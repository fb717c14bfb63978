/* SPDX-License-Identifier: Apache-2.0 */
/* mcu:CARRIER:DEVICE — the ring of LDRs on the microcontroller. */
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/param.h"
#include "base/uri.h"
#include "drivers/link/mcu.h"
#include "drivers/ring/ldr.h"
#include "include/ring.h"

extern const struct lp_ring_ops lp_ring_mcu_ops;

struct ring_mcu {
	struct lp_ring base;
	struct lp_mcu *mcu;
	struct lp_mcu_user user;
	struct lp_ldr_calibration calibration;
};

struct keys {
	struct lp_mcu_settings link;
	char calibration[1024];
};

static const struct lp_param list[] = {
	{"calibration", LP_PARAM_TEXT, offsetof(struct keys, calibration), .initial = "",
	 .max = 1024,
	 .help = "ring file, from lightprobe calibrate ring; none: exact only within a factor of "
		 "two"},
};
_Static_assert(offsetof(struct keys, link) == 0, "the connection's offsets hold");
static const struct lp_params params = {list, LP_COUNT(list), &lp_mcu_params};

static struct ring_mcu *self_of(const struct lp_ring *ring)
{
	return (struct ring_mcu *)ring;
}

static struct ring_mcu *self_of_user(struct lp_mcu_user *user)
{
	return LP_CONTAINER_OF(user, struct ring_mcu, user);
}

static void on_ring(struct lp_mcu_user *user, const struct lp_mcu_ring *ring)
{
	const struct ring_mcu *self = self_of_user(user);
	struct lp_ring_sample sample = {.t_ns = ring->t_ns,
					.sequence = ring->sequence,
					.common_sigma = self->calibration.drift_common_sigma};

	memcpy(sample.seat, self->calibration.seat, sizeof(sample.seat));

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const bool dead = ring->dead >> k & 1;
		const float share = (float)ring->levels[k] / LP_RING_FULL_SCALE;

		sample.illuminance_lux[k] =
			lp_ldr_lux(&self->calibration, k, share, &sample.sigma_relative[k]);
		lp_ldr_dynamics(&self->calibration, k, sample.illuminance_lux[k], &sample);
		if (dead)
			sample.illuminance_lux[k] = sample.sigma_relative[k] = NAN;
	}
	self->base.host.sample(self->base.host.context, &sample);
}

static void on_fault(struct lp_mcu_user *user, const char *id, const char *text)
{
	const struct lp_ring_host *host = &self_of_user(user)->base.host;

	host->fault(host->context, id, text);
}

/* ---------------------------------------------------------------- ops */

static int mcu_start(struct lp_ring *ring)
{
	lp_mcu_start(self_of(ring)->mcu);
	return 0;
}

static void mcu_destroy(struct lp_ring *ring)
{
	struct ring_mcu *self = self_of(ring);

	if (!self)
		return;
	lp_mcu_leave(self->mcu, &self->user);
	free(self);
}

static int mcu_create(const struct lp_uri *uri, const struct lp_ring_host *host,
		      struct lp_ring **ring)
{
	struct ring_mcu *self;
	struct keys keys;
	int ret = lp_uri_read(uri, &params, &keys);

	if (ret < 0)
		return ret;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_ring){.ops = &lp_ring_mcu_ops, .host = *host};
	self->user = (struct lp_mcu_user){.ring = on_ring, .fault = on_fault};
	lp_ldr_defaults(&self->calibration);
	if (*keys.calibration)
		ret = lp_ldr_read(&self->calibration, keys.calibration);
	else
		lp_info(uri->text, "calibration",
			"no calibration file: illuminance is only right within a factor of two — "
			"run lightprobe calibrate ring");
	if (ret == 0)
		ret = lp_mcu_join(host->connections, host->loop, uri, &keys.link, &self->user,
				  &self->mcu);
	if (ret < 0) {
		free(self);
		return ret;
	}
	*ring = &self->base;
	return 0;
}

const struct lp_ring_ops lp_ring_mcu_ops = {
	.info = {.scheme = "mcu",
		 .form = "CARRIER:DEVICE",
		 .help = "the ring on the microcontroller\n"
			 "The URI is like that of the wheel; if both name the same device, they "
			 "share one connection.",
		 .params = &params},
	.create = mcu_create,
	.start = mcu_start,
	.destroy = mcu_destroy,
};
