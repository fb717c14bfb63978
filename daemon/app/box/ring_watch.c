/* SPDX-License-Identifier: Apache-2.0 */
#include "app/box/ring_watch.h"

#include <stdio.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/text.h"
#include "include/light_estimate.h"
#include "serve/health.h"

/* A hand in front of a sensor, or one odd frame, is no fault of the ring. */
#define LASTS_NS (1 * LP_NS_PER_S)

#define SENSOR_WRONG "ring-sensor-wrong"
#define TURNED "ring-turned"
#define DISAGREES "ring-disagrees"
#define SCALE "ring-scale"
#define COVERED "lens-covered"

static const char *const ids[] = {
	[LP_RING_WATCH_SENSORS] = SENSOR_WRONG, [LP_RING_WATCH_TURNED] = TURNED,
	[LP_RING_WATCH_DISAGREES] = DISAGREES,	[LP_RING_WATCH_SCALE] = SCALE,
	[LP_RING_WATCH_COVERED] = COVERED,
};

static void describe(int what, const struct lp_ring_status *status, char *text, size_t size_bytes)
{
	char sensors[32];

	switch (what) {
	case LP_RING_WATCH_SENSORS:
		lp_text_list_bits(sensors, sizeof(sensors), status->wrong);
		(void)snprintf(
			text, size_bytes,
			"ring: compare: sensor %s contradicts the camera and the others; left "
			"out — is it covered? lightprobe calibrate ring",
			sensors);
		break;
	case LP_RING_WATCH_TURNED:
		(void)snprintf(
			text, size_bytes,
			"ring: compare: turned by %.0f degrees to the %s against the camera; read "
			"so — mount it as the guide shows",
			(double)(status->turned_deg < 0 ? -status->turned_deg : status->turned_deg),
			status->turned_deg < 0 ? "left" : "right");
		break;
	case LP_RING_WATCH_DISAGREES:
		(void)snprintf(
			text, size_bytes,
			"ring: compare: it does not show the light that the camera sees; not "
			"used — does it stand beside the camera, and is it calibrated?");
		break;
	case LP_RING_WATCH_COVERED:
		(void)snprintf(
			text, size_bytes,
			"camera: compare: its picture is black where the ring reads %.0f lx — is "
			"the lens covered, or the exposure too short? Light is the ring's alone",
			(double)status->mean_lux);
		break;
	default:
		(void)snprintf(
			text, size_bytes,
			"ring: compare: the scale given is wrong: about %.4g cd/m2 per unit — "
			"run lightprobe calibrate scale",
			(double)status->scale.lux_per_unit);
	}
}

static bool is_so(int what, const struct lp_ring_status *status)
{
	switch (what) {
	case LP_RING_WATCH_SENSORS:
		return status->wrong != 0;
	case LP_RING_WATCH_TURNED:
		return status->verdict == LP_RING_TURNED;
	case LP_RING_WATCH_DISAGREES:
		return status->verdict == LP_RING_DISAGREES;
	case LP_RING_WATCH_COVERED:
		return status->camera_is_blind;
	default:
		return status->scale_is_wrong;
	}
}

uint32_t lp_ring_watch_once(const struct lp_ring_status *status)
{
	for (int i = 0; i < LP_RING_WATCH_COVERED; i++)
		if (status->fused && is_so(i, status))
			return LP_ESTIMATE_RING_FAULT;
	return 0;
}

uint32_t lp_ring_watch_update(struct lp_ring_watch *watch, const struct lp_ring_status *status,
			      struct lp_health *health, int64_t now_ns)
{
	uint32_t flags = 0;
	char text[160];

	for (int i = 0; i < LP_RING_WATCHED; i++) {
		const bool so = (status->fused || i == LP_RING_WATCH_COVERED) && is_so(i, status);

		if (so != watch->list[i].now)
			watch->list[i].since_ns = now_ns;
		watch->list[i].now = so;
		const bool lasts = now_ns - watch->list[i].since_ns >= LASTS_NS;
		const bool other =
			i == LP_RING_WATCH_SENSORS && so && watch->wrong != status->wrong;

		if (so && lasts && (!watch->list[i].told || other)) {
			describe(i, status, text, sizeof(text));
			if (!watch->list[i].told)
				lp_warning("ring", "compare", "%s", text);
			lp_health_fault(health, ids[i], text);
			watch->list[i].told = true;
			watch->wrong = status->wrong;
		} else if (!so && lasts && watch->list[i].told) {
			lp_health_fault(health, ids[i], NULL);
			watch->list[i].told = false;
		}
		if (watch->list[i].told && i != LP_RING_WATCH_COVERED)
			flags = LP_ESTIMATE_RING_FAULT;
	}
	return flags;
}
