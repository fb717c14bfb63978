/* SPDX-License-Identifier: Apache-2.0 */
/* What the filter makes of sensors that lag behind the light. */
#include "light/ring/ring_filter.h"

#include <math.h>
#include <stdlib.h>

#include "lp_test.h"

#define MS 1000000LL
#define PERIOD_MS 10
#define SUBSTEPS 80 /* of a window; a reading is the mean over it, as the firmware's is */
#define NOISE 0.003

/* One LDR: what it feels follows the light with a first-order lag. */
struct ldr {
	double felt, rise_s, fall_s;
	unsigned int seed;
	int64_t t_ns;
};

static double noise(unsigned int *seed)
{
	double sum = -6.0;

	for (int i = 0; i < 12; i++)
		sum += (double)rand_r(seed) / RAND_MAX;
	return sum;
}

/* The next reading of light(t). */
static struct lp_ring_sample read_ldr(struct ldr *ldr, double (*light)(double t_s))
{
	struct lp_ring_sample sample = {.t_ns = ldr->t_ns + PERIOD_MS * MS / 2 + 1000 * MS};
	double mean = 0.0;

	for (int i = 0; i < SUBSTEPS; i++) {
		const double dt_s = PERIOD_MS * 1e-3 / SUBSTEPS;
		const double lux = light((double)ldr->t_ns / 1e9 + i * dt_s);
		const double tau_s = lux > ldr->felt ? ldr->rise_s : ldr->fall_s;

		ldr->felt += (lux - ldr->felt) * (tau_s > 0.0 ? -expm1(-dt_s / tau_s) : 1.0);
		mean += ldr->felt / SUBSTEPS;
	}
	ldr->t_ns += PERIOD_MS * MS;
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		sample.illuminance_lux[k] = (float)(mean * (1.0 + NOISE * noise(&ldr->seed)));
		sample.sigma_relative[k] = 0.15F;
		sample.noise_relative[k] = (float)NOISE;
		sample.rise_s[k] = 0.02F;
		sample.fall_s[k] = 0.03F;
	}
	return sample;
}

static struct ldr new_ldr(double felt)
{
	return (struct ldr){.felt = felt, .rise_s = 0.02, .fall_s = 0.03, .seed = 1};
}

static double steady(double t_s)
{
	(void)t_s;
	return 200.0;
}

static double on_at_1s(double t_s)
{
	return t_s < 1.003 ? 100.0 : 300.0;
}

static double off_at_1s(double t_s)
{
	return t_s < 1.003 ? 300.0 : 100.0;
}

/* Mains of 120 Hz, which a window of 10 ms does not average: it beats at 20 Hz. */
static double flickers(double t_s)
{
	return 200.0 * (1.0 + 0.5 * sin(2.0 * M_PI * 120.0 * t_s));
}

static double dimmed(double t_s)
{
	return t_s < 1.0 ? 200.0 : fmax(200.0 - 200.0 * (t_s - 1.0), 50.0);
}

static void test_steady_light_is_known_better_than_a_reading(void **state)
{
	struct lp_ring_filter filter = {0};
	struct ldr ldr = new_ldr(200.0);
	struct lp_ring_sample light;
	double sum = 0.0;

	(void)state;
	for (int i = 0; i < 1000; i++) {
		const struct lp_ring_sample reading = read_ldr(&ldr, steady);

		assert_int_equal(lp_ring_filter_update(&filter, &reading, &light), 0);
		if (i > 100)
			sum += pow(light.illuminance_lux[0] / 200.0 - 1.0, 2.0);
	}
	assert_true(sqrt(sum / 899) < 2.0 * NOISE); /* taking the lag off costs less than twice */
	assert_true(light.noise_relative[0] < 0.02F);
}

/* A switched lamp shows within two readings, long before the sensor feels it all. */
static void check_step(double (*light_at)(double), double before, double after)
{
	struct lp_ring_filter filter = {0};
	struct ldr ldr = new_ldr(before);
	struct lp_ring_sample light, reading;
	int first = -1;

	for (int i = 0; i < 140; i++) {
		reading = read_ldr(&ldr, light_at);
		const uint32_t jumped = lp_ring_filter_update(&filter, &reading, &light);

		if (i < 100) /* the window from 1.00 to 1.01 s holds the change */
			assert_int_equal(jumped, 0);
		if (jumped && first < 0)
			first = i;
		if (i >= 102) {
			const double off = fabs(light.illuminance_lux[3] - after);

			assert_true(off < 0.15 * fabs(after - before));
			assert_true(off < 5.0 * (double)light.noise_relative[3] * after + 1.0);
		}
		if (i == 102) /* without the filter it is far off */
			assert_true(fabs(reading.illuminance_lux[3] - after) >
				    0.2 * fabs(after - before));
	}
	assert_int_equal(first, 100);
}

static void test_a_step_is_seen_at_once(void **state)
{
	(void)state;
	check_step(on_at_1s, 100.0, 300.0);
	check_step(off_at_1s, 300.0, 100.0);
}

/* Light that changes without being switched, and flicker, are no jumps. */
static void test_flicker_and_dimming_are_no_steps(void **state)
{
	double (*const lights[])(double) = {flickers, dimmed};

	(void)state;
	for (int i = 0; i < 2; i++) {
		struct lp_ring_filter filter = {0};
		struct ldr ldr = new_ldr(200.0);
		struct lp_ring_sample light;
		int jumps = 0;

		for (int n = 0; n < 300; n++) {
			const struct lp_ring_sample reading = read_ldr(&ldr, lights[i]);

			jumps += lp_ring_filter_update(&filter, &reading, &light) != 0;
		}
		assert_true(jumps <= 3);
		if (lights[i] == dimmed)
			assert_float_equal(light.illuminance_lux[0], 50.0F, 2.0F);
	}
}

#define TURN_RAD_S 1.75

/* A sensor that turns past a lamp in a dim room. */
static double sweeps(double t_s)
{
	return 100.0 + 2000.0 * fmax(cos(TURN_RAD_S * t_s), 0.0);
}

struct errors {
	double mean, within_3;
};

/* How well light is known in turning, relative, where the filter is told that it turns so fast. */
static struct errors errors_of_a_sweep(double told_rad_s)
{
	struct lp_ring_filter filter = {.turn_rad_s = (float)told_rad_s};
	struct ldr ldr = new_ldr(sweeps(0.0));
	struct errors errors = {0.0, 0.0};
	const int count = 1000;

	for (int i = 0; i < count; i++) {
		struct lp_ring_sample light;
		const double truth = sweeps((double)ldr.t_ns / 1e9 + PERIOD_MS * 0.5e-3);
		const struct lp_ring_sample reading = read_ldr(&ldr, sweeps);

		(void)lp_ring_filter_update(&filter, &reading, &light);
		const double lux = light.illuminance_lux[0], off = fabs(lux - truth);

		errors.mean += off / truth / count;
		errors.within_3 +=
			(off < 3.0 * (double)light.noise_relative[0] * lux) / (double)count;
	}
	return errors;
}

static void test_light_that_turns_is_known_less_well(void **state)
{
	const struct errors unaware = errors_of_a_sweep(0.0);
	const struct errors aware = errors_of_a_sweep(TURN_RAD_S);

	(void)state;
	assert_true(aware.within_3 > 0.9);
	assert_true(unaware.within_3 < 0.9);
	assert_true(aware.mean < 0.85 * unaware.mean);
}

/* Sensors without a lag, and readings without a time, are taken as they are. */
static void test_without_lag(void **state)
{
	struct lp_ring_filter filter = {0};
	struct lp_ring_sample reading = {.t_ns = 1000 * MS}, light;

	(void)state;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		reading.illuminance_lux[k] = 100.0F;
	assert_int_equal(lp_ring_filter_update(&filter, &reading, &light), 0);
	reading.t_ns += 10 * MS;
	reading.illuminance_lux[4] = 130.0F;
	assert_int_equal(lp_ring_filter_update(&filter, &reading, &light), 1 << 4);
	assert_float_equal(light.illuminance_lux[4], 130.0F, 0.1F);
	assert_float_equal(light.illuminance_lux[5], 100.0F, 0.1F);
	reading.t_ns = 0;
	reading.illuminance_lux[4] = 7.0F;
	assert_int_equal(lp_ring_filter_update(&filter, &reading, &light), 0);
	assert_float_equal(light.illuminance_lux[4], 7.0F, 0.0F);
}

/* A sensor that fails and comes back begins anew: that is no change of light. */
static void test_a_sensor_that_comes_back(void **state)
{
	struct lp_ring_filter filter = {0};
	struct lp_ring_sample reading = {.t_ns = 1000 * MS}, light;

	(void)state;
	for (int i = 0; i < 100; i++) {
		reading.t_ns += 10 * MS;
		for (int k = 0; k < LP_RING_SENSORS; k++)
			reading.illuminance_lux[k] = i < 50 ? 100.0F : 20.0F;
		if (i >= 20 && i < 80)
			reading.illuminance_lux[2] = NAN;
		const uint32_t jumped = lp_ring_filter_update(&filter, &reading, &light);

		assert_int_equal(jumped, i == 50 ? 0x1fb : 0);
		assert_int_equal(isnan(light.illuminance_lux[2]), i >= 20 && i < 80);
	}
	assert_float_equal(light.illuminance_lux[2], 20.0F, 0.1F);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_steady_light_is_known_better_than_a_reading),
		cmocka_unit_test(test_a_step_is_seen_at_once),
		cmocka_unit_test(test_flicker_and_dimming_are_no_steps),
		cmocka_unit_test(test_light_that_turns_is_known_less_well),
		cmocka_unit_test(test_without_lag),
		cmocka_unit_test(test_a_sensor_that_comes_back),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
