/* SPDX-License-Identifier: Apache-2.0 */
/* Requests that concern the polarizer: pictures of how light is polarized, and sweeps. */
#include <errno.h>

#include "base/clock.h"
#include "include/packet.h"
#include "serve/codec/codec.h"
#include "serve/health.h"
#include "serve/hub_state.h"

/* All clients together get so many pictures: each costs the worker some milliseconds. */
#define PICTURE_PERIOD_NS (LP_NS_PER_S / 2)

void lp_hub_want_polarization(struct lp_hub *hub, struct lp_hub_client *client)
{
	if (hub->options.hello.polarization_map) {
		client->wants_polarization_map = true;
		return;
	}
	hub->options.health->report.requests_rejected++;
	lp_hub_refuse_request(hub, client, -EPERM, "polarization map",
			      "this probe gives no pictures — start lightprobed with "
			      "--publish-polarization and --polarizer=sweep");
}

void lp_hub_start_sweep(struct lp_hub *hub, struct lp_hub_client *client)
{
	const char *reason = "this probe has no polarizer wheel";
	uint64_t done_at = 0;
	const int ret = hub->options.sweep
				? hub->options.sweep(hub->options.context, &done_at, &reason)
				: -ENODEV;

	if (ret < 0) {
		hub->options.health->report.requests_rejected++;
		lp_hub_refuse_request(hub, client, ret, "sweep", reason);
		return;
	}
	struct lp_packet *packet = lp_packets_take(hub->packets);

	if (packet)
		lp_encode_sweep_started(done_at, packet);
	lp_hub_send_last(hub, client, packet);
}

static bool anybody_waits(const struct lp_hub *hub)
{
	bool waits = false;

	for (int i = 0; i < hub->client_count; i++)
		waits |= hub->clients[i]->wants_polarization_map;
	return waits;
}

bool lp_hub_polarization_is_due(const struct lp_hub *hub)
{
	const bool rested = !hub->polarization_map_ns ||
			    lp_clock_ns() - hub->polarization_map_ns >= PICTURE_PERIOD_NS;

	return rested && anybody_waits(hub);
}

void lp_hub_publish_polarization(struct lp_hub *hub, const struct lp_polarization_grid *grid)
{
	struct lp_packet *packet = NULL;

	if (anybody_waits(hub)) /* who did may have left */
		packet = lp_packets_take_picture(hub->packets);
	if (!packet)
		return;
	if (lp_encode_polarization(grid, hub->options.health->report.wheel.sweeps, packet) != 0) {
		lp_packet_drop(packet);
		return;
	}
	hub->polarization_map_ns = lp_clock_ns();
	for (int i = 0; i < hub->client_count; i++) {
		struct lp_hub_client *client = hub->clients[i];

		if (!client->wants_polarization_map)
			continue;
		client->wants_polarization_map = false;
		hub->options.health->report.polarization_maps_sent++;
		lp_hub_send_last(hub, client, lp_packet_hold(packet));
	}
	lp_packet_drop(packet);
}
