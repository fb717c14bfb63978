/* SPDX-License-Identifier: Apache-2.0 */
#include "app/packets.h"

#include <stdlib.h>

#include "base/log.h"
#include "base/pool.h"
#include "include/packet.h"
#include "light/model.h"

#define VARIANTS (2 * 2 * (LP_MAX_SH_ORDER + 1) * (LP_MAX_LIGHTS + 1))

struct packet {
	struct lp_packet base;
	struct lp_pool *pool;
	uint32_t subscription; /* of an estimate: the number in it */
};

struct lp_packets {
	struct lp_pool *pool;
	struct packet *encoded[VARIANTS]; /* of the present estimate; NULL: not yet */
};

struct lp_packets *lp_packets_create(int most_held)
{
	struct lp_packets *self = calloc(1, sizeof(*self));

	if (!self)
		return NULL;
	self->pool = lp_pool_create(sizeof(struct packet), most_held + VARIANTS, NULL);
	if (!self->pool) {
		free(self);
		return NULL;
	}
	return self;
}

void lp_packets_destroy(struct lp_packets *packets)
{
	if (!packets)
		return;
	lp_packets_forget(packets);
	lp_pool_destroy(packets->pool);
	free(packets);
}

static void release_packet(struct lp_packet *packet)
{
	struct packet *self = (struct packet *)packet;

	lp_pool_give(self->pool, self);
}

/* NULL: out of memory (the pool is large enough by construction). */
static struct packet *take(struct lp_packets *packets)
{
	struct packet *packet = lp_pool_take(packets->pool);

	if (!packet) {
		lp_error("hub", "packet", "out of memory; a message is lost");
		return NULL;
	}
	packet->pool = packets->pool;
	packet->base.references = 1;
	packet->base.release = release_packet;
	return packet;
}

struct lp_packet *lp_packets_take(struct lp_packets *packets)
{
	struct packet *packet = take(packets);

	return packet ? &packet->base : NULL;
}

/* ---------------------------------------------------------------- estimates */

static int min_int(int a, int b)
{
	return a < b ? a : b;
}

/* The model for one client: the smallest under its tolerance, or the largest it allows. */
static struct lp_variant choose(const struct lp_light_estimate *estimate,
				const struct lp_demand *computed,
				const struct lp_subscription *wanted)
{
	struct lp_variant variant = {
		.total = wanted->total,
		.sh_order = min_int(wanted->sh_order, computed->sh_order),
		.lights = min_int(wanted->max_lights,
				  min_int(estimate->light_count, computed->max_lights)),
	};

	if (wanted->tolerance > 0)
		lp_model_choose(estimate, variant.sh_order, variant.lights, wanted->tolerance,
				&variant.sh_order, &variant.lights);
	return variant;
}

static int variant_index(bool raw, const struct lp_variant *variant)
{
	const int kind = 2 * raw + variant->total;

	return (kind * (LP_MAX_SH_ORDER + 1) + variant->sh_order) * (LP_MAX_LIGHTS + 1) +
	       variant->lights;
}

static struct packet *encode(struct lp_packets *packets, const struct lp_light_estimate *estimate,
			     const struct lp_variant *variant, const struct lp_stamp *stamp)
{
	struct packet *packet = take(packets);

	if (!packet)
		return NULL;
	packet->subscription = stamp->subscription;
	if (lp_encode_estimate(estimate, variant, stamp, &packet->base) == 0)
		return packet;
	lp_error("hub", "encode",
		 "an estimate contains a number that is not finite; it is not sent");
	lp_packet_drop(&packet->base);
	return NULL;
}

static void forget(struct packet **slot)
{
	if (*slot)
		lp_packet_drop(&(*slot)->base);
	*slot = NULL;
}

struct lp_packet *lp_packets_estimate(struct lp_packets *packets,
				      const struct lp_estimates *estimates,
				      const struct lp_demand *computed,
				      const struct lp_subscription *wanted,
				      const struct lp_stamp *stamp)
{
	const struct lp_light_estimate *estimate =
		wanted->raw ? &estimates->raw : &estimates->smoothed;
	const struct lp_variant variant = choose(estimate, computed, wanted);
	struct packet **slot = &packets->encoded[variant_index(wanted->raw, &variant)];

	if (!*slot || (*slot)->subscription != stamp->subscription) {
		forget(slot);
		*slot = encode(packets, estimate, &variant, stamp);
	}
	return *slot ? &(*slot)->base : NULL;
}

void lp_packets_forget(struct lp_packets *packets)
{
	for (int i = 0; i < VARIANTS; i++)
		forget(&packets->encoded[i]);
}
