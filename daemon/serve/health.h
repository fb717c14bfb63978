/* SPDX-License-Identifier: Apache-2.0 */
/* How the daemon is doing: counters, rates over a window, latency, processor and memory. Loop
 * thread. */
#ifndef LP_SERVE_HEALTH_H
#define LP_SERVE_HEALTH_H

#include <stdbool.h>
#include <stdint.h>

#include "include/ring_sample.h"
#include "include/rotator.h"
#include "include/source.h"

#define LP_MAX_FAULTS 8
#define LP_HISTOGRAM_BINS 256

struct lp_fault {
	const char *id; /* docs/users/faults.md */
	int camera;	/* which of several it is of; 0 also where it is of none */
	char text[160];
};

struct lp_wheel_report {
	struct lp_wheel_state state;
	uint64_t moves;
	uint64_t sweeps; /* rounds of all angles that are over */
	uint64_t frames_stamped, frames_moving, frames_unknown;
};

struct lp_ring_report {
	float illuminance_lux[LP_RING_SENSORS]; /* NAN: not usable */
	float samples_per_s;
	uint64_t samples, samples_lost;
};

/* A snapshot, as it goes to clients. */
struct lp_health_report {
	uint64_t uptime_ms;
	enum lp_source_state source_state; /* 0: not known yet */
	uint64_t frames_received, frames_dropped, frames_rejected, source_reconnects;
	uint64_t estimates;
	float estimates_per_s;
	uint32_t latency_p50_us, latency_p99_us; /* frame arrival to packet handed out */
	uint32_t clients;
	uint64_t packets_sent, packets_superseded, requests_rejected;
	uint64_t polarization_maps_sent;
	uint32_t places_left_out; /* of the pictures: they shine by themselves */
	float cpu_percent;	  /* of one core */
	uint32_t rss_kib;
	const char *preset;
	bool has_wheel, has_ring;
	struct lp_wheel_report wheel;
	struct lp_ring_report ring;
	int fault_count;
	struct lp_fault faults[LP_MAX_FAULTS];
};

/* Logarithmic bins, eight to a doubling: a quantile is right within 6 %. */
struct lp_histogram {
	uint32_t bins[LP_HISTOGRAM_BINS];
	uint32_t count;
};

void lp_histogram_add(struct lp_histogram *histogram, uint32_t value);

/* Value below which the share `quantile` of all values lies; 0 when there are none. */
uint32_t lp_histogram_quantile(const struct lp_histogram *a, const struct lp_histogram *b,
			       double quantile);

/* Counters are written by whoever counts; the rest is kept by the functions below. */
struct lp_health {
	struct lp_health_report report;

	int64_t t_start_ns;
	int64_t window_start_ns, window_start_cpu_ns;
	uint64_t window_start_estimates;
	struct lp_histogram latency_us[2]; /* this window's and the one before */
};

void lp_health_init(struct lp_health *health, int64_t now_ns);

/* A fault by its name (static), or its end (`text` NULL). Of more than LP_MAX_FAULTS at once the
 * last ones are left out; the log has them. */
void lp_health_fault(struct lp_health *health, const char *id, const char *text);

/* The same of one of several cameras: each has faults of its own. */
void lp_health_camera_fault(struct lp_health *health, const char *id, int camera, const char *text);
void lp_health_add_latency(struct lp_health *health, int64_t latency_ns);

/* Call it several times a second, whether anybody listens or not: rates are of the last ten
 * seconds, not of the time since somebody asked. */
void lp_health_tick(struct lp_health *health, int64_t now_ns);

/* Bring the derived values of `report` up to date, to be sent. */
void lp_health_update(struct lp_health *health, int64_t now_ns);

#endif
