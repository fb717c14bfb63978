/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Steps of light between frames: a lamp that is switched shows in the ring of light sensors before
 * any frame shows it. What the ring reads now is compared with what it should read by the newest
 * estimate (each sensor by its own ratio, learned while nothing is switched), and the estimate is
 * corrected by what explains the difference best (light/ring/ring_step.h). The frames that follow
 * are corrected alike until they show the change themselves, so that nothing jumps back. Anchor
 * frame (vision/imager.h). Plain data; zeroed is a new one. Owned and called by the pipeline.
 */
#ifndef LP_ESTIMATE_RING_RING_STEPS_H
#define LP_ESTIMATE_RING_RING_STEPS_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"
#include "include/ring_sample.h"
#include "light/clipped/clipped_parts.h"
#include "light/math/sh.h"
#include "light/ring/ring_step.h"

struct lp_rotation;

#define LP_MAX_GONE 8

struct lp_ring_steps {
	struct lp_light_estimate seen;	 /* by the newest frame */
	struct lp_light_estimate told;	 /* the same with what the ring has said since */
	float total[LP_SH_MAX_COUNT][3]; /* of `seen`, all orders */
	float ratio[LP_RING_SENSORS];	 /* reading over what it should be; 0: not known yet */
	/* Light on the sensor where that was learned, and where it looked, running means. */
	float ratio_at[LP_RING_SENSORS], ratio_toward[LP_RING_SENSORS][3];
	struct lp_light gone[LP_MAX_GONE]; /* that were listed, and may have been switched off */
	int gone_count;
	struct lp_light parts[LP_MAX_CLIPPED_PARTS]; /* clipped, and no lamps; id 0 */
	int part_count;
	bool pending;	   /* the ring has said more than frames show */
	int agreeing;	   /* frames in a row that show what the ring does, while pending */
	int64_t t_step_ns; /* of the ring's reading that began it */
	float factor;	   /* of the light on all sensors, by the newest reading */
};

/*
 * The newest frame's estimate, with all orders of its light. `then`: the ring's reading of the
 * frame's light, `now`: its newest; NULL: none. Corrects the estimate while a step is pending.
 */
void lp_ring_steps_frame(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
			 const struct lp_ring_sample *then, const struct lp_ring_sample *now,
			 const double (*total)[3], struct lp_light_estimate *estimate);

/*
 * A reading between frames, whose light has jumped. to_anchor: of the camera, at its time;
 * turn_sigma_rad: of that. True: steps->told is other than before.
 */
bool lp_ring_steps_reading(struct lp_ring_steps *steps, const struct lp_rotation *to_anchor,
			   float turn_sigma_rad, const struct lp_ring_sample *now);

/* The anchor frame has been turned. */
void lp_ring_steps_turn(struct lp_ring_steps *steps, const struct lp_rotation *turn);

#endif
