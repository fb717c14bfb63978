/* SPDX-License-Identifier: Apache-2.0 */
#include "app/run/worker.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mailbox.h"
#include "base/pool.h"
#include "include/frame.h"
#include "light/ring/ring_filter.h"
#include "light/ring/ring_history.h"
#include "vision/turn/frame_time.h"

/* The farthest reading that still counts for a frame. */
#define RING_MOST_NS (150 * LP_NS_PER_MS)
/* One sensor alone is shadowed: no lamp lights one of them. A step takes a few readings: it falls
 * into the middle of one, and the sensors' lag is not known exactly. */
#define JUMPING_SENSORS 2
#define JUMP_LASTS_NS (50 * LP_NS_PER_MS)
#define STILLS 32 /* places for frames that no newer one replaces */
#define RESULTS 4 /* so many the loop may be late before one is lost */

struct lp_worker {
	struct lp_pipeline *pipeline;
	struct lp_mailbox *inbox, *outbox;
	int waiting; /* live frames in the inbox, at most */
	struct lp_pool *results;
	pthread_t thread;
	bool thread_runs;
	atomic_int demand_sh_order, demand_max_lights, demand_reflection_size;
	atomic_bool demand_polarization_map;
	pthread_mutex_t control_lock;
	struct lp_camera_control controls[LP_MAX_CAMERAS];
	bool control_is_new[LP_MAX_CAMERAS];
	struct lp_ring_filter ring_filter;
	struct lp_ring_history ring; /* of the light, lags taken off */
	int64_t t_jump_ns;	     /* of the last reading that jumped; 0: none */
	atomic_int new_preset;	     /* -1: none */
	atomic_uint_fast64_t rejected;
	atomic_int_fast64_t busy_since_ns; /* 0: idle */
};

/* Hand a new control of a camera to the pipeline, which may have a first command for it. */
static void take_control(struct lp_worker *worker, int camera, float *command_us)
{
	struct lp_camera_control control;
	bool is_new;

	pthread_mutex_lock(&worker->control_lock);
	control = worker->controls[camera];
	is_new = worker->control_is_new[camera];
	worker->control_is_new[camera] = false;
	pthread_mutex_unlock(&worker->control_lock);
	if (is_new)
		lp_pipeline_control(worker->pipeline, &control, command_us);
}

/* Hand the ring's reading of this frame's light to the pipeline. */
static void take_ring(struct lp_worker *worker, const struct lp_frame *frame)
{
	const int64_t t_ns = lp_frame_time(frame, frame->exposure_us).middle_ns;
	const float turn_rad_s = lp_pipeline_turn_rad_s(worker->pipeline);
	struct lp_ring_sample sample, now;
	bool found, has_now;

	pthread_mutex_lock(&worker->control_lock);
	worker->ring_filter.turn_rad_s = turn_rad_s;
	has_now = lp_ring_history_newest(&worker->ring, &now);
	found = lp_ring_history_at(&worker->ring, t_ns, RING_MOST_NS, &sample);
	pthread_mutex_unlock(&worker->control_lock);
	lp_pipeline_ring(worker->pipeline, found ? &sample : NULL, has_now ? &now : NULL);
}

/* What results of frames and of the ring have in common. */
static void prepare(struct lp_worker *worker, struct lp_result *result)
{
	result->last_frame = result->preset_refused = result->has_polarization = false;
	result->preset = lp_pipeline_preset(worker->pipeline);
	result->camera = 0;
	for (int k = 0; k < LP_MAX_CAMERAS; k++)
		result->commands_us[k] = NAN;
	result->demand =
		(struct lp_demand){.sh_order = atomic_load(&worker->demand_sh_order),
				   .max_lights = atomic_load(&worker->demand_max_lights),
				   .reflection_size = atomic_load(&worker->demand_reflection_size),
				   .polarization_map =
					   atomic_load(&worker->demand_polarization_map)};
	result->estimates.surroundings = &result->surroundings;
	result->surroundings.size = 0;
}

/* Run the pipeline, or count the frame that the driver marked corrupt as refused. */
static int process(struct lp_worker *worker, struct lp_frame *frame, struct lp_result *result)
{
	const int preset = atomic_exchange(&worker->new_preset, -1);
	float command_us = NAN;
	int ret;

	for (int k = 0; k < LP_MAX_CAMERAS; k++)
		take_control(worker, k, &result->commands_us[k]);
	take_ring(worker, frame);
	result->preset_refused =
		preset >= 0 && lp_pipeline_set_preset(worker->pipeline, (enum lp_preset)preset) < 0;
	result->preset = lp_pipeline_preset(worker->pipeline);
	if (frame->flags & LP_FRAME_CORRUPT) {
		lp_frame_release(frame);
		ret = -EBADMSG;
	} else {
		ret = lp_pipeline_process(worker->pipeline, frame, &result->demand,
					  &result->estimates, &command_us);
	}
	if (ret == 0 && result->demand.polarization_map)
		result->has_polarization =
			lp_pipeline_polarization(worker->pipeline, &result->polarization);
	if (!isnan(command_us))
		result->commands_us[result->camera] = command_us;
	if (ret < 0 && ret != -EAGAIN)
		atomic_fetch_add(&worker->rejected, 1);
	return ret;
}

/* The ring's newest reading, between frames. */
static int step(struct lp_worker *worker, struct lp_result *result)
{
	struct lp_ring_sample now;

	pthread_mutex_lock(&worker->control_lock);
	(void)lp_ring_history_newest(&worker->ring, &now); /* what woke us */
	pthread_mutex_unlock(&worker->control_lock);
	return lp_pipeline_step(worker->pipeline, &now, &result->estimates, result->commands_us);
}

static void *work(void *argument)
{
	struct lp_worker *worker = argument;
	struct lp_result *result = lp_pool_take(worker->results);

	while (result) {
		struct lp_frame *frame = lp_mailbox_wait(worker->inbox);

		if (!frame && lp_mailbox_is_closed(worker->inbox))
			break;
		atomic_store(&worker->busy_since_ns, lp_clock_ns());
		prepare(worker, result);
		if (frame) {
			result->last_frame = frame->flags & LP_FRAME_LAST;
			result->camera = frame->camera;
			result->status = process(worker, frame, result);
		} else {
			result->status = step(worker, result);
		}
		atomic_store(&worker->busy_since_ns, 0);
		result = lp_mailbox_put(worker->outbox, result);
		if (!result)
			result = lp_pool_take(worker->results);
	}
	if (result)
		lp_pool_give(worker->results, result);
	else
		lp_error("worker", "result", "out of memory: no more estimates");
	return NULL;
}

int lp_worker_create(struct lp_pipeline *pipeline, int waiting, struct lp_worker **worker)
{
	struct lp_worker *self = calloc(1, sizeof(*self));
	int ret = -ENOMEM;

	if (!self) {
		lp_pipeline_destroy(pipeline);
		return -ENOMEM;
	}
	self->pipeline = pipeline;
	atomic_init(&self->new_preset, -1);
	(void)pthread_mutex_init(&self->control_lock, NULL);
	self->waiting = waiting;
	self->inbox = lp_mailbox_create(waiting + STILLS);
	self->outbox = lp_mailbox_create(RESULTS);
	/* One at work and one at the loop besides those that wait: there is always one to take. */
	self->results = lp_pool_create(sizeof(struct lp_result), RESULTS + 2, NULL);
	if (!self->inbox || !self->outbox || !self->results)
		goto err_destroy;
	ret = -pthread_create(&self->thread, NULL, work, self);
	if (ret < 0)
		goto err_destroy;
	self->thread_runs = true;
	*worker = self;
	return 0;
err_destroy:
	lp_error("worker", "start", "%s", lp_strerror(ret));
	lp_worker_destroy(self);
	return ret;
}

static bool is_live(const void *item)
{
	return !(((const struct lp_frame *)item)->flags & LP_FRAME_STILL);
}

bool lp_worker_submit(struct lp_worker *worker, struct lp_frame *frame,
		      const struct lp_demand *demand)
{
	struct lp_frame *replaced;

	atomic_store(&worker->demand_sh_order, demand->sh_order);
	atomic_store(&worker->demand_max_lights, demand->max_lights);
	atomic_store(&worker->demand_reflection_size, demand->reflection_size);
	atomic_store(&worker->demand_polarization_map, demand->polarization_map);
	replaced = lp_mailbox_put_counted(worker->inbox, frame, worker->waiting, is_live);
	lp_frame_release(replaced);
	return !replaced;
}

void lp_worker_control(struct lp_worker *worker, const struct lp_camera_control *control)
{
	pthread_mutex_lock(&worker->control_lock);
	worker->controls[control->camera] = *control;
	worker->control_is_new[control->camera] = true;
	pthread_mutex_unlock(&worker->control_lock);
}

bool lp_worker_ring(struct lp_worker *worker, const struct lp_ring_sample *sample)
{
	struct lp_ring_sample light;
	uint32_t jumped;

	pthread_mutex_lock(&worker->control_lock);
	jumped = lp_ring_filter_update(&worker->ring_filter, sample, &light);
	lp_ring_history_add(&worker->ring, &light);
	if (__builtin_popcount(jumped) >= JUMPING_SENSORS)
		worker->t_jump_ns = sample->t_ns;
	const bool jumps = worker->t_jump_ns && sample->t_ns - worker->t_jump_ns <= JUMP_LASTS_NS;
	pthread_mutex_unlock(&worker->control_lock);
	return jumps && lp_mailbox_wake(worker->inbox);
}

void lp_worker_preset(struct lp_worker *worker, enum lp_preset preset)
{
	atomic_store(&worker->new_preset, (int)preset);
}

int lp_worker_fd(const struct lp_worker *worker)
{
	return lp_mailbox_fd(worker->outbox);
}

struct lp_result *lp_worker_take(struct lp_worker *worker)
{
	return lp_mailbox_take(worker->outbox);
}

void lp_worker_give(struct lp_worker *worker, struct lp_result *result)
{
	lp_pool_give(worker->results, result);
}

uint64_t lp_worker_dropped(struct lp_worker *worker)
{
	return lp_mailbox_lost(worker->inbox);
}

uint64_t lp_worker_rejected(struct lp_worker *worker)
{
	return atomic_load(&worker->rejected);
}

uint64_t lp_worker_results_lost(struct lp_worker *worker)
{
	return lp_mailbox_lost(worker->outbox);
}

int64_t lp_worker_busy_ns(struct lp_worker *worker)
{
	const int64_t since_ns = atomic_load(&worker->busy_since_ns);

	return since_ns ? lp_clock_ns() - since_ns : 0;
}

static void discard_frames(struct lp_worker *worker)
{
	struct lp_frame *frame;

	while (worker->inbox && (frame = lp_mailbox_take(worker->inbox)) != NULL)
		lp_frame_release(frame);
}

void lp_worker_destroy(struct lp_worker *worker)
{
	struct lp_result *result;

	if (!worker)
		return;
	discard_frames(worker);
	if (worker->thread_runs) {
		lp_mailbox_close(worker->inbox);
		pthread_join(worker->thread, NULL);
	}
	discard_frames(worker);
	while (worker->outbox && (result = lp_mailbox_take(worker->outbox)) != NULL)
		lp_pool_give(worker->results, result);
	lp_pool_destroy(worker->results);
	lp_mailbox_destroy(worker->outbox);
	lp_mailbox_destroy(worker->inbox);
	lp_pipeline_destroy(worker->pipeline);
	(void)pthread_mutex_destroy(&worker->control_lock);
	free(worker);
}
