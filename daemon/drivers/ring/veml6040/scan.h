/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Nine colour sensors VEML6040, which all have the same address, behind two multiplexers TCA9548A:
 * sensors 0 to 7 at the channels of the first one, sensor 8 at channel 0 of the second. Transfers
 * block for as long as the bus likes: all calls on a thread of their own (link/bus_thread.h).
 */
#ifndef LP_RING_VEML6040_SCAN_H
#define LP_RING_VEML6040_SCAN_H

#include <stdbool.h>
#include <stdint.h>

#include "include/ring_sample.h"

struct lp_veml6040_bus {
	int fd;	    /* of /dev/i2c-N; owned by the caller */
	int mux[2]; /* addresses */
};

/* Of one sensor. */
struct lp_veml6040 {
	bool is_set_up;
	int step;	    /* integration time: 40 ms << step */
	int64_t settled_ns; /* before this time its counts may be of another integration time */
	bool has_counts;    /* of this scan */
	uint16_t counts[3]; /* red, green, blue */
	int error;	    /* 0, or -errno of its last transfer */
};

struct lp_veml6040_scan {
	/* CLOCK_MONOTONIC: of the light, which is older than the scan. A sensor shows the mean over
	 * its last whole integration time. */
	int64_t t_ns;
	int step; /* integration time that all should have: 40 ms << step */
	struct lp_veml6040 sensors[LP_RING_SENSORS];
};

/* Read all nine, and choose the integration time for the next scan. Zeroed sensors are set
 * up first. 0, or -errno when no sensor could be reached: of the multiplexer. */
int lp_veml6040_scan(const struct lp_veml6040_bus *bus, struct lp_veml6040_scan *scan);

/* Lux of one count of green, and of red and blue as far as a white light goes. */
float lp_veml6040_lux_per_count(int step);

bool lp_veml6040_is_saturated(const struct lp_veml6040 *sensor);

#endif
