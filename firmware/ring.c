/* SPDX-License-Identifier: Apache-2.0 */
#include "ring.h"

#include <string.h>

#include "params.h"
#include "safe.h"

/*
 * Sensor at the supply, 3.3 kohm to ground. Open: not one count in a whole window. That is also
 * what an LDR in the dark reads (beyond 3 Mohm), so it counts only while another sensor sees 1 lx
 * or so. Shorted: the full scale in every conversion; an LDR in the midday sun (16 ohm) stays four
 * counts below.
 */
#define OPEN_BELOW 2
#define LIT_FROM 250
#define SHORTED_FROM 4090
#define DEAD_AFTER_LOOKS 10

#define SUPPLY_LOW_AFTER 20 /* readings in a row: 50 ms */

/* The only state that an interrupt shares with the portable code. */
static volatile struct ring_input input;
static uint8_t input_window;

static void finish_scan(void)
{
	input.t_us = board_time_us();
	input.scans++;
	if (++input.scan == input_window)
		input.scan = 0;
	if (input.filled < input_window)
		input.filled++;
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
	volatile uint16_t *oldest = &input.history[input.scan][slot];
	input.sums[slot] += level - *oldest;
	*oldest = level;
	if (slot == BOARD_LDRS - 1)
		finish_scan();
}

void ring_init(struct ring *ring, const struct params *params, struct safe *safe)
{
	bool mains_60 = param(params, PARAM_MAINS_HZ) >= 55;

	ring->safe = safe;
	ring->window_scans = mains_60 ? 7 : 8;
	ring->slot_us = mains_60 ? 119 : 125;
	ring->bandgap_mv = param(params, PARAM_BANDGAP_MV);
	ring->supply_min_mv = param(params, PARAM_SUPPLY_MIN_MV);
	board_lock();
	memset((void *)&input, 0, sizeof(input));
	input_window = ring->window_scans;
	ring->scans_seen = 0;
	board_unlock();
	board_sample(ring->slot_us);
}

void ring_set_interval(struct ring *ring, uint8_t scans)
{
	ring->interval_scans = scans;
	ring->scans_due = scans;
}

/* Copies the window; levels are its mean in units of a quarter count. */
static bool read_window(const struct ring *ring, struct ring_report *report)
{
	board_lock();
	bool filled = input.filled == ring->window_scans;
	report->t_us = input.t_us;
	for (uint8_t i = 0; i < BOARD_LDRS; i++)
		report->levels[i] = input.sums[i];
	board_unlock();

	report->t_us -= ring_scan_us(ring) / 2 * ring->window_scans;
	for (uint8_t i = 0; i < BOARD_LDRS; i++)
		report->levels[i] =
			(report->levels[i] * 4 + ring->window_scans / 2) / ring->window_scans;
	return filled;
}

static void watch_sensors(struct ring *ring, const uint16_t *levels)
{
	uint16_t brightest = 0;

	for (uint8_t i = 0; i < BOARD_LDRS; i++) {
		if (levels[i] < SHORTED_FROM && levels[i] > brightest)
			brightest = levels[i];
	}
	for (uint8_t i = 0; i < BOARD_LDRS; i++) {
		uint16_t mask = (uint16_t)1 << i;
		bool open = levels[i] < OPEN_BELOW && brightest >= LIT_FROM;
		bool shorted = levels[i] >= SHORTED_FROM;

		if (!open && !shorted) {
			ring->extreme[i] = 0;
			ring->open &= ~mask;
			ring->shorted &= ~mask;
		} else if (ring->extreme[i] < DEAD_AFTER_LOOKS) {
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

bool ring_poll(struct ring *ring, struct ring_report *report)
{
	bool due = false;

	board_lock();
	uint8_t scans = input.scans - ring->scans_seen;
	board_unlock();
	if (scans == 0)
		return false;
	ring->scans_seen += scans;
	watch_supply(ring);

	if (ring->interval_scans) {
		if (scans >= ring->scans_due) {
			due = true;
			uint8_t late = scans - ring->scans_due;
			ring->scans_missed += late / ring->interval_scans;
			ring->scans_due = ring->interval_scans - late % ring->interval_scans;
		} else {
			ring->scans_due -= scans;
		}
	}
	bool health = scans >= ring->health_due;
	ring->health_due = health ? ring->window_scans : ring->health_due - scans;
	if (!due && !health)
		return false;
	if (!read_window(ring, report))
		return false;
	if (health)
		watch_sensors(ring, report->levels);
	return due;
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
