/* SPDX-License-Identifier: Apache-2.0 */
/* Time at its ends: 49 days (a clock of 32 bits in milliseconds goes round), 2038 (one of 31 bits
 * in seconds), clocks that step backwards and forwards. */
#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "drivers/link/clock.h"
#include "figure.h"
#include "light/ring/ring_filter.h"
#include "light/ring/ring_history.h"
#include "light/send/listing.h"
#include "light/send/tracker.h"
#include "light/turn/orientation_track.h"
#include "random_normal.h"

#define DAY_NS (86400 * LP_NS_PER_S)
#define MS LP_NS_PER_MS

/* ---------------------------------------------------------------- the microcontroller's clock */

/* A microcontroller's microseconds go round every 71 minutes; ours may stand still meanwhile. */
struct device {
	double rate;
	int64_t ahead_us; /* of our clock */
};

static uint32_t device_us(const struct device *device, int64_t t_ns)
{
	return (uint32_t)((int64_t)((double)t_ns * device->rate / 1e3) + device->ahead_us);
}

/* One exchange, with delays that differ. Returns how far off the clock is afterwards, in sigmas. */
static double exchange(struct lp_link_clock *clock, const struct device *device, int64_t t_ns)
{
	const int64_t there_ns = 200000 + (int64_t)(1e6 * fabs((double)random_normal()));
	const int64_t back_ns = 200000 + (int64_t)(1e6 * fabs((double)random_normal()));
	int64_t found_ns = 0, sigma_ns = 0;

	(void)lp_link_clock_add(clock, t_ns, t_ns + there_ns + back_ns,
				device_us(device, t_ns + there_ns), 0);
	assert_true(lp_link_clock_at(clock, device_us(device, t_ns), &found_ns, &sigma_ns));
	assert_true(sigma_ns > 0);
	return (double)llabs(found_ns - t_ns) / (double)sigma_ns;
}

/* 50 days of it, with an exchange every minute: the wrap is crossed a thousand times. */
static void test_the_link_over_50_days(void **state)
{
	const struct device device = {.rate = 1.00005, .ahead_us = 4294000000};
	struct lp_link_clock clock = {0};
	double worst = 0.0;

	(void)state;
	for (int n = 0; n < 50 * 24 * 60; n++)
		worst = fmax(worst, exchange(&clock, &device, 60 * LP_NS_PER_S * (n + 1)));
	figure("time", "microcontroller's clock, 50 days", "sigmas", worst, 4.0);
}

/* The machine sleeps, or the microcontroller starts anew unseen: what was known of the clock is
 * wrong then, and is not mixed with what is known now. */
static void test_steps_of_the_link(void **state)
{
	static const int64_t steps_us[] = {1000000,  -1000000,	 30000,	      -30000,
					   60000000, 3600000000, -3600000000, 1000000000000};
	double worst = 0.0;

	(void)state;
	for (size_t k = 0; k < LP_COUNT(steps_us); k++) {
		struct device device = {.rate = 0.9995, .ahead_us = 77};
		struct lp_link_clock clock = {0};

		for (int n = 0; n < 100; n++) {
			if (n == 50)
				device.ahead_us += steps_us[k];
			worst = fmax(worst, exchange(&clock, &device, LP_NS_PER_S * (n + 1)));
		}
	}
	figure("time", "microcontroller's clock steps by 30 ms … 11 days", "sigmas", worst, 4.0);
}

/* ---------------------------------------------------------------- steps of a frame's time */

/* 49 days after the start, beyond 2038, and steps that no clock should make. */
static const int64_t jumps_ns[] = {0,
				   1,
				   -1,
				   -40 * MS,
				   40 * MS,
				   -DAY_NS,
				   DAY_NS,
				   49 * DAY_NS + 17 * 3600 * LP_NS_PER_S,
				   -49 * DAY_NS,
				   5000 * DAY_NS};
/* From 1970 so far; LP_SIMULATED_UNIX_NS is in it. */
#define Y2038_NS (INT64_C(2147483648) * LP_NS_PER_S - LP_SIMULATED_UNIX_NS)

static struct lp_light_estimate lit(int64_t t_ns)
{
	struct lp_light_estimate e = {.t_capture_ns = t_ns, .light_count = 2};

	for (int k = 0; k < 2; k++)
		e.lights[k] =
			(struct lp_light){.id = 1 + (uint32_t)k,
					  .direction = {0.0F, k ? 1.0F : 0.0F, k ? 0.0F : -1.0F},
					  .irradiance = {5.0F - k, 5.0F - k, 5.0F - k},
					  .angular_radius_deg = 1.0F,
					  .distance_m = NAN};
	e.sh_total[0][0] = e.sh_total[0][1] = e.sh_total[0][2] = 5.0F;
	return e;
}

static void assert_same_light(const struct lp_light_estimate *e)
{
	ASSERT_FINITE(e->sh_total);
	assert_int_equal(e->light_count, 2);
	for (int k = 0; k < 2; k++)
		assert_float_equal(e->lights[k].irradiance[0], 5.0 - k, 1e-4);
	assert_float_equal(e->sh_total[0][1], 5.0, 1e-4);
}

/* Nothing changes in light that stays, whatever its times do. */
static void test_steps_between_frames(void **state)
{
	static const struct lp_listing_limits limits = {.sh_order = 2, .lights = 4};

	(void)state;
	for (int late = 0; late < 2; late++)
		for (size_t k = 0; k < LP_COUNT(jumps_ns); k++) {
			struct lp_tracker tracker = {.time_constant_ms = 100.0F};
			struct lp_listing listing = {0};
			struct lp_ring_filter filter = {0};
			int64_t t_ns = 6000 * DAY_NS + late * Y2038_NS;

			for (int n = 0; n < 60; n++) {
				struct lp_light_estimate smoothed, listed;
				struct lp_ring_sample light;

				t_ns += n == 30 ? jumps_ns[k] : 33 * MS;
				const struct lp_light_estimate raw = lit(t_ns);
				struct lp_ring_sample reading = {.t_ns = t_ns};

				lp_tracker_update(&tracker, &raw, &smoothed);
				assert_same_light(&smoothed);
				(void)lp_listing_update(&listing, &smoothed, &limits, &listed);
				assert_same_light(&listed);
				for (int s = 0; s < LP_RING_SENSORS; s++) {
					reading.illuminance_lux[s] = 100.0F;
					reading.noise_relative[s] = 0.01F;
					reading.rise_s[s] = reading.fall_s[s] = 0.03F;
				}
				assert_int_equal(lp_ring_filter_update(&filter, &reading, &light),
						 0);
				assert_float_equal(light.illuminance_lux[4], 100.0, 0.01);
			}
		}
}

/* Readings of long ago, and of a time to come, are not those of now. */
static void test_readings_of_another_time(void **state)
{
	(void)state;
	for (size_t k = 0; k < LP_COUNT(jumps_ns); k++) {
		struct lp_ring_history history = {0};
		struct lp_orientation_track track = {0};
		const int64_t now_ns = 6000 * DAY_NS + Y2038_NS;
		const int64_t then_ns = now_ns + jumps_ns[k];
		const struct lp_ring_sample sample = {.t_ns = then_ns};
		const struct lp_orientation_sample pose = {.kind = LP_ATTITUDE,
							   .t_ns = then_ns,
							   .quaternion = {0.0, 0.0, 0.0, 1.0},
							   .sigma = 1e-3};
		struct lp_track_reading told;
		struct lp_ring_sample found;
		const bool is_near = llabs(jumps_ns[k]) <= 100 * MS;

		lp_ring_history_add(&history, &sample);
		assert_int_equal(lp_ring_history_at(&history, now_ns, 100 * MS, &found), is_near);
		assert_int_equal(lp_orientation_track_add(&track, &pose), 0);
		assert_int_equal(lp_orientation_track_at(&track, now_ns, &told) == 0,
				 jumps_ns[k] == 0);
	}
}

/* Unix time beyond 2038, and beyond 32 bits of seconds. */
static void test_unix_time(void **state)
{
	static const int64_t unix_s[] = {2147483647, 2147483648, 4294967295, 4294967296,
					 9000000000};

	(void)state;
	for (size_t k = 0; k < LP_COUNT(unix_s); k++) {
		const int64_t t_ns = unix_s[k] * LP_NS_PER_S + 123456789 - LP_SIMULATED_UNIX_NS;

		lp_clock_simulate(t_ns);
		assert_int_equal(lp_clock_ns(), t_ns);
		assert_int_equal(lp_clock_unix_ns(lp_clock_ns()),
				 unix_s[k] * LP_NS_PER_S + 123456789);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_the_link_over_50_days),
		cmocka_unit_test(test_steps_of_the_link),
		cmocka_unit_test(test_steps_between_frames),
		cmocka_unit_test(test_readings_of_another_time),
		cmocka_unit_test(test_unix_time),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
