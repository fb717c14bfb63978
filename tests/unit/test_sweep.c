/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <math.h>

#include "app/box/sweep.h"
#include "base/clock.h"
#include "include/frame.h"

#define MS LP_NS_PER_MS

/* One frame at a time, exposed from 1000 to 1010 ms, arrived at 1020 ms. */
static struct lp_frame frame;
static int emitted, released, looks, moves;
static float target_deg;

static void on_frame(void *context, struct lp_frame *emitted_frame)
{
	(void)context;
	assert_ptr_equal(emitted_frame, &frame);
	emitted++;
}

static void on_release(struct lp_frame *released_frame)
{
	assert_ptr_equal(released_frame, &frame);
	released++;
}

static void on_move(void *context, float deg)
{
	(void)context;
	moves++;
	target_deg = deg;
}

static void on_look(void *context)
{
	(void)context;
	looks++;
}

static struct lp_wheel_report report;
static struct lp_sweep sweep;

static int setup(void **state)
{
	(void)state;
	frame = (struct lp_frame){.t_read_ns = 1010 * MS,
				  .exposure_us = 10000,
				  .gain = 1,
				  .t_arrival_ns = 1020 * MS,
				  .wheel_deg = 77,
				  .release = on_release};
	emitted = released = looks = moves = 0;
	report = (struct lp_wheel_report){.state.phase = LP_WHEEL_ABSENT};
	sweep = (struct lp_sweep){.host = {.frame = on_frame, .move = on_move, .look = on_look},
				  .report = &report,
				  .angle_count = 3,
				  .angles_deg = {0, 45, 90},
				  .dwell_ns = 500 * MS};
	return 0;
}

static struct lp_wheel_state settled(int64_t since_ms, int64_t seen_ms)
{
	return (struct lp_wheel_state){.phase = LP_WHEEL_SETTLED,
				       .commanded_deg = 0,
				       .measured_deg = 0.25F,
				       .sigma_deg = 0.5F,
				       .t_phase_ns = since_ms * MS,
				       .t_seen_ns = seen_ms * MS};
}

static struct lp_wheel_state in_phase(enum lp_wheel_phase phase)
{
	return (struct lp_wheel_state){.phase = phase,
				       .commanded_deg = NAN,
				       .measured_deg = NAN,
				       .sigma_deg = NAN,
				       .t_seen_ns = 5000 * MS};
}

static void tell(struct lp_wheel_state state, int64_t now_ms)
{
	lp_sweep_state(&sweep, &state, now_ms * MS);
}

static void test_a_frame_waits_for_what_is_seen_after_it(void **state)
{
	(void)state;
	tell(settled(900, 950), 960);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	assert_int_equal(looks, 1);
	tell(settled(900, 1005), 1021); /* seen within the exposure: says nothing of its end */
	assert_int_equal(emitted, 0);
	tell(settled(900, 1020), 1023);
	assert_int_equal(emitted, 1);
	assert_true(frame.wheel_deg == 0.25F && frame.wheel_sigma_deg == 0.5F);
	assert_int_equal(report.frames_stamped, 1);
}

/* What follows a turning camera needs every frame: only the angle is not known. */
static void test_frames_of_a_turning_wheel_pass_without_an_angle(void **state)
{
	(void)state;
	sweep.pass_turning = true;
	tell(settled(1005, 1006), 1010);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	tell(settled(1005, 1021), 1023);
	sweep.pass_turning = false;
	assert_true(emitted == 1 && released == 0);
	assert_true(isnan(frame.wheel_deg) && isnan(frame.wheel_sigma_deg));
	assert_int_equal(report.frames_unknown, 1);
}

static void test_settled_within_the_exposure_is_too_late(void **state)
{
	(void)state;
	tell(settled(1005, 1006), 1010);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	tell(settled(1005, 1021), 1023);
	assert_true(emitted == 0 && released == 1);
	assert_int_equal(report.frames_moving, 1);
}

static void test_what_happens_while_a_frame_waits(void **state)
{
	static const struct {
		enum lp_wheel_phase phase;
		bool passes;
	} cases[] = {{LP_WHEEL_MOVING, false},
		     {LP_WHEEL_HOMING, false},
		     {LP_WHEEL_FAULT, true},
		     {LP_WHEEL_ABSENT, true},
		     {LP_WHEEL_UNKNOWN, true}};

	for (size_t i = 0; i < LP_COUNT(cases); i++) {
		setup(state);
		tell(settled(900, 950), 960);
		lp_sweep_frame(&sweep, &frame, 1020 * MS);
		tell(in_phase(cases[i].phase), 1023);
		assert_int_equal(emitted, cases[i].passes);
		assert_int_equal(released, !cases[i].passes);
		assert_true(!cases[i].passes || isnan(frame.wheel_deg));
		assert_int_equal(lp_sweep_lost(&sweep), cases[i].passes);
	}
}

static void test_without_a_wheel_there_is_no_waiting(void **state)
{
	static const enum lp_wheel_phase lost[] = {LP_WHEEL_ABSENT, LP_WHEEL_UNKNOWN,
						   LP_WHEEL_FAULT};

	for (size_t i = 0; i < LP_COUNT(lost); i++) {
		setup(state);
		tell(in_phase(lost[i]), 960);
		lp_sweep_frame(&sweep, &frame, 1020 * MS);
		assert_true(emitted == 1 && looks == 0 && isnan(frame.wheel_deg));
		assert_int_equal(report.frames_unknown, 1);
	}
}

static void test_frames_of_a_turning_wheel_are_left_out(void **state)
{
	(void)state;
	tell(in_phase(LP_WHEEL_MOVING), 960);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	assert_true(emitted == 0 && released == 1 && report.frames_moving == 1);
	frame.flags = LP_FRAME_LAST; /* but for the one that says that no more will come */
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	assert_true(emitted == 1 && isnan(frame.wheel_deg));
}

static void test_a_lost_wheel_is_lost_until_it_settles(void **state)
{
	static const enum lp_wheel_phase losses[] = {LP_WHEEL_FAULT, LP_WHEEL_ABSENT};
	static const enum lp_wheel_phase tries[] = {LP_WHEEL_UNKNOWN, LP_WHEEL_HOMING,
						    LP_WHEEL_MOVING};

	for (size_t i = 0; i < LP_COUNT(losses) * LP_COUNT(tries); i++) {
		setup(state);
		tell(in_phase(LP_WHEEL_MOVING), 900);
		assert_false(lp_sweep_lost(&sweep));
		tell(in_phase(losses[i % LP_COUNT(losses)]), 960);
		assert_true(lp_sweep_lost(&sweep));
		tell(in_phase(tries[i / LP_COUNT(losses)]), 970);
		assert_true(lp_sweep_lost(&sweep));
		tell(settled(980, 990), 1000);
		assert_false(lp_sweep_lost(&sweep));
		tell(in_phase(LP_WHEEL_HOMING), 1010);
		assert_false(lp_sweep_lost(&sweep));
	}
}

static void test_no_answer_is_no_angle(void **state)
{
	(void)state;
	tell(settled(900, 950), 960);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	lp_sweep_tick(&sweep, 1100 * MS);
	assert_int_equal(emitted, 0);
	lp_sweep_tick(&sweep, 1130 * MS);
	assert_true(emitted == 1 && isnan(frame.wheel_deg));
	/* The next frame does not wait for its own answer, it replaces the one before. */
	lp_sweep_frame(&sweep, &frame, 1140 * MS);
	lp_sweep_frame(&sweep, &frame, 1150 * MS);
	assert_int_equal(emitted, 2);
	lp_sweep_finish(&sweep);
	assert_int_equal(released, 1);
}

static void test_rows_of_unknown_time_count_to_the_arrival(void **state)
{
	(void)state;
	frame.row_time_us = NAN;
	tell(settled(900, 950), 960);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	tell(settled(900, 1015), 1021);
	assert_int_equal(emitted, 0);
	tell(settled(900, 1020), 1022);
	assert_int_equal(emitted, 1);
}

static void test_doubt_is_no_angle(void **state)
{
	struct lp_wheel_state doubt = settled(900, 1020);

	(void)state;
	doubt.measured_deg = doubt.sigma_deg = NAN;
	tell(settled(900, 950), 960);
	lp_sweep_frame(&sweep, &frame, 1020 * MS);
	tell(doubt, 1021);
	assert_true(emitted == 1 && isnan(frame.wheel_deg) && report.frames_unknown == 1);
}

static void test_it_goes_round_the_angles(void **state)
{
	struct lp_wheel_state there = settled(900, 950);

	(void)state;
	lp_sweep_start(&sweep);
	assert_true(moves == 1 && target_deg == 0);
	for (int step = 0; step < 7; step++) {
		const int64_t t_ms = 2000 + 1000 * step;

		there.commanded_deg = sweep.angles_deg[step % 3];
		tell(there, t_ms);
		lp_sweep_tick(&sweep, (t_ms + 499) * MS);
		assert_int_equal(moves, 1 + step);
		lp_sweep_tick(&sweep, (t_ms + 500) * MS);
		assert_int_equal(moves, 2 + step);
		assert_true(target_deg == sweep.angles_deg[(step + 1) % 3]);
		/* Still settled at the old angle: that is no arrival. */
		lp_sweep_tick(&sweep, (t_ms + 999) * MS);
		assert_int_equal(moves, 2 + step);
	}
	assert_int_equal(report.moves, 7);
}

/* A frame of this exposure, taken at the angle where the wheel stands; the next one 33 ms later. */
static void expose(float exposure_us, int64_t *now_ms)
{
	struct lp_wheel_state there = settled(*now_ms - 20, *now_ms + 33);

	there.commanded_deg = sweep.angles_deg[sweep.at];
	frame.t_read_ns = *now_ms * MS;
	if (!isnan(exposure_us))
		frame.t_read_ns += (int64_t)(1e3 * (double)exposure_us);
	frame.exposure_us = exposure_us;
	*now_ms += 33;
	lp_sweep_frame(&sweep, &frame, *now_ms * MS);
	tell(there, *now_ms);
}

static void arrive(int64_t *now_ms)
{
	struct lp_wheel_state there = settled(*now_ms, *now_ms);

	there.commanded_deg = sweep.angles_deg[sweep.at];
	tell(there, *now_ms);
	*now_ms += 33;
}

/* A film leaves an angle when each exposure of the bracket has been
 * there, and not before; where frames tell none, or all the same, after the time. */
static void test_it_goes_on_when_all_exposures_have_been_there(void **state)
{
	const struct {
		float us[6];
		int frames, moves;
	} cases[] = {{{10000, 600, 40}, 3, 0},
		     {{10000, 600, 40, 10000}, 4, 1},
		     {{600, 610, 40, 41, 10000, 600}, 6, 1}, /* commands late: each comes twice */
		     {{600, 610, 40, 41, 10000, 10000}, 6, 0},
		     {{40, 10000, 40}, 3, 1},
		     {{600, 600, 600, 600, 600, 600}, 6, 0},
		     {{NAN, NAN, NAN, NAN, NAN, NAN}, 6, 0}};

	for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++)
		for (int film = 0; film < 2; film++) {
			int64_t now_ms = 2000;

			(void)setup(state);
			sweep.by_exposures = film;
			lp_sweep_start(&sweep);
			arrive(&now_ms);
			for (int n = 0; n < cases[k].frames; n++)
				expose(cases[k].us[n], &now_ms);
			assert_int_equal(moves, 1 + film * cases[k].moves);
			lp_sweep_tick(&sweep, 2500 * MS);
			assert_int_equal(moves, 2);
		}
}

/* What was seen at one angle does not count at the next. */
static void test_each_angle_has_all_exposures(void **state)
{
	/* the first angle shows how many there are; the others are left with the last of them */
	const float us[] = {10000, 600, 40, 10000, 600, 40, 10000, 40, 600, 10000};
	int64_t now_ms = 2000;
	int at = 0;

	(void)state;
	sweep.by_exposures = true;
	lp_sweep_start(&sweep);
	for (int n = 0; n < 3; n++) {
		arrive(&now_ms);
		for (int k = 0; k < (n ? 2 : 3); k++)
			expose(us[at++], &now_ms);
		assert_int_equal(moves, 1 + n);
		expose(us[at++], &now_ms);
		assert_int_equal(moves, 2 + n);
	}
	assert_int_equal(report.sweeps, 1);
}

/* Fewer exposures than at the angle before: one that comes again says that these are all. */
static void test_a_bracket_may_become_smaller(void **state)
{
	const float first[] = {10000, 600, 40, 10000}, then[] = {10000, 600, 10000};
	int64_t now_ms = 2000;

	(void)state;
	sweep.by_exposures = true;
	lp_sweep_start(&sweep);
	arrive(&now_ms);
	for (int k = 0; k < 4; k++)
		expose(first[k], &now_ms);
	assert_int_equal(moves, 2);
	arrive(&now_ms);
	for (int k = 0; k < 3; k++) {
		assert_int_equal(moves, 2);
		expose(then[k], &now_ms);
	}
	assert_int_equal(moves, 3);
}

/* From end to end and back: the wheel never turns further than to the next angle, and what was seen
 * at the end of one sweep begins the next. */
static void test_it_goes_to_and_fro(void **state)
{
	const float way[] = {45, 90, 45, 0, 45, 90, 45};
	int64_t now_ms = 1000;

	(void)state;
	sweep.to_and_fro = true;
	lp_sweep_start(&sweep);
	for (int k = 0; k < 7; k++) {
		struct lp_wheel_state there = settled(now_ms, now_ms);

		there.commanded_deg = target_deg;
		tell(there, now_ms);
		lp_sweep_tick(&sweep, (now_ms + 499) * MS);
		assert_int_equal(moves, 1 + k);
		now_ms += 500;
		lp_sweep_tick(&sweep, now_ms * MS);
		assert_true(target_deg == way[k]);
		/* over when all has been seen at the other end */
		assert_int_equal(report.sweeps, k / 2);
	}
}

static void test_it_rests_at_either_end(void **state)
{
	int64_t now_ms = 1000;

	(void)state;
	sweep.to_and_fro = true;
	sweep.rest_ns = 60000 * MS;
	lp_sweep_start(&sweep);
	for (int sweeps = 1; sweeps < 4; sweeps++) {
		const float end_deg = sweeps % 2 ? 90.0F : 0.0F;

		/* the first one begins with a stay at its first angle */
		for (int k = sweeps > 1; k < 3; k++) {
			struct lp_wheel_state there = settled(now_ms, now_ms);

			assert_int_equal(report.sweeps, sweeps - 1);
			there.commanded_deg = target_deg;
			tell(there, now_ms);
			now_ms += 500;
			lp_sweep_tick(&sweep, now_ms * MS);
		}
		assert_true(report.sweeps == (uint64_t)sweeps && target_deg == end_deg);
		lp_sweep_tick(&sweep, (now_ms + 59000) * MS);
		assert_true(target_deg == end_deg);
		assert_int_equal(lp_sweep_request(&sweep), sweeps + 1);
		lp_sweep_tick(&sweep, (now_ms += 59100) * MS);
		assert_true(target_deg == 45.0F);
		assert_int_equal(lp_sweep_request(&sweep), sweeps + 2); /* this one has begun */
		sweep.wanted = false;
	}
}

/* One round, a minute at the first angle; a new lamp ends the rest once. */
/* The wheel gets where it was told to go, dwells there, and goes on. */
static void dwell(int64_t *now_ms)
{
	struct lp_wheel_state there = settled(*now_ms, *now_ms);

	there.commanded_deg = sweep.angles_deg[sweep.at];
	tell(there, *now_ms);
	*now_ms += 500;
	lp_sweep_tick(&sweep, *now_ms * MS);
}

static void test_a_sweep_on_request_is_a_whole_round(void **state)
{
	int64_t now_ms = 1000;

	(void)state;
	sweep.rest_ns = 3600000 * MS;
	lp_sweep_start(&sweep);
	for (int k = 0; k < 3; k++)
		dwell(&now_ms);
	assert_true(report.sweeps == 1 && target_deg == 0.0F);
	dwell(&now_ms);
	assert_true(target_deg == 0.0F); /* it rests */
	assert_int_equal(lp_sweep_request(&sweep), 2);
	assert_int_equal(lp_sweep_request(&sweep), 2); /* both are answered by the same round */
	dwell(&now_ms);
	assert_true(target_deg == 45.0F);
	assert_int_equal(lp_sweep_request(&sweep), 3); /* this one has begun before */
	dwell(&now_ms);
	dwell(&now_ms);
	assert_true(report.sweeps == 2 && target_deg == 0.0F);
	for (int k = 0; k < 3; k++)
		dwell(&now_ms);
	assert_int_equal(report.sweeps, 3);
	dwell(&now_ms);
	assert_true(target_deg == 0.0F);
}

static void test_it_rests_after_a_round(void **state)
{
	struct lp_wheel_state there = settled(900, 950);
	int64_t t_ms = 2000;

	(void)state;
	sweep.rest_ns = 60000 * MS;
	lp_sweep_start(&sweep);
	for (int round = 0; round < 3; round++) {
		for (int step = 0; step < 3; step++, t_ms += 1000) {
			there.commanded_deg = sweep.angles_deg[step];
			tell(there, t_ms);
			lp_sweep_tick(&sweep, (t_ms + 500) * MS);
			assert_int_equal(moves, 2 + 3 * round + step);
		}
		there.commanded_deg = 0;
		tell(there, t_ms);
		lp_sweep_tick(&sweep, (t_ms + 50000) * MS);
		assert_int_equal(moves, 4 + 3 * round); /* at the first angle, and there it stays */
		t_ms += 50000;
		if (round == 0)
			lp_sweep_want(&sweep);
		else
			t_ms += 10000;
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(test_a_frame_waits_for_what_is_seen_after_it, setup),
		cmocka_unit_test_setup(test_frames_of_a_turning_wheel_pass_without_an_angle, setup),
		cmocka_unit_test_setup(test_settled_within_the_exposure_is_too_late, setup),
		cmocka_unit_test_setup(test_what_happens_while_a_frame_waits, setup),
		cmocka_unit_test_setup(test_without_a_wheel_there_is_no_waiting, setup),
		cmocka_unit_test_setup(test_frames_of_a_turning_wheel_are_left_out, setup),
		cmocka_unit_test_setup(test_a_lost_wheel_is_lost_until_it_settles, setup),
		cmocka_unit_test_setup(test_no_answer_is_no_angle, setup),
		cmocka_unit_test_setup(test_rows_of_unknown_time_count_to_the_arrival, setup),
		cmocka_unit_test_setup(test_doubt_is_no_angle, setup),
		cmocka_unit_test_setup(test_it_goes_on_when_all_exposures_have_been_there, setup),
		cmocka_unit_test_setup(test_each_angle_has_all_exposures, setup),
		cmocka_unit_test_setup(test_a_bracket_may_become_smaller, setup),
		cmocka_unit_test_setup(test_it_goes_to_and_fro, setup),
		cmocka_unit_test_setup(test_it_rests_at_either_end, setup),
		cmocka_unit_test_setup(test_it_goes_round_the_angles, setup),
		cmocka_unit_test_setup(test_a_sweep_on_request_is_a_whole_round, setup),
		cmocka_unit_test_setup(test_it_rests_after_a_round, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
