/* SPDX-License-Identifier: Apache-2.0 */
#include "wire.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "estimate/surroundings.h"
#include "include/polarization_grid.h"
#include "include/processing.h"
#include "include/wish.h"
#include "serve/health.h"
#include "serve/hub.h"

#define MAX_CLIENTS 8

/* A publisher that keeps what it is told to send. */
struct lp_client {
	void *user;
	int count; /* packets, ever */
	struct lp_packet *packets[256];
};

static struct lp_hub *hub;
static struct lp_health health;
static struct lp_publisher_host host;
static struct lp_client clients[MAX_CLIENTS + 1];

static int64_t map_takes_ns; /* in simulated time */

static void keep(struct lp_publisher *publisher, struct lp_client *client, struct lp_packet *packet)
{
	(void)publisher;
	assert_true(client->count < 256);
	client->packets[client->count++] = lp_packet_hold(packet);
	if (packet->kind == LP_PACKET_PICTURE)
		lp_clock_simulate(lp_clock_ns() + map_takes_ns);
}

static const struct lp_publisher_ops ops = {.info = {.scheme = "test"}, .send = keep};
static struct lp_publisher publisher = {.ops = &ops};

/* What the wheel answers. */
static int sweep_result;

static int on_sweep(void *context, uint64_t *done_at, const char **reason)
{
	(void)context;
	*done_at = 12;
	*reason = "it stays — turn it";
	return sweep_result;
}

/* How many cameras take stills; or why none does. */
static int stills_result;

static int on_stills(void *context, const char **reason)
{
	(void)context;
	*reason = "none is ready — plug it in";
	return stills_result;
}

static int create_hub(bool polarization_map, int max_reflection_size)
{
	const struct lp_hub_options options = {
		.sweep = on_sweep,
		.stills = on_stills,
		.hello = {.polarization_map = polarization_map,
			  .boot_id = 5,
			  .source = "test",
			  .preset = "fast",
			  .name = "a probe",
			  .max_sh_order = 3,
			  .max_lights = 6,
			  .max_reflection_size = max_reflection_size},
		.initial = lp_default_subscription(),
		.ttl_ms = 30,
		.max_clients = MAX_CLIENTS,
		.health = &health,
	};

	lp_clock_simulate(LP_NS_PER_S);
	lp_health_init(&health, lp_clock_ns());
	health.report.preset = "fast";
	memset(clients, 0, sizeof(clients));
	if (lp_hub_create(&options, &hub) < 0)
		return -1;
	host = lp_hub_publisher_host(hub);
	return 0;
}

static int setup(void **state)
{
	(void)state;
	return create_hub(false, 0);
}

static int setup_with_reflections(void **state)
{
	(void)state;
	return create_hub(false, 32);
}

static int setup_with_pictures(void **state)
{
	(void)state;
	return create_hub(true, 0);
}

static void forget_packets(struct lp_client *client)
{
	for (int i = 0; i < client->count; i++)
		lp_packet_drop(client->packets[i]);
	client->count = 0;
}

/* Room for more packets. */
static void forget_all_but_count(struct lp_client *client)
{
	static struct lp_packet none = {.references = UINT32_MAX / 2};

	for (int i = 0; i < client->count; i++) {
		if (client->packets[i] != &none)
			lp_packet_drop(client->packets[i]);
		client->packets[i] = &none;
	}
}

static void leave(struct lp_client *client)
{
	forget_packets(client);
	host.disconnected(host.context, client->user);
	client->user = NULL;
}

static int teardown(void **state)
{
	(void)state;
	for (size_t i = 0; i < LP_COUNT(clients); i++) {
		forget_packets(&clients[i]);
		if (clients[i].user)
			leave(&clients[i]);
	}
	lp_hub_destroy(hub); /* fails when a packet is still held */
	return 0;
}

static struct lp_client *join(int index)
{
	assert_int_equal(host.connected(host.context, &publisher, &clients[index], 0, NULL,
					&clients[index].user),
			 0);
	return &clients[index];
}

static int subscribe(struct lp_client *client, const lightprobe_v1_Subscription *wire)
{
	uint8_t data[LP_REQUEST_MAX_BYTES];
	const size_t size = encode_request(wire, data, sizeof(data));

	const int ret = host.request(host.context, client->user, data, size);

	if (ret == 0)
		host.requests_done(host.context, client->user);
	return ret;
}

/* Simulated time goes on. */
static void pass_ms(int ms)
{
	lp_clock_simulate(lp_clock_ns() + ms * LP_NS_PER_MS);
}

static struct lp_surroundings surroundings; /* of the next estimates, if of any size */

static void publish(float value)
{
	const struct lp_demand computed = {.sh_order = 3, .max_lights = 6};
	struct lp_estimates estimates = {.surroundings = &surroundings};

	estimates.raw.t_capture_ns = estimates.raw.t_arrival_ns = lp_clock_ns();
	estimates.raw.cd_m2_per_unit = estimates.raw.exposure_us = NAN;
	estimates.raw.light_count = 3;
	for (int i = 0; i < 3; i++)
		estimates.raw.lights[i] = (struct lp_light){.id = 1, .direction = {0, 1, 0}};
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		for (int lights = 0; lights <= LP_MAX_LIGHTS; lights++)
			estimates.raw.predicted_error[order][lights] =
				0.5F - 0.1F * (float)order - 0.01F * (float)lights;
	}
	estimates.smoothed = estimates.raw;
	estimates.raw.sh_total[0][0] = value;
	estimates.smoothed.sh_total[0][0] = -value;
	lp_hub_publish(hub, &estimates, &computed);
}

static lightprobe_v1_Estimate last_estimate(const struct lp_client *client)
{
	lightprobe_v1_FromProbe message;

	assert_true(client->count > 0);
	message = decode_packet(client->packets[client->count - 1]);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_estimate_tag);
	return message.message.estimate;
}

static void test_hello_first_then_the_last_value_at_once(void **state)
{
	struct lp_client *early = join(0), *late;

	(void)state;
	assert_int_equal(early->count, 1);
	assert_int_equal(decode_packet(early->packets[0]).which_message,
			 lightprobe_v1_FromProbe_hello_tag);
	publish(1);
	publish(2);
	assert_int_equal(early->count, 3);
	late = join(1);
	assert_int_equal(late->count, 2);
	assert_int_equal(decode_packet(late->packets[0]).which_message,
			 lightprobe_v1_FromProbe_hello_tag);
	assert_int_equal(last_estimate(late).sequence, 2);
	assert_int_equal(last_estimate(late).boot_id, 5);
	assert_int_equal(last_estimate(late).sh.order, 2);
}

static void test_a_new_preset_is_told_to_all(void **state)
{
	struct lp_client *client = join(0), *late;
	lightprobe_v1_FromProbe message;

	(void)state;
	lp_hub_preset(hub, "fast");
	assert_int_equal(client->count, 2);
	message = decode_packet(client->packets[1]);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_hello_tag);
	assert_string_equal(message.message.hello.preset, "fast");
	late = join(1);
	message = decode_packet(late->packets[0]);
	assert_string_equal(message.message.hello.preset, "fast");
}

static void test_new_processing_is_told_to_all(void **state)
{
	struct lp_client *client = join(0), *late;
	lightprobe_v1_Hello hello;

	(void)state;
	lp_hub_processing(hub, 0);
	assert_int_equal(client->count, 1);
	for (int i = 0; i < 2; i++) /* as a camera that is connected again */
		lp_hub_processing(hub, LP_PROCESSING_BIT(LP_PROCESSING_GAMMA) |
					       LP_PROCESSING_BIT(LP_PROCESSING_SCENE));
	assert_int_equal(client->count, 2);
	hello = decode_packet(client->packets[1]).message.hello;
	assert_int_equal(hello.processing_count, 2);
	assert_string_equal(hello.processing[0], "gamma");
	assert_string_equal(hello.processing[1], "scene");
	late = join(1);
	assert_int_equal(decode_packet(late->packets[0]).message.hello.processing_count, 2);
}

static void test_same_wishes_share_one_packet(void **state)
{
	const lightprobe_v1_Subscription raw = {.smoothing =
							lightprobe_v1_Subscription_Smoothing_RAW};

	(void)state;
	for (int i = 0; i < 4; i++)
		join(i);
	assert_int_equal(subscribe(&clients[3], &raw), 0);
	publish(1);
	assert_ptr_equal(clients[0].packets[1], clients[1].packets[1]);
	assert_ptr_equal(clients[0].packets[1], clients[2].packets[1]);
	assert_ptr_not_equal(clients[0].packets[1], clients[3].packets[1]);
	assert_int_equal(clients[0].packets[1]->references, 3);
	assert_true(last_estimate(&clients[0]).sh.coefficients[0] == -1);
	assert_true(last_estimate(&clients[3]).sh.coefficients[0] == 1);
}

static void test_estimates_carry_the_number_of_their_subscription(void **state)
{
	const lightprobe_v1_Subscription first = {.number = 1}, second = {.number = 2};

	(void)state;
	publish(1);
	for (int i = 0; i < 4; i++)
		join(i);
	assert_int_equal(last_estimate(&clients[0]).subscription, 0);
	assert_int_equal(subscribe(&clients[0], &first), 0);
	assert_int_equal(last_estimate(&clients[0]).subscription, 1);
	assert_int_equal(subscribe(&clients[1], &first), 0);
	assert_int_equal(subscribe(&clients[2], &second), 0);
	publish(2);
	for (int i = 0; i < 4; i++) {
		assert_int_equal(last_estimate(&clients[i]).sequence, 2);
		assert_int_equal(last_estimate(&clients[i]).subscription,
				 (uint32_t)((int[]){1, 1, 2, 0})[i]);
	}
	assert_ptr_equal(clients[0].packets[clients[0].count - 1],
			 clients[1].packets[clients[1].count - 1]);
	/* The same estimate again, of another subscription: told apart by the number alone. So soon
	 * after the last answer it comes with the next tick. */
	assert_int_equal(subscribe(&clients[0], &second), 0);
	assert_int_equal(last_estimate(&clients[0]).subscription, 1);
	pass_ms(100);
	lp_hub_tick(hub);
	assert_int_equal(last_estimate(&clients[0]).sequence, 2);
	assert_int_equal(last_estimate(&clients[0]).subscription, 2);
}

static void test_wishes_are_kept_within_what_was_computed(void **state)
{
	const lightprobe_v1_Subscription much = {
		.has_sh_order = true,
		.sh_order = 4,
		.has_max_lights = true,
		.max_lights = 8,
		.kind = lightprobe_v1_SphericalHarmonics_Kind_TOTAL};
	struct lp_client *client = join(0);

	(void)state;
	publish(1);
	assert_int_equal(subscribe(client, &much), 0);
	assert_int_equal(last_estimate(client).sh.order, 3);
	assert_int_equal(last_estimate(client).lights_count, 3);
	assert_int_equal(last_estimate(client).sh.kind,
			 lightprobe_v1_SphericalHarmonics_Kind_TOTAL);
}

static void test_tolerance_chooses_a_smaller_model(void **state)
{
	const lightprobe_v1_Subscription tolerant = {.tolerance_permille = 450};
	struct lp_client *client = join(0);

	(void)state;
	assert_int_equal(subscribe(client, &tolerant), 0);
	publish(1);
	assert_true(last_estimate(client).sh.order < 2);
	assert_true(last_estimate(client).predicted_error_permille <= 450);
}

static void test_demand_is_the_most_any_client_asks(void **state)
{
	const lightprobe_v1_Subscription little = {.has_sh_order = true, .has_max_lights = true};
	const lightprobe_v1_Subscription much = {.has_sh_order = true,
						 .sh_order = 4,
						 .has_max_lights = true,
						 .max_lights = 8};

	(void)state;
	assert_int_equal(lp_hub_demand(hub).sh_order, 2);
	assert_int_equal(lp_hub_demand(hub).max_lights, 4);
	join(0);
	join(1);
	assert_int_equal(subscribe(&clients[0], &little), 0);
	assert_int_equal(lp_hub_demand(hub).sh_order, 2);
	assert_int_equal(subscribe(&clients[1], &much), 0);
	assert_int_equal(lp_hub_demand(hub).sh_order, 3);
	assert_int_equal(lp_hub_demand(hub).max_lights, 6);
	leave(&clients[1]);
	assert_int_equal(lp_hub_demand(hub).sh_order, 2);
}

static void test_who_cannot_ask_gets_what_its_publisher_wishes(void **state)
{
	static const char *const names[] = {"hello", "estimate", "health"};
	const struct lp_wish wish = {.sh_order = 3, .max_lights = 1, .health_period_ms = 1};
	struct lp_client *client;
	lightprobe_v1_FromProbe message;

	(void)state;
	publisher.wish = &wish;
	client = join(0);
	publisher.wish = NULL;
	assert_int_equal(lp_hub_demand(hub).sh_order, 3);
	publish(1);
	lp_hub_tick(hub);
	assert_int_equal(client->count, 3);
	for (int i = 0; i < client->count; i++)
		assert_string_equal(client->packets[i]->name, names[i]);
	message = decode_packet(client->packets[1]);
	assert_int_equal(message.message.estimate.subscription, 0);
	assert_int_equal(message.message.estimate.sh.order, 3);
}

static void test_rate_limit(void **state)
{
	const lightprobe_v1_Subscription slow = {.rate_hz = 50};
	struct lp_client *client = join(0);

	(void)state;
	assert_int_equal(subscribe(client, &slow), 0);
	for (int ms = 0; ms < 1000; ms += 2) {
		publish(1);
		forget_all_but_count(client);
		pass_ms(2);
	}
	assert_in_range(client->count - 1, 50, 51); /* the hello apart; one may be early */
}

static void test_a_subscription_is_answered_at_once_but_not_over_and_over(void **state)
{
	const lightprobe_v1_Subscription slow = {.rate_hz = 1};
	struct lp_client *client = join(0);
	int answers = 0;

	(void)state;
	publish(1);
	for (int ms = 0; ms < 1000; ms += 25) {
		const int before = client->count;

		assert_int_equal(subscribe(client, &slow), 0);
		answers += client->count - before;
		forget_all_but_count(client);
		pass_ms(25);
	}
	assert_int_equal(answers, 10); /* every 100 ms */
}

static void test_of_subscriptions_that_come_together_the_newest_is_answered(void **state)
{
	struct lp_client *client = join(0);
	uint8_t data[LP_REQUEST_MAX_BYTES];

	(void)state;
	publish(1);
	assert_int_equal(client->count, 2);
	for (uint32_t number = 1; number <= 9; number++) {
		const lightprobe_v1_Subscription wire = {.number = number};
		const size_t size = encode_request(&wire, data, sizeof(data));

		assert_int_equal(host.request(host.context, client->user, data, size), 0);
	}
	assert_int_equal(client->count, 2);
	host.requests_done(host.context, client->user);
	assert_int_equal(client->count, 3);
	assert_int_equal(last_estimate(client).subscription, 9);
}

static void test_a_flood_of_requests_ends_the_connection(void **state)
{
	const lightprobe_v1_Subscription wire = {.number = 1};
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;

	(void)state;
	for (int second = 0; second < 3; second++) {
		for (int i = 0; i < 50; i++)
			assert_int_equal(subscribe(client, &wire), 0);
		pass_ms(1000);
	}
	for (int i = 0; i < 50; i++)
		assert_int_equal(subscribe(client, &wire), 0);
	pass_ms(999);
	assert_int_equal(subscribe(client, &wire), -EDQUOT);
	message = decode_packet(client->packets[client->count - 1]);
	assert_int_equal(message.message.error.code, -EDQUOT);
	assert_contains(message.message.error.text, "more than 50 in a second");
	assert_int_equal(health.report.requests_rejected, 1);
}

/* Packets that are reflection maps, since the last call. */
static int count_maps(struct lp_client *client)
{
	int maps = 0;

	for (int i = 0; i < client->count; i++)
		maps += client->packets[i]->kind == LP_PACKET_PICTURE;
	forget_packets(client);
	return maps;
}

/* A frame as the daemon has it: what is wanted is made, and published. */
static void frame(void)
{
	surroundings.size = lp_hub_demand(hub).reflection_size;
	publish(1);
	surroundings.size = 0;
}

static void test_reflection_maps_at_their_own_rate(void **state)
{
	const lightprobe_v1_Subscription slow = {.has_reflection_map = true,
						 .reflection_map = {.size = 16, .rate_hz = 2}};
	const lightprobe_v1_Subscription fast = {.rate_hz = 1,
						 .has_reflection_map = true,
						 .reflection_map = {.size = 64}};
	int made = 0, slow_maps = 0, fast_maps = 0;

	(void)state;
	for (int i = 0; i < 3; i++)
		join(i);
	assert_int_equal(decode_packet(clients[0].packets[0]).message.hello.max_reflection_map_size,
			 32);
	frame();
	assert_int_equal(count_maps(&clients[0]), 0); /* none unasked */
	assert_int_equal(subscribe(&clients[0], &slow), 0);
	assert_int_equal(subscribe(&clients[1], &fast), 0);
	assert_int_equal(lp_hub_demand(hub).reflection_size, 32); /* the most there is */
	for (int ms = 0; ms < 2000; ms += 20) {
		made += lp_hub_demand(hub).reflection_size > 0;
		frame();
		slow_maps += count_maps(&clients[0]);
		fast_maps += count_maps(&clients[1]);
		assert_int_equal(count_maps(&clients[2]), 0);
		pass_ms(20);
	}
	assert_in_range(slow_maps, 4, 5); /* one may be early */
	assert_in_range(fast_maps, 10, 11);
	assert_in_range(made, 10, 15); /* no more than are sent */
	publish(1);		       /* an estimate without a frame brings none */
	assert_int_equal(count_maps(&clients[1]), 0);
}

/* More maps than there is time for are sent less often, to each client in turn, and health says so;
 * estimates are not late for them. */
static void test_reflection_maps_have_a_budget(void **state)
{
	(void)state;
	for (int i = 0; i < MAX_CLIENTS; i++) {
		const lightprobe_v1_Subscription wish = {.number = 1 + (uint32_t)i,
							 .has_reflection_map = true,
							 .reflection_map = {.size = 16,
									    .rate_hz = 30}};

		assert_int_equal(subscribe(join(i), &wish), 0);
	}
	for (int k = 0; k < 16; k++) {
		const int64_t begin_ns = lp_clock_ns();

		map_takes_ns = 4 * LP_NS_PER_MS;
		frame();
		map_takes_ns = 0;
		assert_in_range(lp_clock_ns() - begin_ns, 1, 12 * LP_NS_PER_MS);
		pass_ms(34);
	}
	for (int i = 0; i < MAX_CLIENTS; i++)
		assert_in_range(count_maps(&clients[i]), 3, 5); /* of 16 */
	assert_string_equal(health.report.faults[0].id, "reflection-maps-late");
	pass_ms(6000);
	lp_hub_tick(hub);
	assert_int_equal(health.report.fault_count, 0);
}

static void test_reflection_maps_are_off_unless_the_owner_wants_them(void **state)
{
	const lightprobe_v1_Subscription wish = {.has_reflection_map = true,
						 .reflection_map = {.size = 16}};
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;

	(void)state;
	assert_int_equal(decode_packet(client->packets[0]).message.hello.max_reflection_map_size,
			 0);
	assert_int_equal(subscribe(client, &wish), 0); /* everything else goes on */
	message = decode_packet(client->packets[1]);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_error_tag);
	assert_int_equal(message.message.error.code, -EACCES);
	assert_contains(message.message.error.text, "--reflection-map");
	assert_int_equal(subscribe(client, &wish), 0);
	assert_int_equal(client->count, 2); /* told once */
	assert_int_equal(lp_hub_demand(hub).reflection_size, 0);
	surroundings.size = 16; /* even if there were one */
	publish(1);
	surroundings.size = 0;
	assert_int_equal(count_maps(client), 0);
}

static void test_stale_estimates_are_repeated_and_marked(void **state)
{
	struct lp_client *client = join(0);

	(void)state;
	lp_hub_tick(hub);
	assert_int_equal(client->count, 1); /* nothing to repeat */
	publish(1);
	lp_hub_tick(hub);
	assert_int_equal(client->count, 2);
	assert_int_equal(last_estimate(client).flags & LP_ESTIMATE_STALE, 0);
	pass_ms(40);
	lp_hub_tick(hub);
	lp_hub_tick(hub); /* at a low rate: not again so soon */
	assert_int_equal(client->count, 3);
	assert_int_equal(last_estimate(client).flags & LP_ESTIMATE_STALE, LP_ESTIMATE_STALE);
	assert_int_equal(last_estimate(client).sequence, 1);
	assert_int_equal(last_estimate(client).send_delay_us, 40000);
	assert_int_equal(last_estimate(join(1)).flags & LP_ESTIMATE_STALE, LP_ESTIMATE_STALE);
	publish(2);
	assert_int_equal(last_estimate(client).flags & LP_ESTIMATE_STALE, 0);
	assert_int_equal(last_estimate(client).sequence, 2);
}

static void test_health_at_its_period(void **state)
{
	const lightprobe_v1_Subscription with_health = {.health_period_ms = 1};
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;

	(void)state;
	join(1);
	assert_int_equal(subscribe(client, &with_health), 0);
	publish(1);
	lp_hub_tick(hub);
	lp_hub_tick(hub); /* the shortest period is 100 ms */
	assert_int_equal(client->count, 3);
	message = decode_packet(client->packets[2]);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_health_tag);
	assert_int_equal(message.message.health.clients, 2);
	assert_int_equal(message.message.health.estimates, 1);
	assert_string_equal(message.message.health.preset, "fast");
	assert_int_equal(clients[1].count, 2);
}

static void test_bad_requests_get_an_error(void **state)
{
	static const uint8_t garbage[] = {0xff, 0xff, 0xff};
	const lightprobe_v1_Subscription bad_rate = {.rate_hz = -1};
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;
	int count;

	(void)state;
	assert_true(host.request(host.context, client->user, garbage, 3) < 0);
	message = decode_packet(client->packets[client->count - 1]);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_error_tag);
	assert_int_equal(message.message.error.code, -EBADMSG);
	assert_contains(message.message.error.text, "request of 3 bytes");
	assert_true(subscribe(client, &bad_rate) < 0);
	message = decode_packet(client->packets[client->count - 1]);
	assert_contains(message.message.error.text, "rate_hz");
	/* A request that only a newer daemon knows: told, once, but not thrown out. */
	assert_int_equal(host.request(host.context, client->user, garbage, 0), 0);
	message = decode_packet(client->packets[client->count - 1]);
	assert_int_equal(message.message.error.code, -EOPNOTSUPP);
	count = client->count;
	assert_int_equal(host.request(host.context, client->user, garbage, 0), 0);
	assert_int_equal(client->count, count);
	host.unreadable(host.context, client->user, -EMSGSIZE, "too long");
	message = decode_packet(client->packets[client->count - 1]);
	assert_contains(message.message.error.text, "too long");
	assert_int_equal(health.report.requests_rejected, 5);
}

static void test_too_many_clients_are_refused_with_a_reason(void **state)
{
	struct lp_client *refused = &clients[MAX_CLIENTS];
	lightprobe_v1_FromProbe message;

	(void)state;
	for (int i = 0; i < MAX_CLIENTS; i++)
		join(i);
	assert_int_equal(host.connected(host.context, &publisher, refused, 0, NULL, &refused->user),
			 -EUSERS);
	assert_int_equal(refused->count, 1);
	message = decode_packet(refused->packets[0]);
	assert_int_equal(message.message.error.code, -EUSERS);
	assert_contains(message.message.error.text, "--max-clients");
	leave(&clients[0]);
	join(0);
	assert_int_equal(health.report.clients, MAX_CLIENTS);
}

static void test_clients_that_come_and_go_leave_the_others_alone(void **state)
{
	(void)state;
	for (int i = 0; i < 5; i++)
		join(i);
	leave(&clients[1]);
	leave(&clients[4]);
	publish(1);
	assert_int_equal(clients[0].count, 2);
	assert_int_equal(clients[1].count, 0);
	assert_int_equal(clients[2].count, 2);
	assert_int_equal(clients[3].count, 2);
	assert_int_equal(clients[4].count, 0);
	assert_int_equal(health.report.clients, 3);
}

static int ask(struct lp_client *client, pb_size_t which)
{
	const lightprobe_v1_FromClient wire = {.which_message = which};
	uint8_t data[16];
	pb_ostream_t stream = pb_ostream_from_buffer(data, sizeof(data));

	assert_true(pb_encode(&stream, lightprobe_v1_FromClient_fields, &wire));
	return host.request(host.context, client->user, data, stream.bytes_written);
}

static bool picture_is_due(void)
{
	return lp_hub_demand(hub).polarization_map;
}

static void test_pictures_of_polarized_light_for_who_asks(void **state)
{
	static struct lp_polarization_grid grid = {.s0_unit = 1};
	const pb_size_t get = lightprobe_v1_FromClient_get_polarization_map_tag;
	struct lp_client *first = join(0), *second = join(1), *other = join(2);

	(void)state;
	assert_true(decode_packet(first->packets[0]).message.hello.polarization_map);
	assert_false(picture_is_due());
	assert_int_equal(ask(first, get), 0);
	assert_int_equal(ask(first, get), 0);
	assert_int_equal(ask(second, get), 0);
	assert_true(picture_is_due());
	lp_hub_publish_polarization(hub, &grid);
	lp_hub_publish_polarization(hub, &grid); /* nobody waits any more */
	assert_true(first->count == 2 && second->count == 2 && other->count == 1);
	assert_ptr_equal(first->packets[1], second->packets[1]);
	assert_int_equal(decode_packet(first->packets[1]).which_message,
			 lightprobe_v1_FromProbe_polarization_map_tag);
	assert_int_equal(health.report.polarization_maps_sent, 2);
	assert_int_equal(ask(first, get), 0);
	assert_false(picture_is_due()); /* so soon */
	pass_ms(500);
	assert_true(picture_is_due());
	leave(first);
	assert_false(picture_is_due());
}

static void test_pictures_are_refused_unless_the_owner_allows_them(void **state)
{
	struct lp_client *client = join(0);

	(void)state;
	assert_false(decode_packet(client->packets[0]).message.hello.polarization_map);
	assert_int_equal(ask(client, lightprobe_v1_FromClient_get_polarization_map_tag), 0);
	const lightprobe_v1_FromProbe message = decode_packet(client->packets[client->count - 1]);

	assert_int_equal(message.message.error.code, -EPERM);
	assert_contains(message.message.error.text, "--publish-polarization");
	assert_int_equal(health.report.requests_rejected, 1);
	assert_false(picture_is_due());
}

/* What the client is answered. */
static lightprobe_v1_FromProbe answer_to(struct lp_client *client, pb_size_t which)
{
	assert_int_equal(ask(client, which), 0);
	return decode_packet(client->packets[client->count - 1]);
}

static void test_sweeps_on_request(void **state)
{
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;

	(void)state;
	sweep_result = 0;
	message = answer_to(client, lightprobe_v1_FromClient_start_sweep_tag);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_sweep_started_tag);
	assert_int_equal(message.message.sweep_started.done_at, 12);
	sweep_result = -EOPNOTSUPP;
	message = answer_to(client, lightprobe_v1_FromClient_start_sweep_tag);
	assert_int_equal(message.message.error.code, -EOPNOTSUPP);
	assert_contains(message.message.error.text, "sweep: it stays — turn it");
}

static void test_stills_on_request(void **state)
{
	struct lp_client *client = join(0);
	lightprobe_v1_FromProbe message;

	(void)state;
	stills_result = 2;
	message = answer_to(client, lightprobe_v1_FromClient_take_stills_tag);
	assert_int_equal(message.which_message, lightprobe_v1_FromProbe_stills_asked_tag);
	assert_int_equal(message.message.stills_asked.cameras, 2);
	stills_result = -EAGAIN;
	message = answer_to(client, lightprobe_v1_FromClient_take_stills_tag);
	assert_int_equal(message.message.error.code, -EAGAIN);
	assert_contains(message.message.error.text, "stills: none is ready — plug it in");
	assert_int_equal(health.report.requests_rejected, 1);
}

#define HUB_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		HUB_TEST(test_a_new_preset_is_told_to_all),
		HUB_TEST(test_new_processing_is_told_to_all),
		cmocka_unit_test_setup_teardown(test_pictures_of_polarized_light_for_who_asks,
						setup_with_pictures, teardown),
		HUB_TEST(test_pictures_are_refused_unless_the_owner_allows_them),
		HUB_TEST(test_sweeps_on_request),
		HUB_TEST(test_stills_on_request),
		HUB_TEST(test_hello_first_then_the_last_value_at_once),
		HUB_TEST(test_same_wishes_share_one_packet),
		HUB_TEST(test_estimates_carry_the_number_of_their_subscription),
		HUB_TEST(test_wishes_are_kept_within_what_was_computed),
		HUB_TEST(test_tolerance_chooses_a_smaller_model),
		HUB_TEST(test_demand_is_the_most_any_client_asks),
		HUB_TEST(test_who_cannot_ask_gets_what_its_publisher_wishes),
		HUB_TEST(test_rate_limit),
		HUB_TEST(test_a_subscription_is_answered_at_once_but_not_over_and_over),
		HUB_TEST(test_of_subscriptions_that_come_together_the_newest_is_answered),
		HUB_TEST(test_a_flood_of_requests_ends_the_connection),
		cmocka_unit_test_setup_teardown(test_reflection_maps_at_their_own_rate,
						setup_with_reflections, teardown),
		cmocka_unit_test_setup_teardown(test_reflection_maps_have_a_budget,
						setup_with_reflections, teardown),
		HUB_TEST(test_reflection_maps_are_off_unless_the_owner_wants_them),
		HUB_TEST(test_stale_estimates_are_repeated_and_marked),
		HUB_TEST(test_health_at_its_period),
		HUB_TEST(test_bad_requests_get_an_error),
		HUB_TEST(test_too_many_clients_are_refused_with_a_reason),
		HUB_TEST(test_clients_that_come_and_go_leave_the_others_alone),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
