/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/packets.h"

#include <math.h>
#include <stdlib.h>

#include "base/log.h"
#include "base/pool.h"
#include "include/packet.h"
#include "light/send/listing.h"
#include "light/send/model.h"
#include "serve/drawn/drawn_list.h"

/* Momentary estimates: AMBIENT or TOTAL, in the probe's or the app's frame, with KEY or without, by
 * order and lights. */
#define RAW_VARIANTS (8 * (LP_MAX_SH_ORDER + 1) * (LP_MAX_LIGHTS + 1))
/* Kinds of smoothed subscriptions whose list is remembered; one more takes the place of that asked
 * for longest ago, and its list begins anew. */
#define KINDS 16

struct packet {
	struct lp_packet base;
	struct lp_pool *pool;
	uint32_t subscription, quiet_ms; /* of an estimate: whom it is for */
	uint8_t data[LP_PACKET_MAX_BYTES];
};

struct picture {
	struct lp_packet base;
	struct lp_pool *pool;
	uint8_t data[LP_PACKET_LARGE_BYTES];
};

/* What all clients with the same wishes are sent. */
struct kind {
	bool used;
	struct lp_listing_limits limits;
	uint64_t asked;		    /* when, as a count */
	struct lp_drawn_wish drawn; /* likewise */
	struct lp_listing listing;
	struct lp_drawn_state drawn_state; /* in place of the listing, where drawn.on */
	struct lp_drawn_packet drawn_packet;
	bool listed; /* of the present estimate */
	struct lp_light_estimate estimate;
	struct lp_variant variant;
	/* of the present estimate: frame of the probe or the app; AMBIENT or TOTAL; without KEY or
	 * with; NULL: not yet */
	struct packet *encoded[2][2][2];
};

struct lp_packets {
	struct lp_pool *pool, *pictures;
	/* Of the present estimate, with reflections and without; NULL: not yet. */
	struct packet *raw[2][RAW_VARIANTS];
	struct lp_light_estimate others; /* workspace: the raw estimate without reflections */
	struct kind kinds[KINDS];
	uint64_t asked;
	struct lp_drawn_room *room;
};

struct lp_packets *lp_packets_create(int most_held, int most_pictures)
{
	struct lp_packets *self = calloc(1, sizeof(*self));

	if (!self)
		return NULL;
	self->pool = lp_pool_create(sizeof(struct packet), most_held + 2 * RAW_VARIANTS + 8 * KINDS,
				    NULL);
	self->pictures = lp_pool_create(sizeof(struct picture), most_pictures, NULL);
	self->room = lp_drawn_room_create();
	if (!self->pool || !self->pictures || !self->room) {
		lp_packets_destroy(self);
		return NULL;
	}
	return self;
}

void lp_packets_destroy(struct lp_packets *packets)
{
	if (!packets)
		return;
	if (packets->pool && packets->room)
		lp_packets_forget(packets);
	lp_pool_destroy(packets->pool);
	lp_pool_destroy(packets->pictures);
	lp_drawn_room_destroy(packets->room);
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
	packet->base = (struct lp_packet){.references = 1,
					  .release = release_packet,
					  .data = packet->data,
					  .capacity_bytes = sizeof(packet->data)};
	return packet;
}

struct lp_packet *lp_packets_take(struct lp_packets *packets)
{
	struct packet *packet = take(packets);

	return packet ? &packet->base : NULL;
}

static void release_picture(struct lp_packet *packet)
{
	struct picture *self = (struct picture *)packet;

	lp_pool_give(self->pool, self);
}

struct lp_packet *lp_packets_take_picture(struct lp_packets *packets)
{
	struct picture *picture = lp_pool_take(packets->pictures);

	if (!picture) {
		lp_error("hub", "packet", "out of memory; a picture is lost");
		return NULL;
	}
	picture->pool = packets->pictures;
	picture->base = (struct lp_packet){.references = 1,
					   .release = release_picture,
					   .data = picture->data,
					   .capacity_bytes = sizeof(picture->data)};
	return &picture->base;
}

/* ---------------------------------------------------------------- estimates */

static int min_int(int a, int b)
{
	return a < b ? a : b;
}

static struct lp_listing_limits limits_of(const struct lp_demand *computed,
					  const struct lp_subscription *wanted)
{
	return (struct lp_listing_limits){.sh_order = min_int(wanted->sh_order, computed->sh_order),
					  .lights =
						  min_int(wanted->max_lights, computed->max_lights),
					  .areas = wanted->area_lights,
					  .tolerance = wanted->has_draws
							       ? 1.0F /* a share of it */
							       : fmaxf(wanted->tolerance, 0.0F),
					  .leave_out_reflections = wanted->leave_out_reflections};
}

static struct lp_drawn_wish drawn_of(const struct lp_subscription *wanted)
{
	return (struct lp_drawn_wish){.on = wanted->has_draws,
				      .raw = wanted->raw,
				      .key_allowed = wanted->key_light,
				      .most_map = wanted->reflection.size,
				      .tolerance = wanted->draws};
}

/* The momentary model for one client: the smallest under its tolerance, or the largest it allows.
 */
static struct lp_variant choose_raw(const struct lp_light_estimate *estimate,
				    const struct lp_listing_limits *limits,
				    const struct lp_subscription *wanted)
{
	struct lp_variant variant = {.total = wanted->total, .key = wanted->key_light};

	lp_model_choose(estimate, limits->sh_order,
			limits->areas ? limits->lights
				      : min_int(limits->lights,
						estimate->light_count - estimate->area_count),
			limits->tolerance, &variant.sh_order, &variant.lights);
	return variant;
}

static int raw_index(const struct lp_variant *variant)
{
	const int which = 4 * variant->key + 2 * variant->world + variant->total;

	return (which * (LP_MAX_SH_ORDER + 1) + variant->sh_order) * (LP_MAX_LIGHTS + 1) +
	       variant->lights;
}

static bool same_limits(const struct lp_listing_limits *a, const struct lp_listing_limits *b)
{
	return a->sh_order == b->sh_order && a->lights == b->lights && a->areas == b->areas &&
	       a->tolerance == b->tolerance && a->leave_out_reflections == b->leave_out_reflections;
}

static void forget(struct packet **slot)
{
	if (*slot)
		lp_packet_drop(&(*slot)->base);
	*slot = NULL;
}

static void forget_kind(struct kind *kind)
{
	kind->listed = false;
	for (int k = 0; k < 8; k++)
		forget(&kind->encoded[k / 4][k / 2 % 2][k % 2]);
}

/* NULL: there is none yet. */
static struct kind *find_kind(struct lp_packets *packets, const struct lp_listing_limits *limits,
			      const struct lp_drawn_wish *drawn)
{
	for (int k = 0; k < KINDS; k++) {
		struct kind *kind = &packets->kinds[k];

		if (kind->used && same_limits(&kind->limits, limits) &&
		    lp_drawn_wishes_are_same(&kind->drawn, drawn))
			return kind;
	}
	return NULL;
}

static struct kind *kind_of(struct lp_packets *packets, const struct lp_listing_limits *limits,
			    const struct lp_drawn_wish *drawn)
{
	struct kind *kind = find_kind(packets, limits, drawn);
	struct kind *oldest = &packets->kinds[0];

	packets->asked++;
	if (kind) {
		kind->asked = packets->asked;
		return kind;
	}
	for (int k = 0; k < KINDS; k++)
		if (packets->kinds[k].asked < oldest->asked)
			oldest = &packets->kinds[k];
	forget_kind(oldest);
	*oldest = (struct kind){.used = true,
				.limits = *limits,
				.drawn = *drawn,
				.asked = packets->asked};
	return oldest;
}

/* The kind's list of the present estimate. */
static void list(struct kind *kind, const struct lp_light_estimate *smoothed,
		 const struct lp_subscription *wanted)
{
	if (!kind->listed)
		kind->variant.sh_order =
			lp_listing_update(&kind->listing, smoothed, &kind->limits, &kind->estimate);
	kind->listed = true;
	kind->variant.lights = kind->estimate.light_count;
	kind->variant.total = wanted->total;
	kind->variant.key = wanted->key_light;
}

/* Likewise, of what is drawn; `estimate`: smoothed or raw. */
static void list_drawn(struct lp_packets *packets, struct kind *kind,
		       const struct lp_light_estimate *estimate,
		       const struct lp_subscription *wanted)
{
	if (!kind->listed)
		lp_drawn_list(packets->room, estimate, &kind->drawn, &kind->limits,
			      &kind->drawn_state, &kind->estimate, &kind->drawn_packet);
	kind->listed = true;
	kind->variant = (struct lp_variant){.sh_order = kind->drawn_packet.sh_order,
					    .lights = kind->estimate.light_count,
					    .total = wanted->total,
					    .key = kind->drawn_packet.key,
					    .has_drawn = true,
					    .drawn = kind->drawn_packet.stated};
}

/* Of an estimate whose orientation is known to the app's world. */
static void turn_to_world(struct lp_light_estimate *estimate)
{
	const struct lp_estimate_orientation *o = &estimate->orientation;
	const struct lp_rotation rotation = lp_rotation_of_quaternion(
		(const double[]){o->xyzw[0], o->xyzw[1], o->xyzw[2], o->xyzw[3]});

	lp_model_turn(estimate, &rotation, o->sigma_deg);
}

static struct packet *encode(struct lp_packets *packets, const struct lp_light_estimate *estimate,
			     const struct lp_variant *variant, const struct lp_stamp *stamp)
{
	struct packet *packet = take(packets);

	if (!packet)
		return NULL;
	packet->subscription = stamp->subscription;
	packet->quiet_ms = stamp->quiet_ms;
	struct lp_light_estimate turned;

	if (variant->world) {
		turned = *estimate;
		turn_to_world(&turned);
		estimate = &turned;
	}
	if (lp_encode_estimate(estimate, variant, stamp, &packet->base) == 0)
		return packet;
	lp_packet_drop(&packet->base);
	return NULL;
}

struct lp_choice lp_packets_choose(struct lp_packets *packets, const struct lp_estimates *estimates,
				   const struct lp_demand *computed,
				   const struct lp_subscription *wanted)
{
	struct lp_choice choice = {.all = wanted->raw ? &estimates->raw : &estimates->smoothed,
				   .limits = limits_of(computed, wanted),
				   .map_size = wanted->reflection.size};
	const struct lp_drawn_wish drawn = drawn_of(wanted);

	if (wanted->has_draws) {
		struct kind *kind = kind_of(packets, &choice.limits, &drawn);

		list_drawn(packets, kind, choice.all, wanted);
		choice.listed = &kind->estimate;
		choice.variant = kind->variant;
		choice.map_size = kind->drawn_packet.map_size;
	} else if (!wanted->raw) {
		struct kind *kind = kind_of(packets, &choice.limits, &drawn);

		list(kind, &estimates->smoothed, wanted);
		choice.listed = &kind->estimate;
		choice.variant = kind->variant;
	} else {
		choice.listed = choice.all;
		if (wanted->leave_out_reflections) {
			lp_leave_out_reflections(choice.all, &packets->others);
			choice.listed = &packets->others;
		}
		choice.variant = choose_raw(choice.listed, &choice.limits, wanted);
	}
	choice.variant.world = wanted->world && estimates->raw.orientation.world;
	return choice;
}

bool lp_choices_are_same(const struct lp_choice *a, const struct lp_choice *b)
{
	return a->all == b->all && a->listed == b->listed &&
	       a->variant.lights == b->variant.lights && same_limits(&a->limits, &b->limits);
}

struct lp_packet *lp_packets_estimate(struct lp_packets *packets,
				      const struct lp_estimates *estimates,
				      const struct lp_demand *computed,
				      const struct lp_subscription *wanted,
				      const struct lp_stamp *stamp)
{
	const struct lp_choice choice = lp_packets_choose(packets, estimates, computed, wanted);
	const struct lp_variant *variant = &choice.variant;
	const struct lp_drawn_wish drawn = drawn_of(wanted);
	struct packet **slot =
		wanted->raw && !wanted->has_draws
			? &packets->raw[wanted->leave_out_reflections][raw_index(variant)]
			: &kind_of(packets, &choice.limits, &drawn)
				   ->encoded[variant->world][variant->total][variant->key];

	if (!*slot || (*slot)->subscription != stamp->subscription ||
	    (*slot)->quiet_ms != stamp->quiet_ms) {
		forget(slot);
		*slot = encode(packets, choice.listed, variant, stamp);
	}
	return *slot ? &(*slot)->base : NULL;
}

void lp_packets_forget(struct lp_packets *packets)
{
	for (int i = 0; i < RAW_VARIANTS; i++)
		for (int left_out = 0; left_out < 2; left_out++)
			forget(&packets->raw[left_out][i]);
	for (int k = 0; k < KINDS; k++)
		forget_kind(&packets->kinds[k]);
	lp_drawn_room_forget(packets->room);
}

int lp_packets_map_size(struct lp_packets *packets, const struct lp_demand *computed,
			const struct lp_subscription *wanted)
{
	const struct lp_listing_limits limits = limits_of(computed, wanted);
	const struct lp_drawn_wish drawn = drawn_of(wanted);
	const struct kind *kind = wanted->has_draws ? find_kind(packets, &limits, &drawn) : NULL;

	return kind && kind->drawn_state.map.decided ? kind->drawn_state.map.size
						     : wanted->reflection.size;
}

void lp_packets_set_maps(struct lp_packets *packets, const struct lp_drawn_maps *maps)
{
	lp_drawn_room_set_maps(packets->room, maps);
}

const struct lp_drawn_maps *lp_packets_maps(const struct lp_packets *packets)
{
	return lp_drawn_room_maps(packets->room);
}
