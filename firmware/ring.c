/* SPDX-License-Identifier: Apache-2.0 */
#include "ring.h"

#include <string.h>

#include "params.h"
#include "safe.h"

/*
 * Sensor and multiplexer from the supply, 3.3 kohm to ground.
 *
 * Open: within the ADC's offset (2 counts) of nothing, while another sensor sees 10 lx or more. In
 * the dark an LDR reads the same, so with all of them in the dark nothing is said.
 *
 * Shorted: only the multiplexer is left (160 ohm at most), while the sensors beside it see less
 * than 1000 lx. Alone, the reading would be sunlight; but the sun is seen by neighbours too.
 */
#define OPEN_BELOW 12
#define LIT_FROM 780
#define SHORTED_FROM 3900
#define SUNLIT_FROM 3425
#define DEAD_AFTER_WINDOWS 100

#define RING_AROUND 8 /* sensors on the equator; the others look up and are beside them all */

#define SUPPLY_LOW_AFTER 20 /* readings in a row: 50 ms */

/* The only state that an interrupt shares with the portable code. What it counts is written by the
 * interrupt alone and never set back: the readers would take that for news. */
static volatile struct ring_input input;
static uint8_t input_window;

static void finish_window(void)
{
	input.t_us = board_time_us();
	input.scan = 0;
	input.windows++;
	for (uint8_t i = 0; i < BOARD_LDRS; i++) {
		input.window[i] = input.sums[i];
		input.sums[i] = 0;
	}
}

void board_on_conversion(uint8_t slot, uint16_t level)
{
	if (slot == BOARD_SLOT_FEEDBACK) {
		input.feedback = level;
		input.feedbacks++;
		return;
	}
	if (slot == BOARD_SLOT_SUPPLY) {
		input.supply = level;
		input.supplies++;
		return;
	}
	input.sums[slot] += level;
	if (slot == BOARD_LDRS - 1 && ++input.scan == input_window)
		finish_window();
}

void ring_init(struct ring *ring, const struct params *params, struct safe *safe)
{
	bool mains_60 = param(params, PARAM_MAINS_HZ) >= 55;

	ring->safe = safe;
	ring->window_scans = mains_60 ? 7 : 8;
	ring->slot_us = mains_60 ? 119 : 125;
	ring->bandgap_mv = param(params, PARAM_BANDGAP_MV);
	ring->supply_min_mv = param(params, PARAM_SUPPLY_MIN_MV);
	ring_set_interval(ring, ring->interval_scans);
	board_lock();
	/* The window that is being filled begins anew, with its first slot. */
	memset((void *)input.sums, 0, sizeof(input.sums));
	input.scan = 0;
	input_window = ring->window_scans;
	ring->windows_seen = input.windows;
	board_sample(ring->slot_us);
	board_unlock();
}

void ring_set_interval(struct ring *ring, uint8_t scans)
{
	ring->interval_scans = scans;
	ring->interval_windows = scans / ring->window_scans;
	if (scans && !ring->interval_windows)
		ring->interval_windows = 1;
	ring->windows_due = ring->interval_windows;
}

/* Copies the newest window; levels are its mean in units of a quarter count. */
static void read_window(const struct ring *ring, struct ring_report *report)
{
	board_lock();
	report->t_us = input.t_us;
	for (uint8_t i = 0; i < BOARD_LDRS; i++)
		report->levels[i] = input.window[i];
	board_unlock();

	report->t_us -= ring_scan_us(ring) / 2 * ring->window_scans;
	for (uint8_t i = 0; i < BOARD_LDRS; i++)
		report->levels[i] =
			(report->levels[i] * 4 + ring->window_scans / 2) / ring->window_scans;
}

static bool beside(uint8_t one, uint8_t other)
{
	if (one >= RING_AROUND || other >= RING_AROUND)
		return true;
	uint8_t apart = (one - other) & (RING_AROUND - 1);
	return apart == 1 || apart == RING_AROUND - 1;
}

/* The brightest of the other sensors; of all, or of those beside it. */
static uint16_t brightest_other(const uint16_t *levels, uint8_t sensor, bool only_beside)
{
	uint16_t brightest = 0;

	for (uint8_t i = 0; i < BOARD_LDRS; i++) {
		if (i != sensor && levels[i] > brightest && (!only_beside || beside(i, sensor)))
			brightest = levels[i];
	}
	return brightest;
}

static void watch_sensors(struct ring *ring, const uint16_t *levels)
{
	for (uint8_t i = 0; i < BOARD_LDRS; i++) {
		uint16_t mask = (uint16_t)1 << i;
		bool open = levels[i] < OPEN_BELOW && brightest_other(levels, i, false) >= LIT_FROM;
		bool shorted =
			levels[i] >= SHORTED_FROM && brightest_other(levels, i, true) < SUNLIT_FROM;

		if (!open && !shorted) {
			ring->extreme[i] = 0;
			ring->open &= ~mask;
			ring->shorted &= ~mask;
		} else if (ring->extreme[i] < DEAD_AFTER_WINDOWS) {
			ring->extreme[i]++;
		} else if (open) {
			ring->open |= mask;
		} else {
			ring->shorted |= mask;
		}
	}
	if (ring->open)
		safe_latch(ring->safe, FAULT_LDR_OPEN, ring->open);
	if (ring->shorted)
		safe_latch(ring->safe, FAULT_LDR_SHORTED, ring->shorted);
}

/* The supply from the reference read against it. */
static void watch_supply(struct ring *ring)
{
	board_lock();
	uint8_t supplies = input.supplies;
	uint16_t level = input.supply;
	board_unlock();

	if (supplies == ring->supplies_seen || level == 0)
		return;
	ring->supplies_seen = supplies;
	uint32_t supply_mv = (uint32_t)ring->bandgap_mv * 1023 / level;
	ring->supply_cv = supply_mv / 10 > 1023 ? 1023 : supply_mv / 10;
	if (supply_mv >= ring->supply_min_mv)
		ring->supply_low = 0;
	else if (ring->supply_low < SUPPLY_LOW_AFTER)
		ring->supply_low++;
	else
		safe_latch(ring->safe, FAULT_SUPPLY_LOW, supply_mv);
}

/* Counts windows against the interval of the reports: whether one is due. */
static bool report_due(struct ring *ring, uint8_t windows)
{
	if (ring->interval_windows == 0)
		return false;
	if (windows < ring->windows_due) {
		ring->windows_due -= windows;
		return false;
	}
	uint8_t late = windows - ring->windows_due;
	ring->windows_missed += late / ring->interval_windows;
	ring->windows_due = ring->interval_windows - late % ring->interval_windows;
	return true;
}

bool ring_poll(struct ring *ring, struct ring_report *report)
{
	watch_supply(ring);
	board_lock();
	uint8_t windows = input.windows - ring->windows_seen;
	board_unlock();
	if (windows == 0)
		return false;
	ring->windows_seen += windows;
	read_window(ring, report);
	watch_sensors(ring, report->levels);
	return report_due(ring, windows);
}

bool ring_feedback(struct ring *ring, uint16_t *level)
{
	board_lock();
	uint8_t feedbacks = input.feedbacks;
	uint16_t newest = input.feedback;
	board_unlock();
	if (feedbacks == ring->feedbacks_seen)
		return false;
	ring->feedbacks_seen = feedbacks;
	*level = newest * 4;
	return true;
}
