/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What every gyroscope needs, whatever it is read through: its offset (the rate that it tells at
 * rest), its noise, and how it sits in its device. Plain data, no I/O.
 */
#ifndef LP_DRIVERS_GYRO_H
#define LP_DRIVERS_GYRO_H

#include <stdbool.h>
#include <stdint.h>

/*
 * The offset is measured whenever the gyroscope is at rest: for a second no rate has changed by
 * more than noise does. A turn as slow and as even as that, under 1 degree per second, looks the
 * same. Zeroed is a new one, which knows nothing.
 */
struct lp_gyro {
	double offset_rad_s[3];
	double sigma_rad_s; /* 1 sigma about each axis of rates less the offset; 0: none yet */
	bool is_known;	    /* it has been at rest */
	/* The stretch of time that is looked at. */
	int64_t t_begin_ns;
	uint32_t count;
	double sum[3], square_sum[3];
};

/*
 * Take a rate as the sensor tells it, and leave in `rate_rad_s` the rate without offset.
 * gyro->sigma_rad_s is then its sigma: with an offset that is not known yet it is large. Times must
 * grow. False: the rate is not finite; nothing has changed.
 */
bool lp_gyro_rate(struct lp_gyro *gyro, int64_t t_ns, double rate_rad_s[3]);

/*
 * Read a mount matrix as Linux IIO gives it ("1, 0, 0; 0, 1, 0; 0, 0, 1"): it turns vectors of the
 * sensor into those of the device. -EINVAL: these are not nine numbers, or no rotation.
 */
int lp_gyro_parse_mount(const char *text, double matrix[3][3]);

#endif
