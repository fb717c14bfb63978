/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/places.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>

#include "base/clock.h"
#include "base/log.h"
#include "drivers/publisher/share.h"

#define NEW_PER_PEER 32
#define LEAVING_PER_PEER 8
#define IDLE_GUESTS 256 /* remembered besides those that are here */
#define TRUSTED_SHARE 8 /* one place in so many */

/* An allowance grows by this share of all time, up to the longest, and never falls below the least.
 */
#define ALLOWANCE_SHARE 20
#define MOST_ALLOWANCE_NS (500 * LP_NS_PER_MS)
#define LEAST_ALLOWANCE_NS (-LP_NS_PER_S)
#define TURNED_AWAY_NS (20 * LP_NS_PER_US)

#define FREE_WRONG_TOKENS 8
#define LONGEST_BAR_S 10
#define FORGIVEN_NS (60 * LP_NS_PER_S)

struct lp_guest {
	struct lp_peer peer;
	int counts[LP_PLACE_PHASES], all;
	int64_t allowance_ns, t_ns; /* of the allowance; 0: nobody is here */
	int wrong_tokens;
	int64_t wrong_ns, barred_until_ns;
	int64_t warned_ns;
	int turned_away; /* since */
};

struct lp_places {
	int max_clients, reserved;
	int counts[LP_PLACE_PHASES], untrusted;
	struct lp_place *oldest[LP_PLACE_PHASES], *newest[LP_PLACE_PHASES];
	int guest_count;
	struct lp_guest guests[];
};

/* ---------------------------------------------------------------- guests */

static void refill(struct lp_guest *guest)
{
	const int64_t now_ns = lp_clock_ns();

	guest->allowance_ns += (now_ns - guest->t_ns) / ALLOWANCE_SHARE;
	guest->t_ns = now_ns;
	if (guest->allowance_ns > MOST_ALLOWANCE_NS)
		guest->allowance_ns = MOST_ALLOWANCE_NS;
}

static void spend(struct lp_guest *guest, int64_t cost_ns)
{
	guest->allowance_ns -= cost_ns;
	if (guest->allowance_ns < LEAST_ALLOWANCE_NS)
		guest->allowance_ns = LEAST_ALLOWANCE_NS;
}

/* The peer's, as it was left or a new one in the place of that seen longest ago. There are more
 * than there can be connections. */
static struct lp_guest *find_guest(struct lp_places *places, const struct lp_peer *peer)
{
	struct lp_guest *oldest = NULL;

	for (int i = 0; i < places->guest_count; i++) {
		struct lp_guest *guest = &places->guests[i];

		if (guest->t_ns && lp_peer_is_same(&guest->peer, peer))
			return guest;
		if (!guest->all && (!oldest || guest->t_ns < oldest->t_ns))
			oldest = guest;
	}
	if (oldest)
		*oldest = (struct lp_guest){.peer = *peer,
					    .allowance_ns = MOST_ALLOWANCE_NS,
					    .t_ns = lp_clock_ns()};
	return oldest;
}

static struct lp_guest *largest_guest(struct lp_places *places, enum lp_place_phase phase)
{
	struct lp_guest *largest = &places->guests[0];

	for (int i = 1; i < places->guest_count; i++)
		if (places->guests[i].counts[phase] > largest->counts[phase])
			largest = &places->guests[i];
	return largest;
}

/* Also this takes time: not more often than once a second. */
static void warn(struct lp_guest *guest, const char *why)
{
	char text[64];

	guest->turned_away++;
	if (guest->warned_ns && lp_clock_ns() - guest->warned_ns < LP_NS_PER_S)
		return;
	lp_peer_describe(&guest->peer, text, sizeof(text));
	lp_warning("clients", "limit", "%s: %s (turned away: %d)", text, why, guest->turned_away);
	guest->warned_ns = lp_clock_ns();
	guest->turned_away = 0;
}

/* ---------------------------------------------------------------- the lists */

static void enlist(struct lp_place *place, enum lp_place_phase phase)
{
	struct lp_places *places = place->places;

	place->phase = phase;
	place->newer = NULL;
	place->older = places->newest[phase];
	if (place->older)
		place->older->newer = place;
	else
		places->oldest[phase] = place;
	places->newest[phase] = place;
	places->counts[phase]++;
	place->guest->counts[phase]++;
}

static void delist(struct lp_place *place)
{
	struct lp_places *places = place->places;

	if (place->older)
		place->older->newer = place->newer;
	else
		places->oldest[place->phase] = place->newer;
	if (place->newer)
		place->newer->older = place->older;
	else
		places->newest[place->phase] = place->older;
	places->counts[place->phase]--;
	place->guest->counts[place->phase]--;
	if (place->phase == LP_PLACE_CLIENT) {
		places->untrusted -= !place->trusted;
		place->share->taken--;
	}
}

static void move(struct lp_place *place, enum lp_place_phase phase)
{
	delist(place);
	enlist(place, phase);
}

static void evict_oldest(struct lp_places *places, const struct lp_guest *guest,
			 enum lp_place_phase phase, const struct lp_place *but)
{
	struct lp_place *place = places->oldest[phase];

	while (place && (place->guest != guest || place == but))
		place = place->newer;
	if (place)
		place->evict(place);
}

/* The peer has no more than its part of the places of a phase, and all together no more than there
 * are. */
static void make_room(struct lp_place *place, int per_peer, int all)
{
	struct lp_places *places = place->places;
	const enum lp_place_phase phase = place->phase;
	struct lp_guest *guest = place->guest;

	if (guest->counts[phase] <= per_peer && places->counts[phase] <= all)
		return;
	if (guest->counts[phase] <= per_peer)
		guest = largest_guest(places, phase);
	if (phase == LP_PLACE_NEW)
		warn(guest, "it has too many handshakes under way; the oldest end");
	evict_oldest(places, guest, phase, place);
}

/* ---------------------------------------------------------------- coming and going */

int lp_place_take(struct lp_places *places, struct lp_place *place, const struct lp_peer *peer,
		  int64_t cost_ns, void (*evict)(struct lp_place *place))
{
	struct lp_guest *guest = find_guest(places, peer);

	if (!guest)
		return -EUSERS;
	refill(guest);
	if (guest->allowance_ns < 0) {
		spend(guest, TURNED_AWAY_NS);
		warn(guest,
		     "it has connected, or sent, far more than an app does — what runs there?");
		return -EUSERS;
	}
	spend(guest, cost_ns);
	guest->all++;
	*place = (struct lp_place){.places = places,
				   .guest = guest,
				   .evict = evict,
				   .trusted = peer->family == AF_UNIX};
	enlist(place, LP_PLACE_NEW);
	return 0;
}

void lp_place_wait(struct lp_place *place)
{
	make_room(place, NEW_PER_PEER, LP_PLACES_NEW);
}

/* A place for one more client; true: there is, maybe after another has made room. */
static bool find_room(struct lp_place *place)
{
	struct lp_places *places = place->places;
	struct lp_guest *largest;

	if (places->counts[LP_PLACE_CLIENT] < places->max_clients &&
	    (place->trusted || places->untrusted < places->max_clients - places->reserved))
		return true;
	largest = largest_guest(places, LP_PLACE_CLIENT);
	if (largest->counts[LP_PLACE_CLIENT] <= place->guest->counts[LP_PLACE_CLIENT] + 1)
		return false;
	for (struct lp_place *other = places->newest[LP_PLACE_CLIENT]; other;
	     other = other->older) {
		if (other->guest == largest && (place->trusted || !other->trusted)) {
			warn(largest, "all places are taken, and it has most of them");
			other->evict(other);
			return true;
		}
	}
	return false;
}

const char *lp_place_admit(struct lp_place *place, struct lp_share *share, const char *scheme,
			   char *text, size_t size_bytes)
{
	const char *const kind = place->guest->peer.family == AF_UNIX ? "user" : "address";
	const char *refusal = lp_share_refusal(share, scheme, place->guest->counts[LP_PLACE_CLIENT],
					       kind, text, size_bytes);

	if (!refusal && !find_room(place)) {
		(void)snprintf(text, size_bytes, "%d clients are connected — raise --max-clients",
			       place->places->counts[LP_PLACE_CLIENT]);
		refusal = text;
	}
	if (refusal) {
		lp_place_leave(place);
		return refusal;
	}
	move(place, LP_PLACE_CLIENT);
	place->share = share;
	share->taken++;
	place->places->untrusted += !place->trusted;
	return NULL;
}

void lp_place_leave(struct lp_place *place)
{
	if (!place->places || place->phase == LP_PLACE_LEAVING)
		return;
	move(place, LP_PLACE_LEAVING);
	make_room(place, LEAVING_PER_PEER, LP_PLACES_LEAVING);
}

void lp_place_give(struct lp_place *place)
{
	if (!place->places)
		return;
	delist(place);
	place->guest->all--;
	place->places = NULL;
}

/* ---------------------------------------------------------------- what it costs */

bool lp_place_charge(struct lp_place *place, int64_t cost_ns)
{
	struct lp_guest *guest = place->guest;

	if (!place->places)
		return false;
	refill(guest);
	spend(guest, cost_ns);
	if (guest->t_ns - place->second_ns >= LP_NS_PER_S) {
		place->second_ns = guest->t_ns;
		place->used_ns = 0;
	}
	place->used_ns += cost_ns;
	if (guest->allowance_ns >= 0 ||
	    place->used_ns <= LP_NS_PER_S / ALLOWANCE_SHARE / guest->all)
		return true;
	warn(guest, "it has connected, or sent, far more than an app does — what runs there?");
	return false;
}

bool lp_place_is_barred(const struct lp_place *place)
{
	return lp_clock_ns() < place->guest->barred_until_ns;
}

static void count_wrong_token(struct lp_guest *guest)
{
	const int64_t now_ns = lp_clock_ns();
	int64_t bar_s = 1;

	if (now_ns - guest->wrong_ns > FORGIVEN_NS)
		guest->wrong_tokens = 0;
	guest->wrong_ns = now_ns;
	if (++guest->wrong_tokens <= FREE_WRONG_TOKENS)
		return;
	for (int k = FREE_WRONG_TOKENS + 1; k < guest->wrong_tokens && bar_s < LONGEST_BAR_S; k++)
		bar_s *= 2;
	guest->barred_until_ns =
		now_ns + LP_NS_PER_S * (bar_s < LONGEST_BAR_S ? bar_s : LONGEST_BAR_S);
	warn(guest, "it has sent wrong tokens; none of its tokens counts for some seconds");
}

bool lp_place_token(struct lp_place *place, bool is_right)
{
	if (lp_place_is_barred(place))
		return false;
	if (is_right)
		place->guest->wrong_tokens = 0;
	else
		count_wrong_token(place->guest);
	place->trusted |= is_right;
	return is_right;
}

/* ---------------------------------------------------------------- life */

struct lp_places *lp_places_create(int max_clients)
{
	const int count = max_clients + LP_PLACES_NEW + LP_PLACES_LEAVING + IDLE_GUESTS;
	struct lp_places *places =
		calloc(1, sizeof(*places) + (size_t)count * sizeof(places->guests[0]));

	if (!places)
		return NULL;
	places->max_clients = max_clients;
	places->reserved = max_clients / TRUSTED_SHARE;
	places->guest_count = count;
	return places;
}

void lp_places_destroy(struct lp_places *places)
{
	free(places);
}
