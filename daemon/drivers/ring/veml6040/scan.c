/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/ring/veml6040/scan.h"

#include <errno.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <sys/ioctl.h>
#include <time.h>

#include "base/clock.h"

/* Vishay's data sheet of the VEML6040 (84276): address, registers, integration times, and lux of a
 * count of green at 40 ms. */
#define ADDRESS 0x10
#define CONF 0x00
#define RED 0x08
#define IT_SHIFT 4
#define FIRST_IT_NS (40 * LP_NS_PER_MS)
#define LUX_PER_COUNT 0.25168F
#define FULL_SCALE 65535

/* 80 ms: half a count is 3 % of 2 lux, and light is known that is at most 160 ms old. The chip can
 * take sixteen times as long, but its light would be older than what the camera sees. */
#define LONGEST_STEP 1
/* Twice the lower one is far below the upper one. */
#define TOO_BRIGHT 52000
#define TOO_DARK 8000

static int64_t now_ns(void)
{
	struct timespec now;

	(void)clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * LP_NS_PER_S + now.tv_nsec;
}

static int transfer(const struct lp_veml6040_bus *bus, struct i2c_msg *messages, unsigned int count)
{
	struct i2c_rdwr_ioctl_data request = {.msgs = messages, .nmsgs = count};

	return ioctl(bus->fd, I2C_RDWR, &request) < 0 ? -errno : 0;
}

/* Channels of a multiplexer that are connected: a bit each. */
static int connect_channels(const struct lp_veml6040_bus *bus, int mux, uint8_t channels)
{
	struct i2c_msg message = {.addr = (uint16_t)bus->mux[mux], .len = 1, .buf = &channels};

	return transfer(bus, &message, 1);
}

/* One sensor only, as they all have one address. */
static int select_sensor(const struct lp_veml6040_bus *bus, int k)
{
	const int mux = k / 8;
	const int ret = connect_channels(bus, 1 - mux, 0);

	return ret < 0 ? ret : connect_channels(bus, mux, (uint8_t)(1U << k % 8));
}

static int configure(const struct lp_veml6040_bus *bus, struct lp_veml6040 *sensor, int step)
{
	uint8_t bytes[3] = {CONF, (uint8_t)(step << IT_SHIFT), 0};
	struct i2c_msg message = {.addr = ADDRESS, .len = sizeof(bytes), .buf = bytes};
	const int ret = transfer(bus, &message, 1);

	if (ret < 0)
		return ret;
	/* What it was integrating ends first. */
	sensor->settled_ns = now_ns() + (FIRST_IT_NS << sensor->step) + (FIRST_IT_NS << step);
	sensor->step = step;
	sensor->is_set_up = true;
	return 0;
}

static int read_counts(const struct lp_veml6040_bus *bus, uint16_t counts[3])
{
	for (int c = 0; c < 3; c++) {
		uint8_t number = (uint8_t)(RED + c), bytes[2];
		struct i2c_msg messages[2] = {
			{.addr = ADDRESS, .len = 1, .buf = &number},
			{.addr = ADDRESS, .flags = I2C_M_RD, .len = sizeof(bytes), .buf = bytes}};
		const int ret = transfer(bus, messages, 2);

		if (ret < 0)
			return ret;
		counts[c] = (uint16_t)(bytes[0] | bytes[1] << 8);
	}
	return 0;
}

/* The integration time at which the brightest colour of the brightest sensor fills the scale well:
 * one for all, so that their light is of one time. */
static int better_step(const struct lp_veml6040_scan *scan)
{
	int most = -1;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		for (int c = 0; c < 3 && scan->sensors[k].has_counts; c++)
			if (scan->sensors[k].counts[c] > most)
				most = scan->sensors[k].counts[c];
	if (most > TOO_BRIGHT && scan->step > 0)
		return scan->step - 1;
	if (most >= 0 && most < TOO_DARK && scan->step < LONGEST_STEP)
		return scan->step + 1;
	return scan->step;
}

static int visit(const struct lp_veml6040_bus *bus, struct lp_veml6040 *sensor, int step)
{
	int ret;

	if (!sensor->is_set_up || sensor->step != step)
		return configure(bus, sensor, step);
	if (now_ns() < sensor->settled_ns)
		return 0;
	ret = read_counts(bus, sensor->counts);
	sensor->has_counts = ret == 0;
	return ret;
}

int lp_veml6040_scan(const struct lp_veml6040_bus *bus, struct lp_veml6040_scan *scan)
{
	const int64_t begin_ns = now_ns();
	int reached = 0, mux_error = 0;

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		struct lp_veml6040 *sensor = &scan->sensors[k];
		int ret = select_sensor(bus, k);

		sensor->has_counts = false;
		if (ret < 0)
			mux_error = ret;
		else
			ret = visit(bus, sensor, scan->step);
		reached += ret == 0;
		if (ret < 0) /* it may have been unplugged: what it was told is not known */
			sensor->is_set_up = false;
		sensor->error = ret;
	}
	/* On average an integration ended half of its time ago, and its middle is as old again. */
	scan->t_ns = begin_ns + (now_ns() - begin_ns) / 2 - (FIRST_IT_NS << scan->step);
	scan->step = better_step(scan);
	return reached ? 0 : mux_error ? mux_error : scan->sensors[0].error;
}

float lp_veml6040_lux_per_count(int step)
{
	return LUX_PER_COUNT / (float)(1 << step);
}

bool lp_veml6040_is_saturated(const struct lp_veml6040 *sensor)
{
	for (int c = 0; c < 3; c++)
		if (sensor->counts[c] == FULL_SCALE)
			return true;
	return false;
}
