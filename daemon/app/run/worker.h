/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The thread that owns the pipeline. Frames go in, estimates come out through one descriptor. A
 * frame that finds the worker busy waits; the next one takes its place, counted (newest wins). A
 * lossless worker keeps them all instead: the source's own pool limits how many there can be.
 */
#ifndef LP_APP_RUN_WORKER_H
#define LP_APP_RUN_WORKER_H

#include <stdbool.h>
#include <stdint.h>

#include "estimate/pipeline.h"
#include "estimate/surroundings.h"
#include "include/polarization_grid.h"

struct lp_worker;

struct lp_result {
	int status;	 /* of lp_pipeline_process(); only 0 comes with estimates */
	bool last_frame; /* the frame was flagged LP_FRAME_LAST */
	int camera;	 /* of the frame; 0 without one */
	/* Exposure times gain to command of each camera; NAN: leave it. */
	float commands_us[LP_MAX_CAMERAS];
	enum lp_preset preset; /* in force for this frame */
	bool preset_refused;   /* another one was asked for before this frame, and cannot be had */
	struct lp_demand demand; /* what was computed */
	struct lp_estimates estimates;
	struct lp_surroundings surroundings; /* of the estimates */
	bool has_polarization;		     /* it was demanded, and there is a film */
	struct lp_polarization_grid polarization;
};

#define LP_ALL_FRAMES 64 /* more than any source has */

/* Starts the thread. Takes over `pipeline`, also on error. `waiting`: frames that may wait. */
int lp_worker_create(struct lp_pipeline *pipeline, int waiting, struct lp_worker **worker);

/* Takes over the reference to `frame`. Loop thread. False: it replaced one that had to wait, which
 * will have no result. */
bool lp_worker_submit(struct lp_worker *worker, struct lp_frame *frame,
		      const struct lp_demand *demand);

/* A camera streams (again), and this is what can be done about its exposure; or it is gone. Loop
 * thread. */
void lp_worker_control(struct lp_worker *worker, const struct lp_camera_control *control);

/* A reading of the ring of light sensors; each frame takes the one of its time
 * (light/ring/ring_history.h). True: its light has jumped, and there will be a result without a
 * frame. Loop thread. */
bool lp_worker_ring(struct lp_worker *worker, const struct lp_ring_sample *sample);

/* Work by another preset from the next frame on: lp_pipeline_set_preset(). Whether that succeeded
 * is told by the frame's result. Loop thread. */
void lp_worker_preset(struct lp_worker *worker, enum lp_preset preset);

/* Readable while a result waits. */
int lp_worker_fd(const struct lp_worker *worker);

/* The oldest result, for lp_worker_give(); NULL when there is none. Loop thread. Every frame, and
 * every reading for which lp_worker_ring() said so, has one, with or without an estimate, unless it
 * was replaced, or the loop lets too many wait. */
struct lp_result *lp_worker_take(struct lp_worker *worker);
void lp_worker_give(struct lp_worker *worker, struct lp_result *result);

/* Frames replaced by a newer one, and frames that the pipeline or the driver refused. */
uint64_t lp_worker_dropped(struct lp_worker *worker);
uint64_t lp_worker_rejected(struct lp_worker *worker);

/* Results that the loop let wait for too long. */
uint64_t lp_worker_results_lost(struct lp_worker *worker);

/* For how long the frame at work has been so; 0: idle. */
int64_t lp_worker_busy_ns(struct lp_worker *worker);

/* Accepts NULL. Waits for the frame at work; releases all frames, destroys the pipeline. */
void lp_worker_destroy(struct lp_worker *worker);

#endif
