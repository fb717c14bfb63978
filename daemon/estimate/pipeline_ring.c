/* SPDX-License-Identifier: Apache-2.0 */
/* What the ring of light sensors tells the pipeline, with a frame and between frames. */
#include "estimate/pipeline_state.h"

#include <errno.h>
#include <math.h>

#include "base/clock.h"

/* 1 sigma of how a turn goes on until the next frame, of the turn since the last one. */
#define TURN_SIGMA 0.3F

void lp_pipeline_ring(struct lp_pipeline *pipeline, const struct lp_ring_sample *then,
		      const struct lp_ring_sample *now)
{
	lp_ring_stage_sample(&pipeline->ring, then);
	pipeline->has_ring_now = now;
	if (now)
		pipeline->ring_now = *now;
}

void lp_pipeline_use_ring(struct lp_pipeline *p, const double (*total)[3],
			  struct lp_light_estimate *estimate)
{
	p->steps.part_count = lp_ring_stage_parts(&p->ring, p->steps.parts);
	lp_ring_steps_frame(&p->steps, lp_imager_rotation(p->imager),
			    p->ring.has_sample ? &p->ring.sample : NULL,
			    p->has_ring_now ? &p->ring_now : NULL, total, estimate);
}

float lp_pipeline_turn_rad_s(const struct lp_pipeline *pipeline)
{
	return lp_imager_turn(pipeline->imager).rate_deg_per_s * (float)M_PI / 180.0F;
}

/* How far the camera may have turned otherwise since the newest frame. */
static float turn_sigma_rad(const struct lp_pipeline *p, int64_t t_ns)
{
	const int64_t since_ns = t_ns - p->steps.seen.t_capture_ns;

	return TURN_SIGMA * lp_pipeline_turn_rad_s(p) * (float)since_ns / 1e9F;
}

int lp_pipeline_step(struct lp_pipeline *p, const struct lp_ring_sample *now,
		     struct lp_estimates *estimates, float commands_us[LP_MAX_CAMERAS])
{
	const struct lp_rotation rotation = lp_imager_rotation_at(p->imager, now->t_ns);
	const struct lp_light_estimate before = p->steps.told;
	const bool is_new = !p->steps.pending;

	for (int k = 0; k < LP_MAX_CAMERAS; k++)
		commands_us[k] = NAN;
	if (!lp_ring_steps_reading(&p->steps, &rotation, turn_sigma_rad(p, now->t_ns), now))
		return -EAGAIN;
	lp_ring_poses_forget(&p->ring.poses); /* of other light */
	estimates->ring = lp_ring_stage_status(&p->ring);
	estimates->places_left_out = p->places_left_out;
	estimates->raw = p->steps.told;
	estimates->raw.t_arrival_ns = lp_clock_ns();
	lp_tracker_jump(&p->tracker, &before, &p->steps.told);
	lp_pipeline_finish(p, estimates);
	for (int k = 0; k < p->camera_count && is_new; k++)
		if (p->cameras[k].bracketing)
			(void)lp_bracket_light_changed(&p->cameras[k].bracket, p->steps.factor,
						       &commands_us[k]);
	return 0;
}
