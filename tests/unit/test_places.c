/* SPDX-License-Identifier: Apache-2.0 */
/* Who may be connected: many peers, few places, and no network. */
#include "drivers/publisher/places.h"

#include <errno.h>
#include <limits.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/socket.h>

#include "base/clock.h"
#include "base/macros.h"
#include "drivers/publisher/share.h"
#include "lp_test.h"

#define CLIENTS 16 /* 2 of them for trusted peers */
#define MOST 1024

static struct lp_places *places;
static struct lp_share share;
static struct lp_place connections[MOST];
static int evicted;
static char text[96];

static void on_evicted(struct lp_place *place)
{
	evicted++;
	if (place->phase == LP_PLACE_CLIENT)
		lp_place_leave(place);
	else
		lp_place_give(place);
}

static int setup(void **state)
{
	(void)state;
	lp_clock_simulate(1000 * LP_NS_PER_S);
	memset(connections, 0, sizeof(connections));
	evicted = 0;
	share = (struct lp_share){.clients = INT_MAX, .per_peer = CLIENTS / 2};
	places = lp_places_create(CLIENTS);
	return places ? 0 : -1;
}

static int teardown(void **state)
{
	(void)state;
	for (int i = 0; i < MOST; i++)
		lp_place_give(&connections[i]);
	lp_places_destroy(places);
	return 0;
}

static struct lp_peer address(uint64_t id)
{
	return (struct lp_peer){.family = AF_INET, .id = id};
}

static const struct lp_peer user = {.family = AF_UNIX, .id = 1000};

static int take(int k, struct lp_peer peer)
{
	return lp_place_take(places, &connections[k], &peer, LP_COST_CONNECTION_NS, on_evicted);
}

/* One more connection; whether it becomes a client. */
static bool join(int k, struct lp_peer peer)
{
	assert_int_equal(take(k, peer), 0);
	return lp_place_admit(&connections[k], &share, "tcp", text, sizeof(text)) == NULL;
}

static int count(enum lp_place_phase phase)
{
	int found = 0;

	for (int k = 0; k < MOST; k++)
		found += connections[k].places && connections[k].phase == phase;
	return found;
}

/* ---------------------------------------------------------------- places */

/* Whatever publisher they come by: two that each had their own count let one address take all. */
static void test_a_peer_has_its_share_of_all_publishers_together(void **state)
{
	static struct lp_share other;

	(void)state;
	other = share;
	for (int k = 0; k < 4; k++)
		assert_true(join(k, address(1)));
	for (int k = 4; k < 8; k++) {
		assert_int_equal(take(k, address(1)), 0);
		assert_null(lp_place_admit(&connections[k], &other, "ws", text, sizeof(text)));
	}
	assert_false(join(8, address(1)));
	assert_string_equal(text, "8 are from the same address — raise ?per_peer=");
	assert_true(join(9, address(2)));
	lp_place_give(&connections[0]);
	assert_true(join(0, address(1)));
}

static void test_a_publisher_has_its_share(void **state)
{
	(void)state;
	share.clients = 2;
	assert_true(join(0, address(1)) && join(1, address(2)));
	assert_false(join(2, address(3)));
	assert_string_equal(text, "tcp has 2 clients — raise its ?clients=");
	lp_place_leave(&connections[0]); /* it closes: its place is free at once */
	assert_true(join(3, address(3)));
}

static void test_the_network_leaves_places_for_local_peers_and_for_the_token(void **state)
{
	(void)state;
	for (int k = 0; k < 14; k++)
		assert_true(join(k, address(1 + (uint64_t)k)));
	assert_false(join(14, address(99)));
	assert_string_equal(text, "14 clients are connected — raise --max-clients");
	assert_true(join(15, user));
	assert_int_equal(take(16, address(99)), 0);
	lp_place_token(&connections[16], true);
	assert_null(lp_place_admit(&connections[16], &share, "wss", text, sizeof(text)));
	assert_int_equal(evicted, 0);
}

/* Two addresses fill everything; whoever comes from a third gets in all the same. */
static void test_who_has_most_makes_room(void **state)
{
	(void)state;
	for (int k = 0; k < 14; k++)
		assert_true(join(k, address(k % 2 ? 1 : 2)));
	for (int k = 14; k < 18; k++)
		assert_true(join(k, address(3)));
	assert_int_equal(evicted, 4);
	assert_false(join(18, address(3))); /* all have about as many */
	assert_int_equal(count(LP_PLACE_CLIENT), 14);
	for (int k = 20; k < 22; k++)
		assert_true(join(k, user));
}

static void test_refused_and_closing_connections_are_no_clients(void **state)
{
	(void)state;
	for (int k = 0; k < 300; k++) {
		(void)join(k, address(1));
		lp_clock_simulate(lp_clock_ns() + 10 * LP_NS_PER_MS);
	}
	assert_int_equal(count(LP_PLACE_CLIENT), 8);
	assert_int_equal(count(LP_PLACE_LEAVING), 8); /* of one address */
	for (int k = 300; k < 500; k++)
		(void)join(k, address((uint64_t)k));
	assert_true(count(LP_PLACE_LEAVING) <= LP_PLACES_LEAVING);
	assert_true(join(501, user));
}

/* Half-open handshakes of some addresses, for ever anew: nobody else waits. */
static void test_handshakes_make_room_for_those_of_others(void **state)
{
	(void)state;
	assert_int_equal(take(1000, address(99)), 0);
	lp_place_wait(&connections[1000]);
	for (int k = 0; k < 900; k++) {
		assert_int_equal(take(k, address((uint64_t)k % 6)), 0);
		lp_place_wait(&connections[k]);
		lp_clock_simulate(lp_clock_ns() + LP_NS_PER_MS);
	}
	assert_int_equal(count(LP_PLACE_NEW), LP_PLACES_NEW);
	assert_non_null(connections[1000].places); /* it has only one, and keeps it */
	assert_non_null(connections[899].places);  /* the oldest has gone */
	for (int k = 0; k < 400; k++)
		assert_null(connections[k].places);
	for (int k = 901; k < 990; k++) { /* one of each address: the oldest goes */
		assert_int_equal(take(k, address(1000 + (uint64_t)k)), 0);
		lp_place_wait(&connections[k]);
		assert_non_null(connections[k].places);
	}
}

static void test_an_ipv6_network_is_one_peer(void **state)
{
	struct lp_peer a = {.family = AF_INET6}, b = {.family = AF_INET6};
	const struct in6_addr address_a = {{{0x20, 1, 0xd, 0xb8, 0, 0, 0, 1}}};

	(void)state;
	memcpy(&a.id, &address_a, sizeof(a.id));
	b = a;
	for (int k = 0; k < 8; k++)
		assert_true(join(k, k % 2 ? a : b));
	assert_false(join(8, a));
	lp_peer_describe(&a, text, sizeof(text));
	assert_string_equal(text, "2001:db8:0:1::/64");
}

/* ---------------------------------------------------------------- what they do */

/* A flooder that is thrown out comes again at once: what it has used stays with its address. */
static void test_what_a_peer_may_use_is_not_by_connection(void **state)
{
	int requests = 0, connected = 0, turned_away = 0;

	(void)state;
	for (int k = 0; k < MOST; k++) {
		if (take(k, address(1)) < 0) {
			turned_away++;
			continue;
		}
		connected++;
		for (int n = 0; n < 50 && lp_place_charge(&connections[k], LP_COST_REQUEST_NS); n++)
			requests++;
		lp_place_give(&connections[k]);
		lp_clock_simulate(lp_clock_ns() + LP_NS_PER_MS);
	}
	/* 500 ms at first and 50 ms in this second, and each costs 200 us and 50 times 20 us. */
	assert_in_range(connected, 400, 500);
	assert_in_range(requests, 400 * 50, 500 * 50);
	assert_int_equal(turned_away, MOST - connected);
	assert_int_equal(take(0, address(2)), 0); /* another address */
	lp_clock_simulate(lp_clock_ns() + 21 * LP_NS_PER_S);
	assert_int_equal(take(1, address(1)), 0); /* and it, after a while */
}

/* Of an address that has used up its allowance those end that have used it. */
static void test_who_has_not_used_it_stays(void **state)
{
	(void)state;
	assert_true(join(0, address(1)) && join(1, address(1)));
	while (lp_place_charge(&connections[0], 100 * LP_COST_BYTE_NS)) {
	}
	for (int second = 0; second < 5; second++) {
		for (int n = 0; n < 60; n++)
			assert_true(lp_place_charge(&connections[1], LP_COST_REQUEST_NS));
		lp_clock_simulate(lp_clock_ns() + LP_NS_PER_S);
	}
}

/* Clients that draw 90 pictures a second, and one that changes its mind all the time. */
static void test_what_apps_do_is_no_flood(void **state)
{
	(void)state;
	for (int k = 0; k < 8; k++)
		assert_true(join(k, address(1)));
	for (int n = 0; n < 6000; n++) {
		assert_true(lp_place_charge(&connections[n % 8],
					    LP_COST_REQUEST_NS + 80 * LP_COST_BYTE_NS));
		lp_clock_simulate(lp_clock_ns() + LP_NS_PER_S / 750);
	}
	assert_int_equal(take(9, address(1)), 0);
}

static void test_wrong_tokens_take_longer_each_time(void **state)
{
	int tried = 0;

	(void)state;
	for (int ms = 0; ms < 100 * 1000; ms += 10) {
		lp_clock_simulate(lp_clock_ns() + 10 * LP_NS_PER_MS);
		assert_int_equal(take(0, address(1)), 0);
		const bool is_barred = lp_place_is_barred(&connections[0]);

		tried += !is_barred;
		assert_false(
			lp_place_token(&connections[0], is_barred)); /* the right one, too late */
		lp_place_give(&connections[0]);
		assert_int_equal(take(1, address(2)), 0); /* others do not wait */
		assert_true(lp_place_token(&connections[1], true));
		lp_place_give(&connections[1]);
	}
	assert_in_range(tried, 14, 24);
	lp_clock_simulate(lp_clock_ns() + 11 * LP_NS_PER_S);
	assert_int_equal(take(0, address(1)), 0);
	assert_true(lp_place_token(&connections[0], true)); /* all is forgiven */
	for (int k = 0; k < 8; k++)
		assert_false(lp_place_token(&connections[0], false));
	assert_true(lp_place_token(&connections[0], true));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_a_peer_has_its_share_of_all_publishers_together),
		TEST(test_a_publisher_has_its_share),
		TEST(test_the_network_leaves_places_for_local_peers_and_for_the_token),
		TEST(test_who_has_most_makes_room),
		TEST(test_refused_and_closing_connections_are_no_clients),
		TEST(test_handshakes_make_room_for_those_of_others),
		TEST(test_an_ipv6_network_is_one_peer),
		TEST(test_what_a_peer_may_use_is_not_by_connection),
		TEST(test_who_has_not_used_it_stays),
		TEST(test_what_apps_do_is_no_flood),
		TEST(test_wrong_tokens_take_longer_each_time),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
