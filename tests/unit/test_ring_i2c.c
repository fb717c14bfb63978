/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The ring of colour sensors, on a bus of chips with registers: two TCA9548A, nine VEML6040 at one
 * address behind them. The bus fails and hangs on request.
 */
#include "lp_test.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/uri.h"
#include "fake_i2c.h"
#include "include/ring.h"
#include "include/ring_sample.h"
#include "loop_test.h"

#define DEADLOCK_S 120 /* the test program ends then */
#define PATIENCE_NS (60 * LP_NS_PER_S)
#define SLOW_MS 150  /* three scans of the bus */
#define LATE_MS 1000 /* 16 samples in turn would fall 1500 ms behind */
#define MUX 0x70
#define MUX_UP 0x71
#define SENSOR 0x10
#define LUX_PER_COUNT 0.25168F

extern const struct lp_ring_ops lp_ring_i2c_ops;

/* ---------------------------------------------------------------- the chips */

/*
 * The thread of the bus reads and writes it with fake_i2c.lock held. A sensor integrates all the
 * time, and shows the mean of the last whole integration; of the time before while there is none.
 */
static struct {
	uint8_t channels[2]; /* of each multiplexer: connected */
	uint16_t conf[LP_RING_SENSORS];
	int64_t conf_ns[LP_RING_SENSORS];    /* integrations begin here, one after another */
	uint16_t before[LP_RING_SENSORS][3]; /* counts that it showed then */
	uint8_t pointer[LP_RING_SENSORS];
	float lux[LP_RING_SENSORS][3], old_lux[LP_RING_SENSORS][3];
	int64_t changed_ns;  /* from old_lux to lux */
	unsigned int absent; /* sensors */
	unsigned int mute;   /* sensors that take what is written, and give nothing */
	int collisions;	     /* transfers that reached more than one sensor */
} bus;

/* The one sensor that is connected; -1: none. */
static int connected(void)
{
	const unsigned int all = bus.channels[0] | (unsigned int)(bus.channels[1] & 1) << 8;
	int found = -1;

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		if (!(all >> k & 1))
			continue;
		bus.collisions += found >= 0;
		found = k;
	}
	return found >= 0 && bus.absent >> found & 1 ? -1 : found;
}

static uint16_t counts_of(int k, int colour)
{
	const int step = bus.conf[k] >> 4 & 7;
	const int64_t it_ns = (40 * LP_NS_PER_MS) << step;
	const int64_t whole = (lp_clock_ns() - bus.conf_ns[k]) / it_ns;
	const int64_t begin_ns = bus.conf_ns[k] + (whole - 1) * it_ns;
	const double old = fmin(fmax((double)(bus.changed_ns - begin_ns) / (double)it_ns, 0), 1);
	const double lux = old * bus.old_lux[k][colour] + (1 - old) * bus.lux[k][colour];

	if (whole == 0)
		return bus.before[k][colour];
	return (uint16_t)fmin(lux / LUX_PER_COUNT * (double)(1 << step), 65535.0);
}

static void set_up_sensor(int k, uint16_t conf)
{
	uint16_t shown[3];

	for (int c = 0; c < 3; c++)
		shown[c] = counts_of(k, c);
	memcpy(bus.before[k], shown, sizeof(shown));
	bus.conf[k] = conf;
	bus.conf_ns[k] = lp_clock_ns();
}

static int sensor_message(const struct i2c_msg *message)
{
	const int k = connected();

	if (k < 0)
		return -ENXIO;
	if (message->flags & I2C_M_RD && bus.mute >> k & 1)
		return -EREMOTEIO;
	if (message->flags & I2C_M_RD) {
		const int colour = bus.pointer[k] - 0x08;
		const uint16_t value = colour >= 0 && colour < 3 ? counts_of(k, colour) : 0;

		message->buf[0] = (uint8_t)(value & 0xFF);
		message->buf[1] = (uint8_t)(value >> 8);
		return 0;
	}
	bus.pointer[k] = message->buf[0];
	if (message->len == 3 && message->buf[0] == 0)
		set_up_sensor(k, (uint16_t)(message->buf[1] | message->buf[2] << 8));
	return 0;
}

static int transfer(const struct i2c_rdwr_ioctl_data *request)
{
	int ret = 0;

	for (unsigned int i = 0; i < request->nmsgs && ret == 0; i++) {
		const struct i2c_msg *message = &request->msgs[i];

		if (message->addr == MUX || message->addr == MUX_UP)
			bus.channels[message->addr - MUX] = message->buf[0];
		else
			ret = message->addr == SENSOR ? sensor_message(message) : -ENXIO;
	}
	return ret;
}

/* A value of the chips, set while a thread may look at it. */
#define SET(field, value)                             \
	do {                                          \
		pthread_mutex_lock(&fake_i2c.lock);   \
		bus.field = (value);                  \
		pthread_mutex_unlock(&fake_i2c.lock); \
	} while (0)

static uint16_t conf_of(int k)
{
	pthread_mutex_lock(&fake_i2c.lock);
	const uint16_t conf = bus.conf[k];

	pthread_mutex_unlock(&fake_i2c.lock);
	return conf;
}

/* ---------------------------------------------------------------- the ring */

static struct {
	struct lp_loop *loop;
	struct lp_ring *ring;
	struct lp_ring_sample sample;
	int samples;
	int ends;    /* of faults */
	int slow_ms; /* what a sample keeps the loop busy */
	int late;    /* samples that waited for the loop behind others */
	int64_t free_ns;
	char waiting[400], missing[200], saturated[200];
} s;

static void on_sample(void *context, const struct lp_ring_sample *sample)
{
	(void)context;
	s.late += s.samples && sample->t_ns < s.free_ns - LATE_MS * LP_NS_PER_MS;
	s.sample = *sample;
	s.samples++;
	if (s.slow_ms)
		(void)usleep((useconds_t)s.slow_ms * 1000);
	s.free_ns = lp_clock_ns();
}

static void on_fault(void *context, const char *id, const char *text)
{
	char *kept = strcmp(id, "ring-i2c-waiting") == 0 ? s.waiting
		     : strstr(id, "missing")		 ? s.missing
							 : s.saturated;

	(void)context;
	s.ends += *kept && !text;
	(void)snprintf(kept, 200, "%s", text ? text : "");
}

static int create(const char *text)
{
	const struct lp_ring_host host = {.loop = s.loop, .sample = on_sample, .fault = on_fault};
	struct lp_uri uri;

	assert_int_equal(lp_uri_parse(&uri, text), 0);
	return lp_ring_i2c_ops.create(&uri, &host, &s.ring);
}

static void light_all(float red, float green, float blue)
{
	pthread_mutex_lock(&fake_i2c.lock);
	memcpy(bus.old_lux, bus.lux, sizeof(bus.lux));
	bus.changed_ns = lp_clock_ns();
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float more = 1.0F + 0.1F * (float)k;

		bus.lux[k][0] = red * more;
		bus.lux[k][1] = green * more;
		bus.lux[k][2] = blue * more;
	}
	pthread_mutex_unlock(&fake_i2c.lock);
}

static int set_up(void **state)
{
	(void)state;
	memset(&s, 0, sizeof(s));
	fake_i2c_init();
	fake_i2c.chips = transfer;
	SET(absent, 0);
	SET(mute, 0);
	bus.collisions = 0;
	memset(bus.conf, 0xFF, sizeof(bus.conf)); /* shut down, as after power */
	light_all(300.0F, 200.0F, 100.0F);
	return lp_loop_create(&s.loop);
}

static int tear_down(void **state)
{
	(void)state;
	FAKE_I2C_SET(hangs, false);
	lp_ring_i2c_ops.destroy(s.ring);
	lp_loop_destroy(s.loop);
	return 0;
}

#define UNTIL(condition)                                            \
	do {                                                        \
		const int64_t end_ns = lp_clock_ns() + PATIENCE_NS; \
		while (!(condition)) {                              \
			assert_true(lp_clock_ns() < end_ns);        \
			(void)loop_turn(s.loop, 20);                \
		}                                                   \
	} while (0)

static void begin(void)
{
	assert_int_equal(create("i2c:" FAKE_I2C), 0);
	assert_int_equal(lp_ring_i2c_ops.start(s.ring), 0);
}

/* ---------------------------------------------------------------- tests */

static void test_nine_sensors_are_read_each_by_itself(void **state)
{
	(void)state;
	begin();
	UNTIL(s.samples && isfinite(s.sample.illuminance_lux[8]));
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const float more = 1.0F + 0.1F * (float)k;

		assert_float_equal(s.sample.illuminance_lux[k], 200.0F * more, 0.5F);
		assert_float_equal(s.sample.rgb[k][0], 300.0F * more, 0.5F);
		assert_float_equal(s.sample.rgb[k][2], 100.0F * more, 0.5F);
		assert_true(s.sample.sigma_relative[k] > 0.04F &&
			    s.sample.sigma_relative[k] < 0.06F);
	}
	assert_true(s.sample.colour_sigma > 0.0F && s.sample.common_sigma > 0.0F);
	assert_int_equal(bus.collisions, 0);
	assert_string_equal(s.waiting, "");
}

static void test_the_integration_time_follows_the_light(void **state)
{
	(void)state;
	begin();
	light_all(3.0F, 2.0F, 1.0F);
	UNTIL(conf_of(0) == 1 << 4);
	UNTIL(fabsf(s.sample.illuminance_lux[0] - 2.0F) < 0.13F); /* a count */
	light_all(9000.0F, 8000.0F, 7000.0F);
	UNTIL(conf_of(0) == 0);
	UNTIL(fabsf(s.sample.illuminance_lux[0] - 8000.0F) < 1.0F);
}

/* A sample's time is that of its light, to one integration, whatever the integration time does. */
static void test_readings_are_of_their_time(void **state)
{
	const float levels[] = {200.0F, 2.0F, 9000.0F, 3.0F};
	const int64_t it_ns = 80 * LP_NS_PER_MS;
	float before = 200.0F;

	(void)state;
	begin();
	UNTIL(s.samples && isfinite(s.sample.illuminance_lux[0]));
	for (int n = 0; n < 12; n++) {
		const float lux = levels[n % 4];
		const int64_t changed_ns = lp_clock_ns();
		int right = 0, seen = s.samples;

		light_all(lux, lux, lux);
		/* another phase of integrations and of their change each time */
		while (right < 1 + n) {
			UNTIL(s.samples > seen);
			seen = s.samples;
			const float read = s.sample.illuminance_lux[0];

			if (isnan(read))
				continue;
			if (s.sample.t_ns > changed_ns + it_ns)
				assert_float_equal(read, lux, 0.02F * lux + 0.13F);
			if (s.sample.t_ns < changed_ns - it_ns)
				assert_float_equal(read, before, 0.02F * before + 0.13F);
			right += s.sample.t_ns > changed_ns + it_ns;
		}
		before = lux;
	}
}

static void test_too_much_light_is_told(void **state)
{
	(void)state;
	begin();
	light_all(5e4F, 5e4F, 5e4F);
	UNTIL(*s.saturated);
	assert_non_null(strstr(s.saturated, "0, 1, 2, 3, 4, 5, 6, 7, 8: too bright"));
	assert_true(isnan(s.sample.illuminance_lux[0]) && isnan(s.sample.rgb[0][1]));
	light_all(300.0F, 200.0F, 100.0F);
	UNTIL(!*s.saturated && isfinite(s.sample.illuminance_lux[0]));
}

static void test_a_missing_sensor_is_named_and_the_others_go_on(void **state)
{
	(void)state;
	SET(absent, 1U << 3 | 1U << 8);
	begin();
	UNTIL(*s.missing && isfinite(s.sample.illuminance_lux[7]));
	assert_non_null(strstr(s.missing, "sensor 3, 8: does not answer"));
	assert_true(isnan(s.sample.illuminance_lux[3]));
	SET(conf[3], 0xFFFF);
	SET(absent, 0);
	UNTIL(!*s.missing && isfinite(s.sample.illuminance_lux[3]));
	assert_int_equal(conf_of(3) & 1, 0); /* set up again */
}

/* It is set up again and again, and that succeeds: only a reading ends the fault. */
static void test_a_sensor_that_gives_nothing_stays_missing(void **state)
{
	(void)state;
	SET(mute, 1U << 3);
	begin();
	UNTIL(*s.missing && isfinite(s.sample.illuminance_lux[7]));
	for (const int now = s.samples; s.samples < now + 10;)
		(void)loop_turn(s.loop, 20);
	assert_int_equal(s.ends, 0);
	assert_non_null(strstr(s.missing, "sensor 3: does not answer"));
	SET(mute, 0);
	UNTIL(!*s.missing && isfinite(s.sample.illuminance_lux[3]));
}

/* The bus is opened again and again, and that succeeds. */
static void test_a_ring_that_gives_nothing_is_waited_for(void **state)
{
	(void)state;
	SET(mute, ~0U);
	begin();
	UNTIL(*s.waiting);
	for (const int now = fake_i2c_get(&fake_i2c.opened);
	     fake_i2c_get(&fake_i2c.opened) < now + 2;)
		(void)loop_turn(s.loop, 20);
	assert_int_equal(s.ends, 0);
	SET(mute, 0);
	UNTIL(!*s.waiting && isfinite(s.sample.illuminance_lux[0]));
}

static void test_a_bus_that_fails_is_opened_again(void **state)
{
	(void)state;
	begin();
	UNTIL(s.samples > 2);
	FAKE_I2C_SET(error, EREMOTEIO);
	UNTIL(*s.waiting);
	assert_non_null(strstr(s.waiting, "does the multiplexer answer?"));
	FAKE_I2C_SET(error, 0);
	UNTIL(!*s.waiting && isfinite(s.sample.illuminance_lux[0]));
	assert_true(fake_i2c_get(&fake_i2c.opened) >= 2);
}

static void test_a_bus_that_hangs_is_told_and_survived(void **state)
{
	(void)state;
	begin();
	UNTIL(s.samples > 2);
	FAKE_I2C_SET(hangs, true);
	UNTIL(*s.waiting);
	assert_non_null(strstr(s.waiting, "the bus hangs"));
	FAKE_I2C_SET(hangs, false);
	const int before = s.samples;

	UNTIL(!*s.waiting && s.samples > before + 2);
}

/* All else in the loop has its turn, and what is told is the newest. */
static void test_a_loop_slower_than_the_bus_falls_no_further_behind(void **state)
{
	int turns = 0;

	(void)state;
	s.slow_ms = SLOW_MS;
	begin();
	for (; s.samples < 16; turns++)
		UNTIL(loop_turn(s.loop, 20));
	assert_in_range(turns, 15, 200);
	assert_int_equal(s.late, 0);
}

static void test_no_bus_is_told_with_the_next_step(void **state)
{
	(void)state;
	assert_int_equal(create("i2c:/dev/i2c-none"), 0);
	assert_int_equal(lp_ring_i2c_ops.start(s.ring), 0);
	UNTIL(*s.waiting);
	assert_non_null(strstr(s.waiting, "i2c:/dev/i2c-none: open: "));
	assert_non_null(strstr(s.waiting, "is I2C switched on?"));
	assert_true(strlen(s.waiting) < 160);
}

static void test_uris_that_make_no_sense(void **state)
{
	(void)state;
	assert_int_equal(create("i2c:"), -EINVAL);
	assert_int_equal(create("i2c:" FAKE_I2C "?mux=0x71"), -EINVAL);
	assert_int_equal(create("i2c:" FAKE_I2C "?mux=0x10"), -EINVAL);
	assert_int_equal(create("i2c:" FAKE_I2C "?cover=0"), -EINVAL);
	assert_null(s.ring);
}

static void test_a_cover_and_gains_count(void **state)
{
	(void)state;
	assert_int_equal(create("i2c:" FAKE_I2C "?cover=0.1&red_gain=2&blue_gain=0.5"), 0);
	assert_int_equal(lp_ring_i2c_ops.start(s.ring), 0);
	UNTIL(s.samples && isfinite(s.sample.illuminance_lux[0]));
	assert_float_equal(s.sample.illuminance_lux[0], 2000.0F, 5.0F);
	assert_float_equal(s.sample.rgb[0][0], 6000.0F, 10.0F);
	assert_float_equal(s.sample.rgb[0][2], 500.0F, 5.0F);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_nine_sensors_are_read_each_by_itself),
		TEST(test_the_integration_time_follows_the_light),
		TEST(test_readings_are_of_their_time),
		TEST(test_too_much_light_is_told),
		TEST(test_a_missing_sensor_is_named_and_the_others_go_on),
		TEST(test_a_sensor_that_gives_nothing_stays_missing),
		TEST(test_a_ring_that_gives_nothing_is_waited_for),
		TEST(test_a_bus_that_fails_is_opened_again),
		TEST(test_a_bus_that_hangs_is_told_and_survived),
		TEST(test_a_loop_slower_than_the_bus_falls_no_further_behind),
		TEST(test_no_bus_is_told_with_the_next_step),
		TEST(test_uris_that_make_no_sense),
		TEST(test_a_cover_and_gains_count),
	};

	(void)alarm(DEADLOCK_S);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
