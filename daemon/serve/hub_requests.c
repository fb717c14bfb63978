/* SPDX-License-Identifier: Apache-2.0 */
/* What clients ask of the hub, and how much of it they may. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "include/orientation.h"
#include "include/packet.h"
#include "serve/health.h"
#include "serve/hub_state.h"

#define SHORTEST_HEALTH_PERIOD_MS 100
/* A client that asks for more is thrown out: each request costs the loop a few microseconds, and
 * an app changes its mind far less often. */
#define MOST_REQUESTS_PER_S 50
/* Poses come as often as an app draws. What is beyond the first is left out, and who sends more
 * than the second is thrown out. */
#define MOST_POSES_PER_S 250
#define FLOOD_PER_S 2000

void lp_hub_refuse_request(struct lp_hub *hub, struct lp_hub_client *client, int code,
			   const char *what, const char *reason)
{
	char text[200];

	(void)snprintf(text, sizeof(text), "lightprobed: %s: %s", what, reason);
	lp_warning("hub", "request", "refused: %s", reason);
	lp_hub_send_error(hub, client, code, text);
}

static void begin_second(struct lp_hub_client *client)
{
	const int64_t now_ns = lp_clock_ns();

	if (now_ns - client->second_ns < LP_NS_PER_S)
		return;
	client->second_ns = now_ns;
	client->requests = client->poses = 0;
	client->pose_error_told = false;
}

/* Of more than one error in a second the first is told; the connection stays. */
static void refuse_pose(struct lp_hub *hub, struct lp_hub_client *client, int code,
			const char *reason)
{
	hub->options.health->report.requests_rejected++;
	if (!client->pose_error_told)
		lp_hub_refuse_request(hub, client, code, "pose", reason);
	client->pose_error_told = true;
}

void lp_hub_clock_fault(struct lp_hub *hub, struct lp_hub_client *client, const char *text)
{
	bool wrong = false;

	client->clock_is_wrong = text != NULL;
	for (int i = 0; i < hub->client_count; i++)
		wrong |= hub->clients[i]->clock_is_wrong;
	if (text || !wrong)
		lp_health_fault(hub->options.health, "orientation-clock", text);
}

/* The pose as a sample on our clock, for who uses it. */
static int use_pose(struct lp_hub *hub, struct lp_hub_client *client,
		    const struct lp_client_pose *pose)
{
	struct lp_orientation_sample sample;
	char fault[160];
	int ret;

	if (!hub->options.pose)
		return -EOPNOTSUPP;
	ret = lp_pose_sender_sample(&client->sender, pose, lp_clock_ns(), &sample, fault,
				    sizeof(fault));
	lp_hub_clock_fault(hub, client, ret < 0 ? fault : NULL);
	if (ret == 0)
		ret = hub->options.pose(hub->options.context, client, &sample);
	if (ret == -ESTALE && lp_pose_sender_is_in_order(&client->sender, pose))
		return 0; /* it is left out, and nobody's fault */
	if (ret >= 0)
		lp_pose_sender_counted(&client->sender, pose);
	return ret;
}

static void take_pose(struct lp_hub *hub, struct lp_hub_client *client,
		      const struct lp_client_pose *pose)
{
	const int ret = use_pose(hub, client, pose);

	client->poses_refused = ret == -EBUSY;
	if (ret == 1) { /* what is kept is in the world of another app */
		memset(&hub->last.raw.orientation, 0, sizeof(hub->last.raw.orientation));
		memset(&hub->last.smoothed.orientation, 0, sizeof(hub->last.smoothed.orientation));
	}
	if (ret < 0)
		refuse_pose(hub, client, ret, lp_pose_refusal(ret));
}

static void answer_ping(struct lp_hub *hub, struct lp_hub_client *client,
			const struct lp_client_ping *ping)
{
	struct lp_packet *packet = lp_packets_take(hub->packets);
	const struct lp_pong pong = lp_pose_sender_ping(&client->sender, ping, lp_clock_ns());

	if (packet)
		lp_encode_pong(&pong, packet);
	lp_hub_send_last(hub, client, packet);
}

/* Whether there are too many of this kind in this second: 0; 1: leave it out; -EDQUOT: it ends the
 * connection. Both are told. */
static int count_request(struct lp_hub *hub, struct lp_hub_client *client,
			 enum lp_request_kind kind)
{
	const int most = kind == LP_REQUEST_POSE ? FLOOD_PER_S : MOST_REQUESTS_PER_S;
	int *const count = kind == LP_REQUEST_POSE ? &client->poses : &client->requests;

	begin_second(client);
	if (++*count > most) {
		hub->options.health->report.requests_rejected++;
		lp_hub_refuse_request(
			hub, client, -EDQUOT, "requests",
			kind == LP_REQUEST_POSE
				? "more than 2000 poses in a second — send one per picture"
				: "more than 50 in a second — send a subscription only when "
				  "it changes");
		return -EDQUOT;
	}
	if (kind == LP_REQUEST_POSE && *count > MOST_POSES_PER_S) {
		refuse_pose(hub, client, -EDQUOT,
			    "more than 250 in a second; the others are left out — send one per "
			    "picture");
		return 1;
	}
	return 0;
}

/* Reflection maps are off, or smaller than wished. */
static void limit_reflection(struct lp_hub *hub, struct lp_hub_client *client)
{
	struct lp_reflection_wish *wish = &client->subscription.reflection;
	const int most = hub->options.hello.max_reflection_size;

	/* who says what it draws is told the error without a map */
	if (wish->size && !most && !client->no_reflection_told && !client->subscription.has_draws) {
		hub->options.health->report.requests_rejected++;
		lp_hub_refuse_request(
			hub, client, -EACCES, "reflection_map",
			"reflection maps are off, because they are pictures — start "
			"lightprobed with --reflection-map=32; everything else is sent");
		client->no_reflection_told = true;
	}
	if (wish->size > most)
		wish->size = most;
}

static void subscribe(struct lp_hub *hub, struct lp_hub_client *client,
		      const struct lp_subscription *subscription)
{
	client->subscription = *subscription;
	if (subscription->health_period_ms &&
	    subscription->health_period_ms < SHORTEST_HEALTH_PERIOD_MS)
		client->subscription.health_period_ms = SHORTEST_HEALTH_PERIOD_MS;
	limit_reflection(hub, client);
	client->subscribed = true;
}

/* A request that cannot be read, or that makes no sense. */
static int refuse_unread(struct lp_hub *hub, struct lp_hub_client *client, int code,
			 enum lp_request_kind kind, size_t size_bytes, const char *reason)
{
	char what[40];

	if (code == -ERANGE && kind == LP_REQUEST_POSE) {
		refuse_pose(hub, client, code, reason);
		return 0;
	}
	hub->options.health->report.requests_rejected++;
	(void)snprintf(what, sizeof(what), "request of %zu bytes", size_bytes);
	if (code != -EOPNOTSUPP || !client->unknown_told)
		lp_hub_refuse_request(hub, client, code, what, reason);
	client->unknown_told |= code == -EOPNOTSUPP;
	return code == -EOPNOTSUPP ? 0 : code; /* a newer client may go on without it */
}

static void take_stills(struct lp_hub *hub, struct lp_hub_client *client)
{
	const char *reason;
	const int cameras = hub->options.stills(hub->options.context, &reason);

	if (cameras < 0) {
		hub->options.health->report.requests_rejected++;
		lp_hub_refuse_request(hub, client, cameras, "stills", reason);
		return;
	}
	struct lp_packet *packet = lp_packets_take(hub->packets);

	if (packet)
		lp_encode_stills_asked((uint32_t)cameras, packet);
	lp_hub_send_last(hub, client, packet);
}

int lp_hub_on_request(void *context, void *user, const uint8_t *data, size_t size_bytes)
{
	struct lp_hub *hub = context;
	struct lp_hub_client *client = user;
	struct lp_request request;
	const char *reason;
	const int unread = lp_decode_request(data, size_bytes, &request, &reason);
	const int excess = count_request(hub, client, request.kind);

	if (excess)
		return excess < 0 ? excess : 0;
	if (unread < 0)
		return refuse_unread(hub, client, unread, request.kind, size_bytes, reason);
	switch (request.kind) {
	case LP_REQUEST_POSE:
		take_pose(hub, client, &request.pose);
		break;
	case LP_REQUEST_PING:
		answer_ping(hub, client, &request.ping);
		break;
	case LP_REQUEST_SUBSCRIBE:
		subscribe(hub, client, &request.subscription);
		break;
	case LP_REQUEST_POLARIZATION_MAP:
		lp_hub_want_polarization(hub, client);
		break;
	case LP_REQUEST_SWEEP:
		lp_hub_start_sweep(hub, client);
		break;
	case LP_REQUEST_STILLS:
		take_stills(hub, client);
		break;
	}
	return 0;
}

void lp_hub_on_requests_done(void *context, void *user)
{
	struct lp_hub *hub = context;

	lp_hub_answer_subscription(hub, user, lp_clock_ns());
	lp_packets_forget(hub->packets);
}

void lp_hub_on_unreadable(void *context, void *user, int code, const char *reason)
{
	struct lp_hub *hub = context;
	char text[160];

	hub->options.health->report.requests_rejected++;
	lp_warning("hub", "request", "refused: %s", reason);
	(void)snprintf(text, sizeof(text), "lightprobed: request: %s", reason);
	lp_hub_send_error(hub, user, code, text);
}
