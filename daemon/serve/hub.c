/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/hub.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/pool.h"
#include "drivers/publisher/places.h"
#include "estimate/estimates.h"
#include "include/packet.h"
#include "include/wish.h"
#include "serve/health.h"
#include "serve/hub_state.h"

/* A client may hold one packet half sent, the newest estimate, and a queue of control messages. */
#define PACKETS_PER_CLIENT 12
/* And of pictures one half sent, and the newest; one more is being made. */
#define PICTURES_PER_CLIENT 2
#define STALE_PERIOD_NS LP_NS_PER_S
/* What reflection maps may take of a frame; those that are left wait for the next one. */
#define REFLECTION_BUDGET_NS (5 * LP_NS_PER_MS)
#define REFLECTION_FAULT_NS (5 * LP_NS_PER_S)
#define REFLECTION_FAULT "reflection-maps-late"
#define REFLECTION_LATE                                                         \
	"clients ask for more than there is time for, and get them less often " \
	"— ask for the same size and lights, or a lower rate"
/* A new subscription is answered at once, but not more often than this: it costs an encoding. */
#define ANSWER_PERIOD_NS (100 * LP_NS_PER_MS)

/* ---------------------------------------------------------------- packets */

static void send_packet(struct lp_hub *hub, struct lp_hub_client *client, struct lp_packet *packet)
{
	hub->options.health->report.packets_sent++;
	client->publisher->ops->send(client->publisher, client->handle, packet);
}

void lp_hub_send_last(struct lp_hub *hub, struct lp_hub_client *client, struct lp_packet *packet)
{
	if (packet)
		send_packet(hub, client, packet);
	lp_packet_drop(packet);
}

void lp_hub_send_error(struct lp_hub *hub, struct lp_hub_client *client, int code, const char *text)
{
	struct lp_packet *packet = lp_packets_take(hub->packets);

	if (packet)
		lp_encode_error(code, text, packet);
	lp_hub_send_last(hub, client, packet);
}

static void send_hello(struct lp_hub *hub, struct lp_hub_client *client)
{
	struct lp_packet *packet = lp_packets_take(hub->packets);

	if (packet)
		lp_encode_hello(&hub->options.hello, packet);
	lp_hub_send_last(hub, client, packet);
}

static void greet_again(struct lp_hub *hub)
{
	for (int i = 0; i < hub->client_count; i++)
		send_hello(hub, hub->clients[i]);
}

void lp_hub_preset(struct lp_hub *hub, const char *name)
{
	hub->options.hello.preset = name;
	greet_again(hub);
}

void lp_hub_processing(struct lp_hub *hub, uint32_t on)
{
	if (on == hub->options.hello.processing_on)
		return;
	hub->options.hello.processing_on = on;
	greet_again(hub);
}

void lp_hub_set_insecure(struct lp_hub *hub)
{
	hub->options.hello.insecure_lan = true;
}

/* ---------------------------------------------------------------- estimates */

static struct lp_stamp stamp_of(const struct lp_hub *hub, const struct lp_hub_client *client)
{
	return (struct lp_stamp){.boot_id = hub->options.hello.boot_id,
				 .ttl_ms = hub->options.ttl_ms,
				 .quiet_ms = client->subscription.quiet_ms,
				 .lasts = hub->options.lasts,
				 .subscription = client->subscription.number,
				 .t_send_ns = lp_clock_ns()};
}

static struct lp_subscription wanted_by(const struct lp_hub_client *client)
{
	struct lp_subscription wanted = client->subscription;

	wanted.world &= !client->poses_refused;
	return wanted;
}

static void send_estimate(struct lp_hub *hub, struct lp_hub_client *client)
{
	const struct lp_stamp stamp = stamp_of(hub, client);
	const struct lp_subscription wanted = wanted_by(client);
	struct lp_packet *packet =
		lp_packets_estimate(hub->packets, &hub->last, &hub->last_computed, &wanted, &stamp);

	if (!packet)
		return;
	send_packet(hub, client, packet);
	lp_hub_note_sent(hub, client, &wanted);
}

/* Least time between messages; 0: none. */
static int64_t period_of(float rate_hz)
{
	return rate_hz <= 0 ? 0 : rate_hz < 1e-3F ? 1000 * LP_NS_PER_S : (int64_t)(1e9F / rate_hz);
}

/* Half a period early counts as in time, so that a client that asks for the camera's own rate
 * misses nothing to jitter; the schedule keeps the mean rate. */
static bool is_due(int64_t due_ns, float rate_hz, int64_t now_ns)
{
	return now_ns >= due_ns - period_of(rate_hz) / 2;
}

/* Whether a message may go now; then the next is scheduled. */
static bool take_turn(int64_t *due_ns, float rate_hz, int64_t now_ns)
{
	if (!is_due(*due_ns, rate_hz, now_ns))
		return false;
	*due_ns += period_of(rate_hz);
	if (*due_ns < now_ns) /* no burst after a pause */
		*due_ns = now_ns + period_of(rate_hz);
	return true;
}

/* By its rate; and of a client that says what it draws, when it needs one. */
static bool reflection_is_due(const struct lp_hub *hub, const struct lp_hub_client *client,
			      int64_t now_ns)
{
	const struct lp_subscription *wanted = &client->subscription;

	return is_due(client->reflection_due_ns, wanted->reflection.rate_hz, now_ns) &&
	       (!wanted->has_draws ||
		lp_drawn_pace_is_due(&client->reflection_pace, &hub->last.smoothed, &wanted->draws,
				     now_ns));
}

/* A map goes only with the frame that it was made of. */
static void send_reflection(struct lp_hub *hub, struct lp_hub_client *client,
			    const struct lp_surroundings *surroundings, int64_t now_ns)
{
	const struct lp_subscription wanted = wanted_by(client);
	struct lp_reflection_wish wish = wanted.reflection;
	struct lp_packet *packet;
	const struct lp_stamp stamp = stamp_of(hub, client);
	const struct lp_choice choice =
		lp_packets_choose(hub->packets, &hub->last, &hub->last_computed, &wanted);

	wish.size = choice.map_size;
	/* decided with this frame, or due by its light: the next frame's surroundings suffice */
	if (wanted.has_draws && surroundings->size < wish.size)
		return;
	if (!wish.size || !take_turn(&client->reflection_due_ns, wish.rate_hz, now_ns))
		return;
	packet = lp_reflection_maps_packet(hub->reflections, surroundings, &choice, &wish, &stamp);
	if (!packet)
		return;
	lp_drawn_pace_note(&client->reflection_pace, &hub->last.smoothed, now_ns);
	send_packet(hub, client, packet);
}

static void tell_late_reflections(struct lp_hub *hub, int64_t now_ns)
{
	if (!hub->reflection_late_ns) {
		lp_health_fault(hub->options.health, REFLECTION_FAULT,
				"hub: reflection maps: " REFLECTION_LATE);
		lp_warning("hub", "reflection maps", REFLECTION_LATE);
	}
	hub->reflection_late_ns = now_ns;
}

/* To whoever is due, from the client on that had to wait last time. */
static void send_reflections(struct lp_hub *hub, const struct lp_surroundings *surroundings,
			     int64_t now_ns)
{
	const int first = hub->reflection_first;
	const int64_t begin_ns = lp_clock_ns();

	for (int k = 0; k < hub->client_count; k++) {
		const int i = (first + k) % hub->client_count;
		struct lp_hub_client *client = hub->clients[i];

		if (!client->subscription.reflection.size ||
		    !reflection_is_due(hub, client, now_ns))
			continue;
		if (lp_clock_ns() - begin_ns > REFLECTION_BUDGET_NS) {
			hub->reflection_first = i;
			tell_late_reflections(hub, now_ns);
			break;
		}
		send_reflection(hub, client, surroundings, now_ns);
	}
	lp_reflection_maps_forget(hub->reflections);
}

void lp_hub_answer_subscription(struct lp_hub *hub, struct lp_hub_client *client, int64_t now_ns)
{
	if (!client->subscribed ||
	    (client->answered_ns && now_ns - client->answered_ns < ANSWER_PERIOD_NS))
		return;
	client->subscribed = false;
	client->answered_ns = now_ns;
	client->due_ns = now_ns + period_of(client->subscription.rate_hz);
	client->reflection_due_ns = 0;
	client->reflection_pace.t_ns = 0;
	client->health_due_ns = 0;
	if (hub->has_last)
		send_estimate(hub, client);
}

/* `surroundings`: of this estimate; NULL: there are none. `again`: it has been sent before, and is
 * stale now. */
static void send_to_all(struct lp_hub *hub, const struct lp_surroundings *surroundings, bool again)
{
	const int64_t now_ns = lp_clock_ns();

	if (surroundings)
		lp_packets_set_maps(hub->packets,
				    lp_reflection_maps_measure(hub->reflections, surroundings,
							       &hub->last.smoothed));
	for (int i = 0; i < hub->client_count; i++) {
		struct lp_hub_client *client = hub->clients[i];
		const struct lp_subscription wanted = wanted_by(client);

		if (!again && lp_hub_has_no_news(hub, client, &wanted, now_ns))
			continue;
		if (take_turn(&client->due_ns, client->subscription.rate_hz, now_ns))
			send_estimate(hub, client);
	}
	if (surroundings)
		send_reflections(hub, surroundings, now_ns);
	lp_packets_forget(hub->packets);
}

void lp_hub_publish(struct lp_hub *hub, const struct lp_estimates *estimates,
		    const struct lp_demand *computed)
{
	const struct lp_surroundings *surroundings = estimates->surroundings;
	struct lp_health *health = hub->options.health;

	hub->last = *estimates;
	hub->last_computed = *computed;
	hub->last.raw.sequence = hub->last.smoothed.sequence = ++hub->sequence;
	hub->last_ns = lp_clock_ns();
	hub->stale_ns = 0;
	hub->has_last = true;
	hub->last.surroundings = NULL;
	health->report.estimates++;
	send_to_all(hub,
		    hub->reflections && surroundings && surroundings->size ? surroundings : NULL,
		    false);
	lp_health_add_latency(health, lp_clock_ns() - estimates->raw.t_arrival_ns);
}

static void repeat_when_stale(struct lp_hub *hub, int64_t now_ns)
{
	if (!hub->has_last || now_ns - hub->last_ns < hub->options.ttl_ms * LP_NS_PER_MS)
		return;
	if (hub->stale_ns && now_ns - hub->stale_ns < STALE_PERIOD_NS)
		return;
	hub->stale_ns = now_ns;
	send_to_all(hub, NULL, true);
}

static void send_health(struct lp_hub *hub, int64_t now_ns)
{
	struct lp_packet *packet = NULL;

	for (int i = 0; i < hub->client_count; i++) {
		struct lp_hub_client *client = hub->clients[i];
		const uint32_t period_ms = client->subscription.health_period_ms;

		if (period_ms == 0 || now_ns < client->health_due_ns)
			continue;
		client->health_due_ns = now_ns + period_ms * LP_NS_PER_MS;
		if (!packet) {
			packet = lp_packets_take(hub->packets);
			if (!packet)
				return;
			lp_health_update(hub->options.health, now_ns);
			if (lp_encode_health(&hub->options.health->report, packet) != 0)
				break;
		}
		send_packet(hub, client, packet);
	}
	lp_packet_drop(packet);
}

void lp_hub_tick(struct lp_hub *hub)
{
	const int64_t now_ns = lp_clock_ns();

	for (int i = 0; i < hub->client_count; i++)
		lp_hub_answer_subscription(hub, hub->clients[i], now_ns);
	lp_packets_forget(hub->packets);
	repeat_when_stale(hub, now_ns);
	if (hub->reflection_late_ns && now_ns - hub->reflection_late_ns > REFLECTION_FAULT_NS) {
		hub->reflection_late_ns = 0;
		lp_health_fault(hub->options.health, REFLECTION_FAULT, NULL);
	}
	lp_health_tick(hub->options.health, now_ns);
	send_health(hub, now_ns);
}

struct lp_demand lp_hub_demand(const struct lp_hub *hub)
{
	const struct lp_subscription *initial = &hub->options.initial;
	const int64_t now_ns = lp_clock_ns();
	struct lp_demand demand = {.sh_order = initial->sh_order,
				   .max_lights = initial->max_lights,
				   .reflection_size = initial->reflection.size};

	for (int i = 0; i < hub->client_count; i++) {
		const struct lp_subscription *wanted = &hub->clients[i]->subscription;

		if (wanted->sh_order > demand.sh_order)
			demand.sh_order = wanted->sh_order;
		if (wanted->max_lights > demand.max_lights)
			demand.max_lights = wanted->max_lights;
		if (wanted->reflection.size > demand.reflection_size &&
		    reflection_is_due(hub, hub->clients[i], now_ns)) {
			const int size =
				lp_packets_map_size(hub->packets, &hub->last_computed, wanted);

			demand.reflection_size =
				size > demand.reflection_size ? size : demand.reflection_size;
		}
	}
	if (demand.sh_order > hub->options.hello.max_sh_order)
		demand.sh_order = hub->options.hello.max_sh_order;
	if (demand.max_lights > hub->options.hello.max_lights)
		demand.max_lights = hub->options.hello.max_lights;
	demand.polarization_map = lp_hub_polarization_is_due(hub);
	return demand;
}

/* ---------------------------------------------------------------- clients */

/* Refused clients get their reason through an entry of this stack only. */
static int refuse(struct lp_hub *hub, struct lp_publisher *publisher, struct lp_client *handle,
		  int code, const char *reason)
{
	struct lp_hub_client passing = {.publisher = publisher, .handle = handle};
	char text[200];

	(void)snprintf(text, sizeof(text), "lightprobed: connect: %s", reason);
	lp_warning("hub", "connect", "a client is refused: %s", reason);
	lp_hub_send_error(hub, &passing, code, text);
	return code;
}

/* Of a client that cannot ask. */
static void apply_wish(struct lp_subscription *subscription, const struct lp_wish *wish)
{
	subscription->rate_hz = wish->rate_hz;
	subscription->sh_order = wish->sh_order;
	subscription->max_lights = wish->max_lights;
	subscription->health_period_ms = (uint32_t)wish->health_period_ms;
	subscription->quiet_ms = (uint32_t)wish->quiet_ms;
	subscription->total = wish->total;
	subscription->key_light = wish->key_light;
	subscription->area_lights = wish->area_lights;
}

static int on_connected(void *context, struct lp_publisher *publisher, struct lp_client *handle,
			int code, const char *refusal, void **user)
{
	struct lp_hub *hub = context;
	struct lp_hub_client *client;
	char full[80];

	if (refusal)
		return refuse(hub, publisher, handle, code, refusal);
	client = lp_pool_take(hub->client_pool);
	if (!client) {
		(void)snprintf(full, sizeof(full), "%d clients are connected — raise --max-clients",
			       hub->client_count);
		return refuse(hub, publisher, handle, -EUSERS, full);
	}
	*client = (struct lp_hub_client){.publisher = publisher,
					 .handle = handle,
					 .subscription = hub->options.initial,
					 .index = hub->client_count};
	if (publisher->wish)
		apply_wish(&client->subscription, publisher->wish);
	hub->clients[hub->client_count++] = client;
	hub->options.health->report.clients = (uint32_t)hub->client_count;
	*user = client;
	send_hello(hub, client);
	if (hub->has_last)
		send_estimate(hub, client);
	lp_packets_forget(hub->packets);
	return 0;
}

static void on_disconnected(void *context, void *user)
{
	struct lp_hub *hub = context;
	struct lp_hub_client *client = user;

	if (hub->options.left)
		hub->options.left(hub->options.context, client);
	lp_hub_clock_fault(hub, client, NULL);
	hub->client_count--;
	hub->clients[client->index] = hub->clients[hub->client_count];
	hub->clients[client->index]->index = client->index;
	hub->options.health->report.clients = (uint32_t)hub->client_count;
	lp_pool_give(hub->client_pool, client);
}

static void on_superseded(void *context, void *user)
{
	struct lp_hub *hub = context;

	(void)user;
	hub->options.health->report.packets_superseded++;
}

static void on_failed(void *context, struct lp_publisher *publisher, int failure)
{
	struct lp_hub *hub = context;

	(void)publisher;
	hub->options.failed(hub->options.context, failure);
}

struct lp_publisher_host lp_hub_publisher_host(struct lp_hub *hub)
{
	return (struct lp_publisher_host){
		.context = hub,
		.loop = hub->options.loop,
		.max_clients = hub->options.max_clients,
		.places = hub->places,
		.insecure_lan = hub->options.insecure_lan,
		.connected = on_connected,
		.request = lp_hub_on_request,
		.requests_done = lp_hub_on_requests_done,
		.unreadable = lp_hub_on_unreadable,
		.disconnected = on_disconnected,
		.superseded = on_superseded,
		.failed = on_failed,
	};
}

/* ---------------------------------------------------------------- life */

int lp_hub_create(const struct lp_hub_options *options, struct lp_hub **hub)
{
	struct lp_hub *self = calloc(1, sizeof(*self));

	if (!self)
		return -ENOMEM;
	self->options = *options;
	self->places = lp_places_create(options->max_clients);
	self->clients = calloc((size_t)options->max_clients, sizeof(struct lp_hub_client *));
	self->client_pool =
		lp_pool_create(sizeof(struct lp_hub_client), options->max_clients, NULL);
	/* Those that leave may hold as much. */
	const int holders = options->max_clients + LP_PLACES_LEAVING;

	self->packets =
		lp_packets_create(holders * PACKETS_PER_CLIENT, holders * PICTURES_PER_CLIENT + 1);
	if (options->hello.max_reflection_size)
		self->reflections =
			lp_reflection_maps_create(options->hello.max_reflection_size, holders);
	if (!self->places || !self->clients || !self->client_pool || !self->packets ||
	    (options->hello.max_reflection_size && !self->reflections)) {
		lp_hub_destroy(self);
		return -ENOMEM;
	}
	*hub = self;
	return 0;
}

void lp_hub_destroy(struct lp_hub *hub)
{
	if (!hub)
		return;
	lp_reflection_maps_destroy(hub->reflections);
	lp_packets_destroy(hub->packets);
	lp_pool_destroy(hub->client_pool);
	lp_places_destroy(hub->places);
	free((void *)hub->clients);
	free(hub);
}
