/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/health.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/text.h"

#define WINDOW_NS (10 * LP_NS_PER_S)
#define BINS_PER_DOUBLING 8

/* Values below 8 have a bin each; above, eight bins to every doubling. */
static int bin_of(uint32_t value)
{
	int exponent;

	if (value < BINS_PER_DOUBLING)
		return (int)value;
	exponent = 31 - __builtin_clz(value) - 3;
	return exponent * BINS_PER_DOUBLING + (int)(value >> exponent);
}

/* The middle of a bin. */
static uint32_t value_of(int bin)
{
	const int exponent = bin < 2 * BINS_PER_DOUBLING ? 0 : bin / BINS_PER_DOUBLING - 1;
	const uint64_t first = (uint64_t)(bin - exponent * BINS_PER_DOUBLING) << exponent;

	return (uint32_t)(first + (((uint64_t)1 << exponent) >> 1));
}

void lp_histogram_add(struct lp_histogram *histogram, uint32_t value)
{
	histogram->bins[bin_of(value)]++;
	histogram->count++;
}

uint32_t lp_histogram_quantile(const struct lp_histogram *a, const struct lp_histogram *b,
			       double quantile)
{
	const uint64_t total = (uint64_t)a->count + b->count;
	const double wanted = quantile * (double)total;
	uint64_t seen = 0;

	for (int bin = 0; total && bin < LP_HISTOGRAM_BINS; bin++) {
		seen += a->bins[bin] + b->bins[bin];
		if (seen && (double)seen >= wanted)
			return value_of(bin);
	}
	return 0;
}

void lp_health_init(struct lp_health *health, int64_t now_ns)
{
	*health = (struct lp_health){.t_start_ns = now_ns,
				     .window_start_ns = now_ns,
				     .window_start_cpu_ns = lp_clock_cpu_ns()};
}

void lp_health_fault(struct lp_health *health, const char *id, const char *text)
{
	lp_health_camera_fault(health, id, 0, text);
}

void lp_health_camera_fault(struct lp_health *health, const char *id, int camera, const char *text)
{
	struct lp_health_report *report = &health->report;
	int at = 0;

	while (at < report->fault_count &&
	       (strcmp(report->faults[at].id, id) != 0 || report->faults[at].camera != camera))
		at++;
	if (text && at < LP_MAX_FAULTS) {
		report->faults[at].id = id;
		report->faults[at].camera = camera;
		lp_text_copy(report->faults[at].text, sizeof(report->faults[at].text), text);
		if (at == report->fault_count)
			report->fault_count++;
	} else if (!text && at < report->fault_count) {
		report->fault_count--;
		memmove(&report->faults[at], &report->faults[at + 1],
			(size_t)(report->fault_count - at) * sizeof(report->faults[0]));
	}
}

void lp_health_add_latency(struct lp_health *health, int64_t latency_ns)
{
	const int64_t latency_us = latency_ns / LP_NS_PER_US;

	lp_histogram_add(&health->latency_us[0], latency_us < 0		   ? 0
						 : latency_us > UINT32_MAX ? UINT32_MAX
									   : (uint32_t)latency_us);
}

/* Resident memory, from /proc; 0 where there is none. */
static uint32_t rss_kib(void)
{
	FILE *file = fopen("/proc/self/statm", "re");
	unsigned long pages = 0;

	if (!file)
		return 0;
	if (fscanf(file, "%*u %lu", &pages) != 1)
		pages = 0;
	(void)fclose(file);
	return (uint32_t)(pages * (unsigned long)sysconf(_SC_PAGESIZE) / 1024);
}

/* Over the window that runs. */
static void update_rates(struct lp_health *health, int64_t now_ns)
{
	struct lp_health_report *report = &health->report;
	const double elapsed_ns = (double)(now_ns - health->window_start_ns);
	const uint64_t estimates = report->estimates - health->window_start_estimates;
	const int64_t cpu_ns = lp_clock_cpu_ns() - health->window_start_cpu_ns;

	report->estimates_per_s = (float)((double)estimates * (double)LP_NS_PER_S / elapsed_ns);
	report->cpu_percent = (float)(100.0 * (double)cpu_ns / elapsed_ns);
}

void lp_health_tick(struct lp_health *health, int64_t now_ns)
{
	if (now_ns - health->window_start_ns < WINDOW_NS)
		return;
	update_rates(health, now_ns);
	health->window_start_ns = now_ns;
	health->window_start_cpu_ns = lp_clock_cpu_ns();
	health->window_start_estimates = health->report.estimates;
	health->latency_us[1] = health->latency_us[0];
	memset(&health->latency_us[0], 0, sizeof(health->latency_us[0]));
}

void lp_health_update(struct lp_health *health, int64_t now_ns)
{
	struct lp_health_report *report = &health->report;

	report->uptime_ms = (uint64_t)((now_ns - health->t_start_ns) / LP_NS_PER_MS);
	report->rss_kib = rss_kib();
	report->latency_p50_us =
		lp_histogram_quantile(&health->latency_us[0], &health->latency_us[1], 0.5);
	report->latency_p99_us =
		lp_histogram_quantile(&health->latency_us[0], &health->latency_us[1], 0.99);
	/* A window that has only begun says less than the one before. */
	if (now_ns - health->window_start_ns >= LP_NS_PER_S)
		update_rates(health, now_ns);
}
