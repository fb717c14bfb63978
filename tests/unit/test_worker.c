/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "app/run/worker.h"
#include "base/clock.h"
#include "include/frame.h"

/* A pipeline in the place of the real one: takes as long as the test wants, and says what it is
 * told by the frame's sequence. */
struct lp_pipeline {
	pthread_mutex_t gate; /* held by the test: process() waits */
	atomic_int begun;
};

static atomic_int frames_alive;
static struct lp_pipeline pipeline = {.gate = PTHREAD_MUTEX_INITIALIZER};

void lp_pipeline_destroy(struct lp_pipeline *self)
{
	assert_true(!self || self == &pipeline);
}

int lp_pipeline_process(struct lp_pipeline *self, struct lp_frame *frame,
			const struct lp_demand *demand, struct lp_estimates *estimates,
			float *command_us)
{
	const uint64_t sequence = frame->sequence;

	*command_us = sequence % 100 == 97 ? 1000.0F : NAN;
	atomic_fetch_add(&self->begun, 1);
	pthread_mutex_lock(&self->gate);
	pthread_mutex_unlock(&self->gate);
	lp_frame_release(frame);
	if (sequence % 10 == 9)
		return -EBADMSG;
	if (sequence % 10 == 8)
		return -EAGAIN;
	if (sequence % 100 == 97)
		return -EAGAIN;
	estimates->raw.sequence = (uint32_t)sequence;
	estimates->raw.light_count = demand->max_lights;
	return 0;
}

static atomic_int preset_set = -1;
static atomic_int preset_in_force = LP_PRESET_ACCURATE;

/* There is no memory for the most accurate one. */
int lp_pipeline_set_preset(struct lp_pipeline *self, enum lp_preset preset)
{
	assert_ptr_equal(self, &pipeline);
	atomic_store(&preset_set, (int)preset);
	if (preset == LP_PRESET_REFERENCE)
		return -ENOMEM;
	atomic_store(&preset_in_force, (int)preset);
	return 0;
}

enum lp_preset lp_pipeline_preset(const struct lp_pipeline *self)
{
	assert_ptr_equal(self, &pipeline);
	return (enum lp_preset)atomic_load(&preset_in_force);
}

bool lp_pipeline_control(struct lp_pipeline *self, const struct lp_camera_control *control,
			 float *command_us)
{
	assert_ptr_equal(self, &pipeline);
	*command_us = control->limits.min_us;
	return true;
}

static atomic_int ring_lux = -1; /* of the newest frame's reading; -1: none */
static atomic_int ring_noise;	 /* of the newest reading then, in millionths */
static atomic_int turn_rad_s;

void lp_pipeline_ring(struct lp_pipeline *self, const struct lp_ring_sample *then,
		      const struct lp_ring_sample *now)
{
	assert_ptr_equal(self, &pipeline);
	assert_true(now || !then);
	atomic_store(&ring_lux, then ? (int)then->illuminance_lux[0] : -1);
	atomic_store(&ring_noise, now ? (int)(1e6F * now->noise_relative[0]) : -1);
}

float lp_pipeline_turn_rad_s(const struct lp_pipeline *self)
{
	assert_ptr_equal(self, &pipeline);
	return (float)atomic_load(&turn_rad_s);
}

int lp_pipeline_step(struct lp_pipeline *self, const struct lp_ring_sample *now,
		     struct lp_estimates *estimates, float commands_us[LP_MAX_CAMERAS])
{
	assert_ptr_equal(self, &pipeline);
	estimates->raw.sequence = now->sequence;
	commands_us[0] = 500.0F;
	return 0;
}

bool lp_pipeline_polarization(const struct lp_pipeline *self, struct lp_polarization_grid *grid)
{
	assert_ptr_equal(self, &pipeline);
	grid->s0_unit = 5.0F;
	return true;
}

static void release(struct lp_frame *frame)
{
	atomic_fetch_sub(&frames_alive, 1);
	free(frame);
}

static struct lp_demand demand = {.sh_order = 2, .max_lights = 3};

static void submit_of(struct lp_worker *worker, int camera, uint64_t sequence, uint32_t flags)
{
	struct lp_frame *frame = calloc(1, sizeof(*frame));

	frame->camera = (uint8_t)camera;
	frame->sequence = sequence;
	frame->flags = flags;
	frame->release = release;
	atomic_fetch_add(&frames_alive, 1);
	lp_worker_submit(worker, frame, &demand);
}

static void submit(struct lp_worker *worker, uint64_t sequence, uint32_t flags)
{
	submit_of(worker, 0, sequence, flags);
}

static struct lp_worker *start(bool lossless)
{
	struct lp_worker *worker;

	atomic_store(&pipeline.begun, 0);
	assert_int_equal(lp_worker_create(&pipeline, lossless ? LP_ALL_FRAMES : 1, &worker), 0);
	return worker;
}

static struct lp_result *wait_result(struct lp_worker *worker)
{
	struct pollfd poll_fd = {.fd = lp_worker_fd(worker), .events = POLLIN};

	assert_int_equal(poll(&poll_fd, 1, 60000), 1);
	return lp_worker_take(worker);
}

static void wait_begun(int count)
{
	while (atomic_load(&pipeline.begun) < count)
		usleep(1000);
}

/* A frame gets the reading of its own time. */
static void test_a_frame_gets_its_reading_of_the_ring(void **state)
{
	struct lp_worker *worker = start(true);

	(void)state;
	for (int i = 0; i < 10; i++) {
		const struct lp_ring_sample sample = {.t_ns = (1 + i) * 8 * LP_NS_PER_MS,
						      .illuminance_lux = {100.0F + (float)i}};

		lp_worker_ring(worker, &sample);
	}
	submit(worker, 0, 0); /* exposed at 0 */
	lp_worker_give(worker, wait_result(worker));
	assert_int_equal(atomic_load(&ring_lux), 100);
	struct lp_frame *late = calloc(1, sizeof(*late));

	*late = (struct lp_frame){.t_read_ns = LP_NS_PER_S, .release = release};
	atomic_fetch_add(&frames_alive, 1);
	lp_worker_submit(worker, late, &demand);
	lp_worker_give(worker, wait_result(worker));
	assert_int_equal(atomic_load(&ring_lux), -1);
	lp_worker_destroy(worker);
}

/* Noise of steady light, in millionths, while the frames show that the camera turns so fast. */
static int noise_while_turning(int rad_s)
{
	struct lp_worker *worker = start(true);
	struct lp_ring_sample sample = {.t_ns = LP_NS_PER_S, .illuminance_lux = {100.0F}};

	atomic_store(&turn_rad_s, rad_s);
	for (int i = 0; i < 20; i++) {
		submit(worker, 0, 0);
		lp_worker_give(worker, wait_result(worker));
		sample.noise_relative[0] = 0.01F;
		lp_worker_ring(worker, &sample);
		sample.t_ns += 10 * LP_NS_PER_MS;
	}
	submit(worker, 0, 0);
	lp_worker_give(worker, wait_result(worker));
	lp_worker_destroy(worker);
	atomic_store(&turn_rad_s, 0);
	return atomic_load(&ring_noise);
}

static void test_the_filter_knows_how_fast_the_camera_turns(void **state)
{
	(void)state;
	assert_true(noise_while_turning(5) > 1.2 * noise_while_turning(0));
}

static void test_how_light_is_polarized_comes_on_demand(void **state)
{
	struct lp_worker *worker = start(true);
	struct lp_result *result;

	(void)state;
	for (int i = 0; i < 4; i++) {
		demand.polarization_map = i == 1 || i == 3;
		submit(worker, i == 3 ? 8 : 0, 0); /* the last frame gives no estimate */
		result = wait_result(worker);
		assert_int_equal(result->has_polarization, i == 1);
		assert_true(i != 1 || result->polarization.s0_unit == 5.0F);
		lp_worker_give(worker, result);
	}
	demand.polarization_map = false;
	lp_worker_destroy(worker);
}

/* Light that jumps on several sensors gives a result without a frame; on one of them it is a
 * shadow.
 */
static void test_light_that_jumps_gives_a_result(void **state)
{
	struct lp_worker *worker = start(false);
	struct lp_ring_sample sample = {.t_ns = LP_NS_PER_S};
	struct lp_result *result;

	(void)state;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		sample.illuminance_lux[k] = 100.0F;
	for (int i = 0; i < 10; i++) {
		assert_false(lp_worker_ring(worker, &sample));
		sample.t_ns += 10 * LP_NS_PER_MS;
	}
	sample.illuminance_lux[3] = 20.0F;
	assert_false(lp_worker_ring(worker, &sample));
	sample.t_ns += 10 * LP_NS_PER_MS;
	sample.illuminance_lux[3] = 100.0F;
	assert_false(lp_worker_ring(worker, &sample));
	assert_null(lp_worker_take(worker));
	sample.t_ns += 10 * LP_NS_PER_MS;
	sample.sequence = 77;
	for (int k = 4; k < 7; k++)
		sample.illuminance_lux[k] = 150.0F;
	assert_true(lp_worker_ring(worker, &sample));
	result = wait_result(worker);
	assert_int_equal(result->status, 0);
	assert_int_equal(result->estimates.raw.sequence, 77);
	assert_float_equal(result->commands_us[0], 500.0F, 0.0F);
	assert_false(result->last_frame);
	lp_worker_give(worker, result);
	assert_int_equal(atomic_load(&pipeline.begun), 0);
	lp_worker_destroy(worker);
}

static void test_newest_frame_wins_and_drops_are_counted(void **state)
{
	struct lp_worker *worker = start(false);
	struct lp_result *result;

	(void)state;
	assert_int_equal(lp_worker_busy_ns(worker), 0);
	pthread_mutex_lock(&pipeline.gate);
	submit(worker, 0, 0);
	wait_begun(1);
	for (uint64_t i = 1; i <= 5; i++)
		submit(worker, i, 0);
	assert_true(lp_worker_busy_ns(worker) > 0);
	assert_int_equal(atomic_load(&frames_alive), 2);
	pthread_mutex_unlock(&pipeline.gate);
	result = wait_result(worker);
	assert_int_equal(result->estimates.raw.sequence, 0);
	assert_int_equal(result->demand.max_lights, 3);
	assert_int_equal(result->estimates.raw.light_count, 3);
	lp_worker_give(worker, result);
	result = wait_result(worker);
	assert_int_equal(result->estimates.raw.sequence, 5);
	lp_worker_give(worker, result);
	assert_null(lp_worker_take(worker));
	assert_int_equal(lp_worker_dropped(worker), 4);
	lp_worker_destroy(worker);
	assert_int_equal(atomic_load(&frames_alive), 0);
}

static void test_a_new_preset_comes_before_the_next_frame(void **state)
{
	struct lp_worker *worker = start(false);

	(void)state;
	submit(worker, 0, 0);
	lp_worker_give(worker, wait_result(worker));
	assert_int_equal(atomic_load(&preset_set), -1);
	lp_worker_preset(worker, LP_PRESET_FAST);
	lp_worker_preset(worker, LP_PRESET_BALANCED);
	submit(worker, 1, 0);
	lp_worker_give(worker, wait_result(worker));
	assert_int_equal(atomic_exchange(&preset_set, -1), LP_PRESET_BALANCED);
	submit(worker, 2, 0);
	lp_worker_give(worker, wait_result(worker));
	assert_int_equal(atomic_load(&preset_set), -1);
	lp_worker_destroy(worker);
}

static void test_a_result_says_which_preset_is_in_force(void **state)
{
	struct lp_worker *worker = start(false);
	struct lp_result *result;

	(void)state;
	lp_worker_preset(worker, LP_PRESET_FAST);
	submit(worker, 0, 0);
	result = wait_result(worker);
	assert_int_equal(result->preset, LP_PRESET_FAST);
	assert_false(result->preset_refused);
	lp_worker_give(worker, result);
	lp_worker_preset(worker, LP_PRESET_REFERENCE);
	for (uint64_t i = 1; i < 3; i++) {
		submit(worker, i, 0);
		result = wait_result(worker);
		assert_int_equal(result->preset, LP_PRESET_FAST);
		assert_int_equal(result->preset_refused, i == 1);
		lp_worker_give(worker, result);
	}
	lp_worker_destroy(worker);
}

static void test_lossless_keeps_them_all(void **state)
{
	struct lp_worker *worker = start(true);

	(void)state;
	pthread_mutex_lock(&pipeline.gate);
	for (uint64_t i = 0; i < 4; i++)
		submit(worker, i, 0);
	pthread_mutex_unlock(&pipeline.gate);
	for (uint64_t i = 0; i < 4; i++) {
		struct lp_result *result = wait_result(worker);

		assert_int_equal(result->estimates.raw.sequence, i);
		lp_worker_give(worker, result);
	}
	assert_int_equal(lp_worker_dropped(worker), 0);
	lp_worker_destroy(worker);
}

static void test_every_frame_has_a_result_and_refused_ones_are_counted(void **state)
{
	static const struct {
		uint64_t number;
		uint32_t flags;
		int status;
	} frames[] = {
		{9, 0, -EBADMSG},
		{8, 0, -EAGAIN},		 /* accepted, but no estimate yet */
		{1, LP_FRAME_CORRUPT, -EBADMSG}, /* never shown to the pipeline */
		{19, LP_FRAME_LAST, -EBADMSG},
		{8, LP_FRAME_LAST, -EAGAIN},
	};
	struct lp_worker *worker = start(true);

	(void)state;
	for (size_t i = 0; i < LP_COUNT(frames); i++) {
		struct lp_result *result;

		submit(worker, frames[i].number, frames[i].flags);
		result = wait_result(worker);
		assert_int_equal(result->status, frames[i].status);
		assert_int_equal(result->last_frame, frames[i].flags == LP_FRAME_LAST);
		lp_worker_give(worker, result);
	}
	assert_int_equal(lp_worker_rejected(worker), 3);
	assert_int_equal(atomic_load(&pipeline.begun), 4);
	lp_worker_destroy(worker);
	assert_int_equal(atomic_load(&frames_alive), 0);
}

/* A loop that does not take results loses the oldest, not the newest. */
static void test_results_that_nobody_takes(void **state)
{
	struct lp_worker *worker = start(true);
	struct lp_result *result;
	uint32_t last = 0;
	int taken = 0;

	(void)state;
	for (uint64_t i = 0; i < 8; i++)
		submit(worker, i, 0);
	wait_begun(8);
	while (lp_worker_busy_ns(worker) > 0)
		usleep(1000);
	for (; last != 7; taken++) {
		result = wait_result(worker);
		assert_true(taken == 0 || result->estimates.raw.sequence > last);
		last = result->estimates.raw.sequence;
		lp_worker_give(worker, result);
	}
	assert_in_range(taken, 4, 5);
	lp_worker_destroy(worker);
}

static void test_destroy_with_work_left(void **state)
{
	struct lp_worker *worker = start(true);

	(void)state;
	for (uint64_t i = 0; i < 4; i++)
		submit(worker, i, 0);
	lp_worker_destroy(worker);
	assert_int_equal(atomic_load(&frames_alive), 0);
	lp_worker_destroy(NULL);
}

/* Each of several cameras has commands of its own, and its frames may wait beside the others'. */
static void test_several_cameras(void **state)
{
	const struct lp_camera_control control = {.camera = 1, .limits.min_us = 250.0F};
	struct lp_worker *worker = start(true);
	struct lp_result *result;

	(void)state;
	lp_worker_control(worker, &control);
	submit(worker, 1, 0);
	result = wait_result(worker);
	assert_int_equal(result->camera, 0);
	assert_true(isnan(result->commands_us[0]));
	assert_float_equal(result->commands_us[1], 250.0F, 0.0F);
	lp_worker_give(worker, result);
	submit_of(worker, 1, 197, 0);
	result = wait_result(worker);
	assert_int_equal(result->camera, 1);
	assert_true(isnan(result->commands_us[0]));
	assert_float_equal(result->commands_us[1], 1000.0F, 0.0F);
	lp_worker_give(worker, result);
	lp_worker_destroy(worker);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_a_frame_gets_its_reading_of_the_ring),
		cmocka_unit_test(test_the_filter_knows_how_fast_the_camera_turns),
		cmocka_unit_test(test_how_light_is_polarized_comes_on_demand),
		cmocka_unit_test(test_light_that_jumps_gives_a_result),
		cmocka_unit_test(test_newest_frame_wins_and_drops_are_counted),
		cmocka_unit_test(test_a_new_preset_comes_before_the_next_frame),
		cmocka_unit_test(test_a_result_says_which_preset_is_in_force),
		cmocka_unit_test(test_lossless_keeps_them_all),
		cmocka_unit_test(test_every_frame_has_a_result_and_refused_ones_are_counted),
		cmocka_unit_test(test_results_that_nobody_takes),
		cmocka_unit_test(test_destroy_with_work_left),
		cmocka_unit_test(test_several_cameras),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
