/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The ring of nine LDRs: sampled round robin at exact intervals, averaged over exactly one period
 * of the lamps' flicker (100 or 120 Hz), so that mains light does not beat. One ring a period:
 * LDRs follow the light no faster.
 *
 *   50 Hz mains: 8 scans of 10 slots of 125 us = 10.000 ms
 *   60 Hz mains: 7 scans of 10 slots of 119 us = 8.330 ms
 */
#ifndef RING_H
#define RING_H

#include <stdbool.h>
#include <stdint.h>

#include "board/board.h"

struct params;
struct safe;

#define RING_SLOTS 10
#define RING_FULL_SCALE 4092 /* level of the supply voltage */

/* What the ADC interrupt writes, and nobody else while it runs. */
struct ring_input {
	uint16_t sums[BOARD_LDRS];   /* of the window that is being filled */
	uint16_t window[BOARD_LDRS]; /* of the newest whole one */
	uint32_t t_us;		     /* its end */
	uint16_t feedback, supply;   /* newest, 10 bits */
	uint8_t scan;		     /* within the window */
	uint8_t windows;	     /* finished, modulo 256 */
	uint8_t feedbacks, supplies; /* conversions, modulo 256 */
};

struct ring {
	struct safe *safe;
	uint8_t window_scans;
	uint8_t slot_us;
	uint8_t windows_seen;
	uint8_t interval_scans;	     /* of the reports, as asked for; 0: none */
	uint8_t interval_windows;    /* the same in whole windows */
	uint8_t windows_due;	     /* until the next report */
	uint8_t extreme[BOARD_LDRS]; /* windows in a row in which it read open or shorted */
	uint16_t open, shorted;	     /* bit = sensor */
	uint16_t windows_missed;     /* because the main loop came late */
	uint16_t bandgap_mv, supply_min_mv;
	uint8_t supplies_seen, feedbacks_seen;
	uint8_t supply_low; /* readings in a row */
	uint16_t supply_cv; /* 0: not measured yet */
};

struct ring_report {
	uint32_t t_us; /* middle of the window */
	uint16_t levels[BOARD_LDRS];
};

/* At the start, and again when parameters have changed. The interval of the reports stays, and so
 * does what has been measured but not yet read, except for the window that is being filled. */
void ring_init(struct ring *ring, const struct params *params, struct safe *safe);

/* Reports every so many scans from now on, in whole windows, at least one; 0: none. */
void ring_set_interval(struct ring *ring, uint8_t scans);

/* Watches sensors and supply; true when a report is due, and is then in `report`. */
bool ring_poll(struct ring *ring, struct ring_report *report);

/* Newest feedback conversion, in levels of RING_FULL_SCALE; false when there was none since the
 * last call. */
bool ring_feedback(struct ring *ring, uint16_t *level);

static inline uint16_t ring_scan_us(const struct ring *ring)
{
	return RING_SLOTS * (uint16_t)ring->slot_us;
}

#endif
