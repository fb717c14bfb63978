/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/clock.h"
#include "drivers/source/frame_clock.h"
#include "include/frame.h"

#define START_NS (1000 * LP_NS_PER_S)
#define PERIOD_NS (LP_NS_PER_S / 30)
#define DELAY_NS (21 * LP_NS_PER_MS) /* reading and transfer */

/* A camera whose frames take 21 ms, some longer, as on USB; and what its clock makes of a time. */
struct camera {
	struct lp_frame_clock clock;
	struct lp_frame frame;
	const char *object;
	int64_t (*lie)(double t_s, int64_t t_ns);
	int64_t t_ns; /* of the reading of its newest frame */
	int64_t more_delay_ns;
	double wrong_ms; /* the most by which t_read_ns was wrong, of the frames last run */
	double sigmas;	 /* the same in what is stated, at 2 ms of the stamps themselves */
	int believed, frames;
	const char *first_fault; /* of those frames */
};

static struct camera camera_with(int64_t (*lie)(double t_s, int64_t t_ns))
{
	srand(1);
	return (struct camera){.object = "cam", .lie = lie, .t_ns = START_NS};
}

/* Mostly little; one frame in ten waits for up to 30 ms. */
static int64_t jitter_ns(void)
{
	const double u = rand() / (double)RAND_MAX;

	return (int64_t)((rand() % 10 ? 2e6 : 30e6) * u * u);
}

static void take(struct camera *camera, int64_t arrival_ns)
{
	const double t_s = (double)(camera->t_ns - START_NS) / 1e9;
	struct lp_frame *frame = &camera->frame;

	frame->sequence++;
	frame->t_arrival_ns = arrival_ns;
	lp_frame_clock_stamp(&camera->clock, frame, camera->lie(t_s, camera->t_ns), camera->object);
	const double wrong_ms = (double)llabs(frame->t_read_ns - camera->t_ns) / 1e6;

	assert_true(frame->t_read_ns > 0 && frame->t_read_ns <= arrival_ns);
	assert_true((frame->clock_fault != NULL) == (frame->stamp_sigma_us > 0.0F));
	camera->wrong_ms = fmax(camera->wrong_ms, wrong_ms);
	camera->sigmas =
		fmax(camera->sigmas, wrong_ms / hypot(2.0, 1e-3 * (double)frame->stamp_sigma_us));
	camera->believed += frame->clock_fault == NULL;
	camera->frames++;
	if (frame->clock_fault && !camera->first_fault)
		camera->first_fault = frame->clock_fault;
}

static void run(struct camera *camera, double seconds)
{
	camera->wrong_ms = camera->sigmas = 0.0;
	camera->believed = camera->frames = 0;
	camera->first_fault = NULL;
	for (int64_t end_ns = camera->t_ns + (int64_t)(1e9 * seconds); camera->t_ns < end_ns;) {
		camera->t_ns += PERIOD_NS;
		take(camera, camera->t_ns + DELAY_NS + camera->more_delay_ns + jitter_ns());
	}
}

static int64_t truth(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns;
}

static void assert_untouched(const struct camera *camera)
{
	assert_null(camera->first_fault);
	assert_float_equal(camera->wrong_ms, 0.0, 0.0);
}

static void test_an_honest_camera_is_not_touched(void **state)
{
	struct camera camera = camera_with(truth);

	(void)state;
	run(&camera, 1800);
	assert_untouched(&camera);
	for (int ms = 0; ms <= 300; ms += 60) { /* smaller and larger pictures, a busy machine */
		camera.more_delay_ns = ms * LP_NS_PER_MS;
		run(&camera, 20);
		assert_untouched(&camera);
	}
	camera.frame.sequence = 0; /* it is opened anew */
	run(&camera, 20);
	assert_untouched(&camera);
	camera.t_ns += 3600 * LP_NS_PER_S; /* after a long time */
	run(&camera, 20);
	assert_untouched(&camera);
}

/* Frames overtake each other on their way. */
static void test_frames_out_of_order(void **state)
{
	struct camera camera = camera_with(truth);

	(void)state;
	for (int k = 0; k < 300; k++) {
		static const int order[] = {2, 0, 1};
		const int at = order[k % 3], first = k - k % 3;

		camera.frame.sequence = (uint64_t)(first + at);
		camera.t_ns = START_NS + (first + at) * PERIOD_NS;
		take(&camera, START_NS + (k + 4) * PERIOD_NS);
	}
	assert_untouched(&camera);
}

/* Half a second of exposure, and a second of transfer: of few frames each may take long. */
static void test_a_slow_camera(void **state)
{
	struct camera camera = camera_with(truth);

	(void)state;
	for (int k = 1; k < 100; k++) {
		camera.t_ns = START_NS + k * LP_NS_PER_S;
		take(&camera, camera.t_ns + 1100 * LP_NS_PER_MS);
	}
	assert_untouched(&camera);
}

/* The daemon was stopped for half a minute: frames that waited are as old as they say. */
static void test_frames_that_waited_for_us_are_old(void **state)
{
	struct camera camera = camera_with(truth);

	(void)state;
	run(&camera, 10);
	const int64_t woken_ns = camera.t_ns + 30 * LP_NS_PER_S;

	for (int k = 0; k < 4; k++) {
		camera.t_ns += PERIOD_NS;
		take(&camera, woken_ns + k * LP_NS_PER_MS);
	}
	assert_untouched(&camera);
	camera.t_ns = woken_ns;
	run(&camera, 10);
	assert_untouched(&camera);
}

/* ---------------------------------------------------------------- lies from the first frame on */

static int64_t frozen(double t_s, int64_t t_ns)
{
	(void)t_s;
	(void)t_ns;
	return START_NS + PERIOD_NS;
}

static int64_t past(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns - 5 * LP_NS_PER_S;
}

/* By less than the time to live. */
static int64_t a_little_past(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns - 800 * LP_NS_PER_MS;
}

static int64_t future(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns + 3600 * LP_NS_PER_S;
}

static int64_t unix_time(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns + INT64_C(1700000000) * LP_NS_PER_S;
}

static int64_t from_zero(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns - START_NS;
}

static int64_t negative(double t_s, int64_t t_ns)
{
	(void)t_s;
	return INT64_MIN + t_ns;
}

static int64_t highest(double t_s, int64_t t_ns)
{
	(void)t_s;
	return INT64_MAX - t_ns % 2;
}

static int64_t nothing(double t_s, int64_t t_ns)
{
	(void)t_s;
	(void)t_ns;
	return 0;
}

/* 32 bits of nanoseconds. */
static int64_t wrapped(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns & UINT32_MAX;
}

static int64_t jittered(double t_s, int64_t t_ns)
{
	(void)t_s;
	return t_ns + (rand() % 160 - 80) * LP_NS_PER_MS;
}

static int64_t slow(double t_s, int64_t t_ns)
{
	return t_ns - (int64_t)(1e9 * 0.2 * t_s);
}

static const struct {
	int64_t (*lie)(double t_s, int64_t t_ns);
	const char *fault;
} lies[] = {
	{frozen, "stand still"}, {past, "older"},	    {a_little_past, "older"},
	{future, "to come"},	 {unix_time, "to come"},    {from_zero, "older"},
	{negative, "older"},	 {highest, "to come"},	    {nothing, "carry no"},
	{wrapped, "older"},	 {jittered, "time stamps"}, {slow, "older"},
};

/* The arrival stands in, and its sigma covers what it is off by. */
static void test_what_cannot_be_is_not_believed(void **state)
{
	(void)state;
	for (size_t i = 0; i < LP_COUNT(lies); i++) {
		struct camera camera = camera_with(lies[i].lie);

		run(&camera, 8);
		assert_non_null(camera.first_fault);
		assert_contains(camera.first_fault, lies[i].fault);
		run(&camera, 30);
		assert_int_equal(camera.believed, 0);
		assert_true(camera.wrong_ms < 60.0);
		assert_true(camera.sigmas < 6.0);
	}
}

/* A sigma is one: it covers most, and is not much more. */
static void test_the_sigma_is_as_large_as_the_error(void **state)
{
	struct camera camera = camera_with(frozen);
	double squares = 0.0, stated = 0.0;

	(void)state;
	run(&camera, 5);
	for (int k = 0; k < 1000; k++) {
		run(&camera, 0.03);
		squares += camera.wrong_ms * camera.wrong_ms;
		stated +=
			1e-6 * (double)(camera.frame.stamp_sigma_us * camera.frame.stamp_sigma_us);
	}
	assert_true(squares < 4.0 * stated && squares > 0.1 * stated);
}

/* ---------------------------------------------------------------- clocks that go wrong later */

static int64_t back_after_20_s(double t_s, int64_t t_ns)
{
	return t_ns - (t_s > 20.0 ? 3 * LP_NS_PER_S : 0);
}

static int64_t a_little_back_after_20_s(double t_s, int64_t t_ns)
{
	return t_ns - (t_s > 20.0 ? 200 * LP_NS_PER_MS : 0);
}

static int64_t forth_after_20_s(double t_s, int64_t t_ns)
{
	return t_ns + (t_s > 20.0 ? 100 * LP_NS_PER_MS : 0);
}

static int64_t frozen_after_20_s(double t_s, int64_t t_ns)
{
	return t_s > 20.0 ? START_NS + 20 * LP_NS_PER_S : t_ns;
}

static void test_steps_are_not_believed(void **state)
{
	int64_t (*const steps[])(double, int64_t) = {back_after_20_s, a_little_back_after_20_s,
						     forth_after_20_s, frozen_after_20_s};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(steps); i++) {
		struct camera camera = camera_with(steps[i]);

		run(&camera, 19.9);
		assert_untouched(&camera);
		run(&camera, 0.2);
		run(&camera, 30);
		assert_int_equal(camera.believed, 0);
		assert_true(camera.wrong_ms < 40.0);		  /* jitter alone */
		assert_true(camera.frame.stamp_sigma_us < 15e3F); /* it has been learned */
	}
}

static double rate;

static int64_t drifting(double t_s, int64_t t_ns)
{
	return t_ns + (int64_t)(1e9 * rate * t_s);
}

static void test_drifts_are_not_believed(void **state)
{
	static const double rates[] = {-0.05, -0.01, -0.001, -0.0001, 0.0001, 0.001, 0.01, 0.05};

	(void)state;
	for (size_t i = 0; i < LP_COUNT(rates); i++) {
		struct camera camera = camera_with(drifting);

		rate = rates[i];
		run(&camera, 8.5 + 0.06 / fabs(rate)); /* 60 ms apart, or the first look at it */
		assert_non_null(camera.first_fault);
		assert_true(camera.wrong_ms < 70.0 ||
			    (fabs(rate) >= 0.01 && camera.wrong_ms < 450.0));
		run(&camera, 60 + 0.1 / fabs(rate));
		assert_int_equal(camera.believed, 0);
		assert_true(camera.wrong_ms < 60.0);
	}
}

/* ---------------------------------------------------------------- once, and over again */

static int64_t frozen_for_10_s(double t_s, int64_t t_ns)
{
	return t_s > 10.0 && t_s < 20.0 ? START_NS + 10 * LP_NS_PER_S : t_ns;
}

static int count(const char *text, const char *part)
{
	int found = 0;

	for (; (text = strstr(text, part)); text++)
		found++;
	return found;
}

static void test_it_is_named_once_and_taken_back(void **state)
{
	struct camera camera = camera_with(frozen_for_10_s);
	struct capture capture;

	(void)state;
	camera.object = "another"; /* repeated lines are only counted */
	capture_begin(&capture);
	run(&camera, 22.5);
	run(&camera, 60);
	const char *log = capture_end(&capture);

	assert_untouched(&camera);
	assert_int_equal(count(log, "stand still"), 1);
	assert_contains(log, "another: clock: its time stamps stand still or go back: the arrival");
	assert_int_equal(count(log, "right again"), 1);
}

/* Opening the camera anew hides nothing: not for a single frame. */
static void test_a_restart_does_not_hide_it(void **state)
{
	struct camera camera = camera_with(frozen);

	(void)state;
	run(&camera, 5);
	for (int k = 0; k < 5; k++) {
		camera.frame.sequence = 0;
		camera.t_ns += 3 * LP_NS_PER_S;
		camera.lie = k % 2 ? frozen : truth; /* one stamp that may be true is no proof */
		run(&camera, 1.5);
		assert_int_equal(camera.believed, 0);
	}
}

/* What the driver marks corrupt may carry any stamp. */
static void test_corrupt_frames_say_nothing(void **state)
{
	struct camera camera = camera_with(nothing);

	(void)state;
	camera.frame.flags = LP_FRAME_CORRUPT;
	for (int k = 0; k < 10; k++) {
		camera.t_ns += PERIOD_NS;
		camera.frame.t_arrival_ns = camera.t_ns + DELAY_NS;
		lp_frame_clock_stamp(&camera.clock, &camera.frame, 0, "cam");
		assert_null(camera.frame.clock_fault);
	}
	camera.frame.flags = 0;
	camera.lie = truth;
	run(&camera, 10);
	assert_untouched(&camera);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_an_honest_camera_is_not_touched),
		cmocka_unit_test(test_frames_out_of_order),
		cmocka_unit_test(test_a_slow_camera),
		cmocka_unit_test(test_frames_that_waited_for_us_are_old),
		cmocka_unit_test(test_what_cannot_be_is_not_believed),
		cmocka_unit_test(test_the_sigma_is_as_large_as_the_error),
		cmocka_unit_test(test_steps_are_not_believed),
		cmocka_unit_test(test_drifts_are_not_believed),
		cmocka_unit_test(test_it_is_named_once_and_taken_back),
		cmocka_unit_test(test_a_restart_does_not_hide_it),
		cmocka_unit_test(test_corrupt_frames_say_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
