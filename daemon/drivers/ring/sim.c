/* SPDX-License-Identifier: Apache-2.0 */
/* sim:?lux=... — a ring that reads what it is told, and can misbehave. It sees no simulated scene:
 * for that, lightprobe simulate starts the whole box, to be named by mcu:. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "base/param.h"
#include "base/uri.h"
#include "include/ring.h"
#include "include/ring_sample.h"

extern const struct lp_ring_ops lp_ring_sim_ops;

struct keys {
	struct lp_floats lux;
	float rate_hz, sigma, silent_after_s;
	int dead;
};

struct ring_sim {
	struct lp_ring base;
	struct keys keys;
	struct lp_timer tick;
	int64_t t_start_ns;
	uint32_t sequence;
};

static const struct lp_param list[] = {
	{"lux", LP_PARAM_FLOATS, offsetof(struct keys, lux), .initial = "100", .max = 1e6,
	 .help = "readings of the sensors: one number for all, or nine"},
	{"rate_hz", LP_PARAM_FLOAT, offsetof(struct keys, rate_hz), .initial = "100", .min = 0.1,
	 .max = 1000, .help = "samples a second"},
	{"sigma", LP_PARAM_FLOAT, offsetof(struct keys, sigma), .initial = "0.03", .max = 10,
	 .help = "relative uncertainty reported with each reading"},
	{"dead", LP_PARAM_INT, offsetof(struct keys, dead), .initial = "0", .max = 511,
	 .help = "sensors that are open or shorted: a sum of 1, 2, 4, ... 256"},
	{"silent_after_s", LP_PARAM_FLOAT, offsetof(struct keys, silent_after_s), .initial = "1e9",
	 .max = 1e9, .help = "time after which no more samples come"},
};
static const struct lp_params params = LP_PARAMS(list);

static struct ring_sim *self_of(const struct lp_ring *ring)
{
	return (struct ring_sim *)ring;
}

static void on_tick(struct lp_timer *timer)
{
	struct ring_sim *self = LP_CONTAINER_OF(timer, struct ring_sim, tick);
	const struct lp_floats *lux = &self->keys.lux;
	const int64_t now_ns = lp_clock_ns();
	struct lp_ring_sample sample = {.t_ns = now_ns, .sequence = ++self->sequence};

	if ((double)(now_ns - self->t_start_ns) / 1e9 > (double)self->keys.silent_after_s)
		return;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] =
			self->keys.dead >> k & 1 ? NAN : lux->values[k % lux->count];
		sample.sigma_relative[k] = self->keys.sigma;
	}
	self->base.host.sample(self->base.host.context, &sample);
}

static int sim_start(struct lp_ring *ring)
{
	struct ring_sim *self = self_of(ring);

	self->t_start_ns = lp_clock_ns();
	lp_timer_set(&self->tick, 0, (int64_t)(1e9F / self->keys.rate_hz));
	return 0;
}

static void sim_destroy(struct lp_ring *ring)
{
	struct ring_sim *self = self_of(ring);

	if (!self)
		return;
	lp_timer_stop(&self->tick);
	free(self);
}

static int sim_create(const struct lp_uri *uri, const struct lp_ring_host *host,
		      struct lp_ring **ring)
{
	struct ring_sim *self = calloc(1, sizeof(*self));
	int ret;

	if (!self)
		return -ENOMEM;
	self->base = (struct lp_ring){.ops = &lp_ring_sim_ops, .host = *host};
	ret = lp_uri_read(uri, &params, &self->keys);
	if (ret == 0 && self->keys.lux.count != 1 && self->keys.lux.count != LP_RING_SENSORS) {
		lp_error(uri->text, "lux", "one value, or nine");
		ret = -EINVAL;
	}
	if (ret < 0) {
		sim_destroy(&self->base);
		return ret;
	}
	lp_timer_init(host->loop, &self->tick, on_tick);
	*ring = &self->base;
	return 0;
}

const struct lp_ring_ops lp_ring_sim_ops = {
	.info = {.scheme = "sim",
		 .form = "",
		 .help = "a simulated ring inside the daemon, for tests\n"
			 "It does not see a simulated scene: for that, use mcu: with the "
			 "simulator's box.",
		 .params = &params},
	.create = sim_create,
	.start = sim_start,
	.destroy = sim_destroy,
};
